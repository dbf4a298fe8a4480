#!/bin/sh
# Runs a command with the token from the file AVLN_TOKEN_FILE, so that no settings file contains a token.
set -eu
if [ -n "${AVLN_TOKEN_FILE:-}" ]; then
    AVLN_TOKEN=$(cat "$AVLN_TOKEN_FILE")
    export AVLN_TOKEN
fi
exec "$@"
