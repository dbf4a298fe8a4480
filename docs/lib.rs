//! The documents and their table of contents.
//!
//! A crate of its own: a corrected comma rebuilds only the program.

/// Table of contents in the format of mdBook. Links are relative to the folder `docs`.
pub const SUMMARY: &str = include_str!("SUMMARY.md");

/// Repository path and Markdown of each document, in the order of [`SUMMARY`].
pub const FILES: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/files.rs"));
