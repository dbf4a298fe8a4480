//! One file for each command: its options, whose documentation is the help text, and what it does.

pub mod admin;
pub mod agent;
pub mod calibrate;
pub mod challenge;
pub mod conformance;
pub mod dataset;
pub mod dataset_formats;
pub mod dataset_frames;
pub mod db;
pub mod demo;
pub mod doctor;
pub mod phase;
pub mod rescore;
pub mod scene;
pub mod scene_export;
pub mod scene_import;
pub mod scene_preview;
pub mod scene_stats;
pub mod sealed;
mod sealed_cell;
pub mod serve;
pub mod sim;
pub mod split;
mod split_prepare;
pub mod team;
pub mod token;
pub mod verify;
