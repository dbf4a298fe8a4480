#!/bin/bash
# Fails if this machine is reachable from the network of the server named by the first argument; otherwise creates the file named by
# the second, and waits.
#
# An engine that isolates the network gives the bridge no address. Other engines give it the first address of the network; it then
# answers address resolution, which no firewall filters.
set -eu
own=$(hostname -i)
network=
# The route without a gateway is that to the own network: four bytes in hexadecimal, the last one first.
while read -r _ destination gateway _; do
    if [ "$gateway" = 00000000 ] && [ "$destination" != 00000000 ]; then network=$destination; fi
done </proc/net/route
if [ -z "$network" ]; then
    echo "error: cannot check the isolation: /proc/net/route lists no network" >&2
    exit 1
fi
first=$((16#${network:6:2})).$((16#${network:4:2})).$((16#${network:2:2})).$((16#${network:0:2} + 1))
server=$(getent hosts "$1" | cut -d' ' -f1)
if [ "$first" != "$own" ] && [ "$first" != "$server" ]; then
    timeout 2 bash -c ": </dev/tcp/$first/9" 2>/dev/null || true
    if grep -qE "^$first +0x1 +0x2 " /proc/net/arp; then
        echo "error: the agent could reach this machine at $first: the profile sealed requires Docker 28 or later; update it, or use avln challenge sealed run" >&2
        exit 1
    fi
fi
touch "$2"
exec sleep infinity
