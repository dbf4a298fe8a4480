#!/bin/bash
# Fails if this machine is reachable from the network of the server named by the first argument; otherwise creates the file named by
# the second, and waits.
#
# An engine that isolates the network gives the bridge no address. Other engines give it the first address of the network; it then
# answers address resolution, which no firewall filters.
set -eu
own=$(hostname -i)
first=${own%.*}.1
server=$(getent hosts "$1" | cut -d' ' -f1)
if [ "$first" != "$own" ] && [ "$first" != "$server" ]; then
    timeout 2 bash -c ": </dev/tcp/$first/9" 2>/dev/null || true
    if grep -qE "^$first +0x1 +0x2 " /proc/net/arp; then
        echo "error: the agent could reach this machine at $first: the profile sealed requires Docker 28 or later" >&2
        exit 1
    fi
fi
touch "$2"
exec sleep infinity
