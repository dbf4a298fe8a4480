# What one types most often; `just --list` shows all.

# Houses, missions, server, two agents, a leaderboard
demo *args:
    cargo run --release -- demo {{args}}

# The release, in dist/: a static program with man pages, completions and licences
dist *target:
    packaging/dist.sh {{target}}

# Everything that must hold
test:
    cargo test --workspace

# What .ci/run checks before the tests
lint:
    cargo fmt --all --check
    cargo clippy --workspace --all-targets -- -D warnings

# Steps per second, printed
bench:
    cargo bench --workspace
