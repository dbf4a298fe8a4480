# What one types most often; `just --list` shows all.

# Houses, missions, server, two agents, a leaderboard
demo *args:
    cargo run --release -- demo {{args}}

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
