#!/bin/sh
# Builds the program `avln` on a bare Debian, as the images do, and copies it to FOLDER: docker/build.sh FOLDER
#
# As root it installs a missing C compiler and Rust; other users need them beforehand.
set -eu
out=${1:?the folder for the program}
rust=$(sed -n 's/^rust-version = "\(.*\)"/\1/p' "$(dirname "$0")/../Cargo.toml")

if ! command -v cc >/dev/null; then
    apt-get update
    apt-get install --yes --no-install-recommends gcc libc6-dev
fi
if ! command -v cargo >/dev/null; then
    apt-get update
    apt-get install --yes --no-install-recommends ca-certificates curl
    curl --proto '=https' --tlsv1.2 --silent --show-error --fail --output /tmp/rustup-init \
        "https://static.rust-lang.org/rustup/dist/$(uname -m)-unknown-linux-gnu/rustup-init"
    chmod +x /tmp/rustup-init
    /tmp/rustup-init -y --profile minimal --default-toolchain "$rust"
    rm /tmp/rustup-init
    PATH=$HOME/.cargo/bin:$PATH
fi
# The compiler only: rust-toolchain.toml also lists developer components.
export RUSTUP_TOOLCHAIN="${RUST_VERSION:-$rust}"

mkdir -p "$out"
out=$(cd "$out" && pwd)
cd "$(dirname "$0")/.."
cargo build --release --locked --package avln-cli
install -m 755 "${CARGO_TARGET_DIR:-target}/release/avln" "$out/avln"
