#!/usr/bin/env bash
# Takes the screenshot docs/images/replay.png: a replay of PAG-Nav in the demo.
# Requires avln on PATH (or AVLN_BIN), curl, Chromium and pngquant. Takes 2 to 3 minutes.
set -euo pipefail
images=$(cd "$(dirname "$0")" && pwd)
avln=${AVLN_BIN:-avln}
web=127.0.0.1:58080
step=${1:-40}
folder=$(mktemp -d)
trap 'kill "${server:-}" 2>/dev/null || true; rm -rf "$folder"' EXIT

"$avln" --data "$folder/data" demo --grpc 127.0.0.1:58051 --web "$web" >"$folder/demo.txt" 2>&1 &
server=$!
until grep -q '^Stop with' "$folder/demo.txt"; do
    kill -0 "$server" 2>/dev/null || { cat "$folder/demo.txt" >&2; exit 1; }
    sleep 1
done

# The API lists one JSON object per run; its keys are sorted, so that "method" and "order" precede "run".
run=$(curl -fsS "http://$web/api/v1/runs" | tr '{' '\n' | grep '"PAG-Nav"' | grep '"unordered"' |
    grep -o 'run_[0-9a-f]*' | head -n 1)
browser=$(command -v chromium || command -v chromium-browser || command -v google-chrome)
"$browser" --headless --no-sandbox --disable-gpu --no-first-run --disable-background-networking --hide-scrollbars \
    --user-data-dir="$folder/profile" --force-device-scale-factor=0.8 --window-size=1280,1090 \
    --virtual-time-budget=8000 \
    --screenshot="$folder/page.png" "http://$web/runs/$run/episodes/0?t=$step" 2>/dev/null
pngquant --force --speed 1 128 --output "$images/replay.png" "$folder/page.png"
ls -l "$images/replay.png"
