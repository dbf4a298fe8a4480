//! End-to-end tests by subject. `cargo test -p avln-tests SUBJECT` runs the tests of a module.

mod administration;
mod agents;
mod bad_input;
mod calibration;
mod command_line;
mod conformance;
mod deployment;
mod documents;
mod engine;
mod faults;
mod guessing;
mod imports;
mod journeys;
mod leak;
mod leaving;
mod pages;
mod resilience;
mod run_logs;
mod sealed;
mod sharing;
mod storage;
mod tidy;
mod tls;
