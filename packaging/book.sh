#!/usr/bin/env bash
# Builds the book, static pages of README, documents and protocol with a search, and checks its links: packaging/book.sh
# Needs mdBook 0.5 or later. The pages are in target/book/html.
set -euo pipefail
cd "$(dirname "$0")/.."
command -v mdbook >/dev/null || { echo "error: no mdbook; install it with: cargo install mdbook" >&2; exit 1; }
book=$PWD/target/book
source=$book/src
html=$book/html
repository=$(sed -n 's/^repository = "\(.*\)"/\1/p' Cargo.toml | head -n 1)

# Copies the pages, with the folders of the repository. The README is the first page.
stage() {
    rm -rf "$book"
    mkdir -p "$source/proto"
    cp README.md "$source/index.md"
    cp proto/PROTOCOL.md "$source/proto"
    cp CONTRIBUTING.md "$source"
    cp -r docs "$source"
    rm "$source"/docs/{Cargo.toml,build.rs,lib.rs,SUMMARY.md,images/make.sh}
    {
        printf '# Summary\n\n[Overview](index.md)\n'
        # Links become relative to the root of the repository.
        tail -n +2 docs/SUMMARY.md | sed -e 's|](\.\./|](|' -e t -e 's|](|](docs/|'
    } >"$source/SUMMARY.md"
    sed "s|REPOSITORY|$repository|" packaging/book.toml >"$book/book.toml"
}

# Prints the new target for a link in a page, by paths; nothing if the link stays. Files outside of the book are in the repository.
target() {
    local folder=$1 link=$2 path
    path=$(realpath --canonicalize-missing --relative-to=. "$folder/$link")
    if [ "$path" = README.md ]; then
        echo "${link%README.md}index.md"
    elif [ -d "$path" ]; then
        echo "$repository/tree/HEAD/$path"
    elif [ -f "$path" ] && [ ! -f "$source/$path" ]; then
        echo "$repository/blob/HEAD/$path"
    fi
}

rewrite_links() {
    local page link new
    while read -r page; do
        while read -r link; do
            new=$(target "$(dirname "$page")" "$link")
            [ -z "$new" ] || sed -i "s|](${link//./\\.}\([)# ]\)|]($new\1|g" "$source/$page"
        done < <(grep -oE '\]\([^)# ]+' "$source/$page" | cut -c 3- | grep -v : | sort -u)
    done < <(cd "$source" && find . -name '*.md' ! -name SUMMARY.md)
}

# Prints local links without a file or without their anchor, and fails if there are any.
check_links() {
    local page link path anchor code=0
    while read -r page; do
        while read -r link; do
            path=${link%%[#?]*}
            anchor=
            [[ $link != *\#* ]] || anchor=${link#*\#}
            case $path in
                '') path=$page ;;
                /*) path=$html$path ;;
                *) path=${page%/*}/$path ;;
            esac
            # A folder stands for its first page.
            [ -f "$path" ] || path=${path%/}/index.html
            if [ ! -f "$path" ] || { [ -n "$anchor" ] && ! grep -qF " id=\"$anchor\"" "$path"; }; then
                echo "error: broken link in ${page#"$html"/}: $link" >&2
                code=1
            fi
        done < <(grep -oE ' (href|src)="[^"]*"' "$page" | cut -d '"' -f 2 | grep -vE '^([a-z][a-z0-9+.-]*:|//)' | sort -u)
    done < <(find "$html" -name '*.html')
    return $code
}

stage
rewrite_links
mdbook build "$book" --dest-dir "$html"
check_links
echo "$html/index.html"
