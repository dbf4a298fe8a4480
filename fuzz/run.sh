#!/usr/bin/env bash
# Fuzzes every reader of external bytes for SECONDS (default 10) each, or only the given targets: fuzz/run.sh [SECONDS [TARGET ...]].
# With 0 seconds, it only compiles them.
# Prints the number of covered branches. A failing input stays in fuzz/artifacts/TARGET/.
set -euo pipefail
cd "$(dirname "$0")"
seconds=${1:-10}
shift || true
targets=("$@")
if [ ${#targets[@]} = 0 ]; then
    for file in targets/*.rs; do targets+=("$(basename "$file" .rs)"); done
fi
host=$(rustc -vV | sed -n 's/^host: //p')
begun=$SECONDS
cargo build --release --quiet --target "$host"
echo "fuzz: compiled in $((SECONDS - begun)) s"
[ "$seconds" != 0 ] || exit 0

logs=$(mktemp -d)
trap 'rm -rf "$logs"' EXIT
mkdir "$logs/temporary"
# Targets write temporary files, also if they are killed.
export TMPDIR=$logs/temporary
export host logs seconds

# Fuzzes the target $1, and adds its branches and inputs to the totals.
fuzz() {
    local log=$logs/$1.log branches inputs
    mkdir -p "found/$1" "artifacts/$1"
    # New inputs go to `found`; `corpus` stays as it is in the repository. Larger inputs only cost time.
    if ! "target/$host/release/$1" -max_total_time="$seconds" -max_len=65536 -rss_limit_mb=1024 \
        -timeout=10 -print_final_stats=1 -artifact_prefix="artifacts/$1/" "found/$1" "corpus/$1" >"$log" 2>&1; then
        tail -n 40 "$log" >&2
        echo "fuzz: $1 failed; the input is in fuzz/artifacts/$1" >&2
        return 1
    fi
    branches=$(sed -n 's/.*cov: \([0-9]*\).*/\1/p' "$log" | tail -n 1)
    inputs=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
    echo "${branches:-0} ${inputs:-0}" >>"$logs/totals"
    echo "fuzz: $1, ${branches:-0} branches, ${inputs:-0} inputs in $seconds s"
}
export -f fuzz

# A target per processor at a time.
printf '%s\n' "${targets[@]}" | xargs -n 1 -P "$(nproc)" bash -euo pipefail -c 'fuzz "$1"' fuzz
awk '{ branches += $1; inputs += $2 } END { print "fuzz: " NR " targets, " branches " branches, " inputs " inputs" }' "$logs/totals"
