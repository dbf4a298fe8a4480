//! The Rust client of LH-AVLN Arena: connection, episodes, steps.
