//! The documents and their table of contents.
//!
//! A crate of its own: a corrected comma rebuilds only the program.

/// Table of contents in the format of mdBook. Links are relative to the folder `docs`.
pub const SUMMARY: &str = include_str!("SUMMARY.md");

/// Repository path and text: each document in Markdown, in the order of [`SUMMARY`], and each chart in SVG.
pub const FILES: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/files.rs"));
