//! The commands of `avln`, a file per command or group. The documentation of arguments is the help text.

pub(crate) mod admin;
pub(crate) mod agent;
pub(crate) mod baselines;
pub(crate) mod challenge;
pub(crate) mod checks;
pub(crate) mod dataset;
pub(crate) mod db;
pub(crate) mod demo;
pub(crate) mod leaderboard;
pub(crate) mod phase;
pub(crate) mod run;
pub(crate) mod scene;
pub(crate) mod scene_stats;
pub(crate) mod sealed;
mod sealed_sandbox;
pub(crate) mod serve;
pub(crate) mod sim;
pub(crate) mod split;
pub(crate) mod team;
