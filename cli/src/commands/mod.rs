//! The commands, one file each. The documentation of arguments is the help text.

pub mod admin;
pub mod agent;
pub mod baselines;
pub mod calibrate;
pub mod challenge;
pub mod conformance;
pub mod dataset;
pub mod db;
pub mod demo;
pub mod doctor;
pub mod leaderboard;
pub mod manual;
pub mod phase;
pub mod rescore;
pub mod rollout;
pub mod ruling;
pub mod scene;
pub mod scene_stats;
pub mod sealed;
mod sealed_sandbox;
pub mod serve;
pub mod sim;
pub mod split;
pub mod team;
pub mod token;
pub mod verify;
