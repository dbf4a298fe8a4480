#!/bin/sh
# Prints the licences of all linked crates for a target: packaging/licences.sh TARGET
# Needs the downloaded sources, as after a build.
set -eu
target=${1:?the target}
sources=${CARGO_HOME:-$HOME/.cargo}/registry/src

echo "The program avln and the Python module avln.sim._native are made of the crates below, of Rust's standard library (MIT OR Apache-2.0) and, where it is static, of musl (MIT)."
cargo tree --locked --package avln-cli --package avln-native --edges normal --target "$target" --prefix none --no-dedupe --format '{p}|{l}' \
    | grep --invert-match -e '(/' -e '^$' | sort --unique | while IFS='|' read -r package licence; do
    crate=${package%% *}
    version=${package#* v}
    version=${version%% *}
    printf '\n======== %s %s: %s\n' "$crate" "$version" "$licence"
    find "$sources"/*/"$crate-$version" -maxdepth 1 -type f \
        \( -iname 'licen[cs]e*' -o -iname 'copying*' -o -iname 'copyright*' -o -iname 'notice*' \) \
        | sort | while read -r file; do
        printf '\n-------- %s\n\n' "${file##*/}"
        cat "$file"
    done
done
