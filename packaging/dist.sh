#!/bin/sh
# Builds a release in the folder dist: an archive with the program, man pages, shell completions, unit files and licences, and
# SHA256SUMS. packaging/dist.sh [TARGET]; the default is a static program for Linux on x86-64.
set -eu
cd "$(dirname "$0")/.."
target=${1:-x86_64-unknown-linux-musl}
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)
name=avln-$version-$target
folder=dist/$name
case $target in
    *-musl) command -v musl-gcc >/dev/null || { echo "error: no musl-gcc; install it with: apt-get install musl-tools" >&2; exit 1; } ;;
esac

rustup target add "$target"
CARGO_PROFILE_RELEASE_STRIP=symbols cargo build --release --locked --package avln-cli --target "$target"
rm -rf "$folder"
mkdir -p "$folder/systemd" "$folder/proxy"
install -m 755 "${CARGO_TARGET_DIR:-target}/$target/release/avln" "$folder/avln"
"$folder/avln" manual "$folder"
cp README.md CHANGELOG.md LICENSE-MIT LICENSE-APACHE "$folder"
cp packaging/*.service packaging/*.timer packaging/avln.sysusers "$folder/systemd"
cp packaging/Caddyfile packaging/nginx.conf "$folder/proxy"
packaging/licences.sh "$target" >"$folder/LICENCES-OF-CRATES"

# Reproducible: the same sources result in the same archive.
moment=$(git log -1 --format=%ct)
tar --create --directory dist --sort=name --owner=0 --group=0 --numeric-owner --mtime="@$moment" "$name" \
    | gzip --no-name --best >"dist/$name.tar.gz"
rm -rf "$folder"
(cd dist && sha256sum -- *.tar.gz >SHA256SUMS)
echo "dist/$name.tar.gz"
