#!/bin/sh
# Writes a daily backup of the data folder to the folder BACKUPS, and keeps the latest KEEP backups.
set -eu
while true; do
    avln data db backup "$BACKUPS/avln-$(date --utc +%Y%m%dT%H%M%SZ).tar"
    find "$BACKUPS" -maxdepth 1 -name 'avln-*.tar' | sort --reverse | tail --lines "+$((KEEP + 1))" | xargs --no-run-if-empty rm
    sleep 86400
done
