//! The Rust client of LH-AVLN Arena: connection, episodes, steps.
//!
//! Three layers; use the highest one that fits:
//!
//! | layer | content | start with |
//! |---|---|---|
//! | connection | server, account, phases, quotas, runs | [`Client`], [`ConnectOptions`], [`Run`] |
//! | episodes | a run's slots, episode by episode, step by step | [`Play`], [`Episode`], [`Episodes`] |
//! | agents | a type that chooses actions | [`Agent`], [`evaluate`] |
//!
//! # Agents
//!
//! [`evaluate`] plays a run with an [`Agent`], [`evaluate_slots`] with several agents in parallel.
//!
//! ```no_run
//! use avln_client::{
//!     Action, Agent, Client, Error, Mission, Observation, RunOptions, Sensors, TaskSpec, evaluate,
//! };
//!
//! /// Walks until something is near, then turns.
//! struct Careful;
//!
//! impl Agent for Careful {
//!     fn begin(&mut self, _task: &TaskSpec, mission: &Mission) {
//!         println!("{} goals", mission.goals.len());
//!     }
//!
//!     fn act(&mut self, seen: &Observation) -> Action {
//!         let depth = seen.depth.as_ref();
//!         let ahead_m = depth.and_then(|d| d.metres.get(d.metres.len() / 2 + d.width as usize / 2));
//!         match ahead_m {
//!             _ if seen.remaining_steps == 1 => Action::Stop,
//!             Some(0.0..1.0) => Action::TurnLeft,
//!             _ => Action::MoveForward,
//!         }
//!     }
//! }
//!
//! # #[tokio::main]
//! # async fn main() -> Result<(), Error> {
//! let client = Client::connect("http://127.0.0.1:50051", "my-account-token").await?;
//! let run = client.start_run(RunOptions::new("practice", "careful")).await?;
//! println!("{}", evaluate(&client, &run, Sensors::square(128), &mut Careful).await?);
//! # Ok(())
//! # }
//! ```
//!
//! An agent needs no server to be tested:
//!
//! ```
//! # use avln_client::{Action, Agent, Mission, Observation, TaskSpec};
//! struct Turning;
//!
//! impl Agent for Turning {
//!     fn begin(&mut self, _task: &TaskSpec, _mission: &Mission) {}
//!
//!     fn act(&mut self, seen: &Observation) -> Action {
//!         if seen.remaining_steps == 1 { Action::Stop } else { Action::TurnLeft }
//!     }
//! }
//!
//! let last = Observation { remaining_steps: 1, ..Observation::default() };
//! assert_eq!(Turning.act(&last), Action::Stop);
//! ```
//!
//! # Episodes
//!
//! Programs with a custom loop request episodes and take steps. [`Play::episodes`] returns a stream of owned episodes, which
//! can be sent to other tasks.
//!
//! ```no_run
//! use avln_client::{Action, Client, Error, Order, RunOptions, Sensors};
//!
//! # #[tokio::main]
//! # async fn main() -> Result<(), Error> {
//! let client = Client::connect("http://127.0.0.1:50051", "my-account-token").await?;
//! let run = client.start_run(RunOptions::new("practice", "my-method").order(Order::Unordered)).await?;
//! let mut play = client.play(&run, Sensors::default()).await?;
//! while let Some(mut episode) = play.next_episode().await? {
//!     println!("{} goals", episode.mission().goals.len());
//!     while !episode.is_over() {
//!         let action = match episode.observation().remaining_steps {
//!             1 => Action::Stop,
//!             _ => Action::MoveForward,
//!         };
//!         episode.step(action).await?;
//!     }
//! }
//! println!("{}", play.finish().await?);
//! # Ok(())
//! # }
//! ```
//!
//! [`Client::play_slots`] opens several slots, each for a separate task (`examples/slots.rs`).
//!
//! # Connection
//!
//! [`Client::connect_with`] takes a certificate authority for `https://` servers, the encoding and the
//! reconnection time; [`Client::phases`] lists the server's phases.
//!
//! ```no_run
//! use avln_client::{Client, ConnectOptions, Error};
//! use std::time::Duration;
//!
//! # #[tokio::main]
//! # async fn main() -> Result<(), Error> {
//! let options = ConnectOptions {
//!     ca: Some("authority.pem".into()),
//!     patience: Some(Duration::from_secs(600)),
//!     ..ConnectOptions::default()
//! };
//! let client = Client::connect_with("https://arena.example:50051", "my-account-token", &options).await?;
//! for phase in client.phases().await? {
//!     println!("{}: {}", phase.id, phase.title);
//! }
//! for quota in client.quota().await? {
//!     println!("{}: {} runs used", quota.phase, quota.used);
//! }
//! # Ok(())
//! # }
//! ```
//!
//! # Failures
//!
//! - A lost stream is reconnected, and open episodes continue at their step: [`Episode::step`] only takes longer.
//!   [`ConnectOptions::patience`] limits the time.
//! - A call with a lost answer is repeated for some seconds; a repeated request starts a run only once.
//! - A rejection by the server is [`Error::Refused`] with a [`Reason`]; [`Error::Lost`] means that patience ran out.
//! - An episode ended by a server fault has [`EndReason::ServerFault`] and does not count; the run continues.
//!
//! # Threads
//!
//! A single-thread runtime (`#[tokio::main(flavor = "current_thread")]`) saves the change between threads in every step. It
//! suits agents that choose within a few seconds: meanwhile the server's Pings remain unanswered.
//!
//! This crate never exposes a generated message, contains a target, a place or a score hidden by the server,
//! or links the simulator.

mod action;
mod agent;
mod calls;
mod client;
mod connect_options;
mod connection;
mod error;
mod observation;
mod play;
mod service;
mod slot;
mod summary;
mod task;
mod welcome;

pub use action::{Action, EndReason, MethodType, Order, UnknownMethodType, UnknownOrder};
pub use agent::{Agent, evaluate, evaluate_slots, evaluate_with};
pub use avln_proto::v1::Reason;
pub use client::Client;
pub use connect_options::{ConnectOptions, Packing};
pub use error::Error;
pub use nalgebra;
pub use observation::{Audio, DepthImage, Feedback, GoalCue, Image, Mission, Observation, Pose, RgbImage};
pub use play::{Episode, Episodes, Play};
pub use service::{
    Account, Phase, PhaseState, Quota, QuotaWindow, Run, RunOptions, RunState, RunStatus, RunWatch,
    ServerInfo,
};
pub use slot::TimeLeft;
pub use summary::{EpisodeEnd, Metric, Notice, Progress, RunSummary};
pub use task::{
    DepthNoise, DistanceRule, ExtraSubmit, FeedbackRule, PoseFrame, RgbNoise, Sensors, SilenceRule,
    SoundClip, SoundingRule, StopClaims, TaskSpec, WrongSubmit,
};

/// The example in the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
