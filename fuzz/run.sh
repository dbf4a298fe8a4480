#!/usr/bin/env bash
# Fuzzes every reader of external bytes for SECONDS (default 10) each, or only the given targets: fuzz/run.sh [SECONDS [TARGET ...]].
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
cargo build --release --quiet --target "$host"
for target in "${targets[@]}"; do
    mkdir -p "found/$target" "artifacts/$target"
    log=$(mktemp)
    # New inputs go to `found`; `corpus` stays as it is in the repository. Larger inputs only cost time.
    if ! target/"$host"/release/"$target" -max_total_time="$seconds" -max_len=65536 -rss_limit_mb=1024 \
        -timeout=10 -print_final_stats=1 -artifact_prefix="artifacts/$target/" "found/$target" "corpus/$target" >"$log" 2>&1; then
        tail -n 40 "$log" >&2
        echo "fuzz: $target failed; the input is in fuzz/artifacts/$target" >&2
        exit 1
    fi
    coverage=$(sed -n 's/.*cov: \([0-9]*\).*/\1/p' "$log" | tail -n 1)
    runs=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
    echo "fuzz: $target, ${coverage:-0} branches, $runs inputs in $seconds s"
    rm -f "$log"
done
