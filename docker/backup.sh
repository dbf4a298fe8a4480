#!/bin/sh
# Writes a daily backup of the data folder to the folder BACKUPS, and keeps the latest KEEP backups. A restart writes none on a day with
# a backup, so that restarts displace no older days.
set -eu
while true; do
    if [ -z "$(find "$BACKUPS" -maxdepth 1 -name 'avln-*.tar' -mmin -1430)" ]; then
        avln data db backup "$BACKUPS/avln-$(date --utc +%Y%m%dT%H%M%SZ).tar"
    fi
    find "$BACKUPS" -maxdepth 1 -name 'avln-*.tar' | sort --reverse | tail --lines "+$((KEEP + 1))" | xargs --no-run-if-empty rm
    sleep 3600
done
