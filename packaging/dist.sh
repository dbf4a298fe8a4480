#!/bin/sh
# Builds a release in the folder dist: an archive with the program, man pages, shell completions, unit files and licences; the Python
# packages, a source archive and a wheel for any platform, and a wheel with native module and program for this one; and SHA256SUMS.
# packaging/dist.sh [TARGET]; the default is a static program for Linux on x86-64. AVLN_RELEASE_KEY names a PEM file with an Ed25519
# key, which signs SHA256SUMS as SHA256SUMS.sig. With cargo-cyclonedx, an SBOM lists the crates of the program; with cargo-zigbuild,
# the module fits glibc 2.17 and later. AVLN_PYTHON names a Python with hatchling, otherwise python3.
set -eu
cd "$(dirname "$0")/.."
target=${1:-x86_64-unknown-linux-musl}
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)
name=avln-$version-$target
folder=dist/$name
# Python loads modules that are linked against glibc only.
module_target=${target%-*}-gnu
python=${AVLN_PYTHON:-python3}
max_wheel_bytes=40000000
"$python" -c 'import hatchling' || { echo "error: no hatchling; install it with: $python -m pip install hatchling" >&2; exit 1; }
case $target in
    *-musl) command -v musl-gcc >/dev/null || { echo "error: no musl-gcc; install it with: apt-get install musl-tools" >&2; exit 1; } ;;
esac
# Before the build: a wrong key must not fail after minutes.
if [ -n "${AVLN_RELEASE_KEY:-}" ]; then
    openssl pkey -in "$AVLN_RELEASE_KEY" -noout -text | grep -q '^ED25519 Private-Key' \
        || { echo "error: $AVLN_RELEASE_KEY has no Ed25519 key; make one with: openssl genpkey -algorithm ED25519 -out FILE" >&2; exit 1; }
fi

rustup target add "$target" "$module_target"
CARGO_PROFILE_RELEASE_STRIP=symbols cargo build --release --locked --package avln-cli --target "$target"
if command -v cargo-zigbuild >/dev/null; then
    cargo zigbuild --release --locked --package avln-native --target "$module_target.2.17"
else
    cargo build --release --locked --package avln-native --target "$module_target"
fi
rm -rf "$folder" "dist/$name.cdx.json" dist/SHA256SUMS.sig dist/*.whl
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

(cd client-sdk/python && "$python" -m hatchling build --directory ../../dist)
built=${CARGO_TARGET_DIR:-target}
packaging/wheel.sh "$target" "$built/$module_target/release/lib_native.so" "$built/$target/release/avln" dist
for wheel in dist/*.whl; do
    [ "$(wc -c <"$wheel")" -le $max_wheel_bytes ] || { echo "error: $wheel has more than $max_wheel_bytes bytes" >&2; exit 1; }
done

if command -v cargo-cyclonedx >/dev/null; then
    # It writes a file beside the manifest of every crate in the workspace. Only that of the program is of interest; its ending
    # depends on the version of the tool.
    SOURCE_DATE_EPOCH=$moment cargo cyclonedx --format json --target "$target" --override-filename "$name"
    mv cli/"$name"*.json "dist/$name.cdx.json"
    find . \( -path ./dist -o -path ./target \) -prune -o -type f -name "$name*.json" -exec rm {} +
else
    echo "no SBOM: install cargo-cyclonedx with: cargo install cargo-cyclonedx" >&2
fi
(
    cd dist
    : >SHA256SUMS
    for file in *.tar.gz *.whl *.cdx.json; do
        [ ! -e "$file" ] || sha256sum -- "$file" >>SHA256SUMS
    done
)
if [ -n "${AVLN_RELEASE_KEY:-}" ]; then
    openssl pkeyutl -sign -rawin -inkey "$AVLN_RELEASE_KEY" -in dist/SHA256SUMS -out dist/SHA256SUMS.sig
fi
cat dist/SHA256SUMS
