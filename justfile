# Common commands; `just --list` shows all.

# Houses, missions, server, two agents, a leaderboard
demo *args:
    cargo run --release -- demo {{args}}

# The release, in dist/: a static program with man pages, completions and licences
dist *target:
    packaging/dist.sh {{target}}

# All tests
test:
    cargo test --workspace

# Format and lints, as in .ci/run
lint:
    cargo fmt --all --check
    cargo clippy --workspace --all-targets -- -D warnings

# Benchmarks
bench:
    cargo bench --workspace
