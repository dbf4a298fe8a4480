#!/bin/sh
# Runs a command with the token that the file AVLN_TOKEN_FILE holds, so that none stands in a file of settings.
set -eu
if [ -n "${AVLN_TOKEN_FILE:-}" ]; then
    AVLN_TOKEN=$(cat "$AVLN_TOKEN_FILE")
    export AVLN_TOKEN
fi
exec "$@"
