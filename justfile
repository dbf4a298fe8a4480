# Common tasks of contributors; `just` lists them.

[private]
default:
    @just --list --unsorted

# Build houses, play two agents, and serve the leaderboard
demo *args:
    cargo run --release -- demo {{args}}

# Run all tests, with cargo-nextest if it is installed
test *args:
    @if cargo nextest --version >/dev/null 2>&1; then \
        cargo nextest run --workspace {{args}} && cargo test --workspace --doc; \
    else \
        cargo test --workspace {{args}}; \
    fi

# Check format, lints and API documentation, as in CI
lint:
    cargo fmt --all --check
    cargo clippy --workspace --all-targets -- -D warnings
    RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps

# Open the API documentation
docs:
    cargo doc --workspace --no-deps --open

# Build the book of all documents, with mdBook, and check its links
book:
    packaging/book.sh

# Run all benchmarks
bench *args:
    cargo bench --workspace {{args}}

# Run 64 slots with killed agents, short connections and page views for `minutes`; with --kill-server the server dies too
soak minutes="5" *args:
    cargo bench -p avln-tests --bench soak -- {{minutes}} {{args}}

# Compare this build with the published calibration
calibrate:
    cargo run --release -- lab calibrate

# Rewrite generated pages and golden files after a deliberate change
bless:
    AVLN_BLESS=1 cargo test -p avln-tests -- documents command_line
    AVLN_BLESS=1 cargo test -p avln-web --test web

# Find code that no test checks: mutants of scoring, referee and quotas (hours)
mutants *args:
    cargo mutants --package avln-scoring --package avln-referee {{args}}
    cargo mutants --package avln-challenge --file server/benchmark/challenge/src/quota.rs --file server/benchmark/challenge/src/phase.rs --file server/benchmark/challenge/src/run.rs {{args}}
    cargo mutants --package avln-store --file server/io/store/src/admission.rs --file 'server/io/store/src/views/*.rs' {{args}}

# Simulate the server for `steps` steps, with faults and restarts, from new seeds
simulate steps="1000000":
    AVLN_SIMULATION_SEED=${AVLN_SIMULATION_SEED:-$(date +%s)} AVLN_SIMULATION_STEPS={{steps}} \
        cargo test --package avln-arena --test all -- simulation:: --nocapture

# Fuzz all readers of external bytes for `seconds` each, or only the given targets; without arguments an hour of processor time
fuzz seconds="164" *targets:
    fuzz/run.sh {{seconds}} {{targets}}

# Build the release in dist/: archive of the static program, Python wheels and source archive
dist *target:
    packaging/dist.sh {{target}}

# Play the trial in containers
containers *args:
    docker compose up {{args}}
