//! The Rust client of LH-AVLN Arena: connection, episodes, steps.
//!
//! There are three layers, and a program takes the highest one that does what it needs:
//!
//! | layer | what it is | start with |
//! |---|---|---|
//! | connection | what a server is, whose token this is, phases, quotas, runs | [`Client`], [`ConnectOptions`], [`Run`] |
//! | episodes | the slots of a run, an episode after the other, step by step | [`Play`], [`Episode`], [`Episodes`] |
//! | agents | a type that chooses; who plays it is no longer its business | [`Agent`], [`evaluate`] |
//!
//! # Agents
//!
//! What implements [`Agent`] needs no loop of its own: [`evaluate`] plays it, and [`evaluate_slots`] several at the same time.
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
//! # Episodes
//!
//! A program with a loop of its own asks for episodes and takes steps. [`Play::episodes`] gives the same as a stream whose
//! episodes borrow nothing, so that they can be sent to other tasks.
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
//! [`Client::play_slots`] opens several slots, each of which is driven by a task of its own (`examples/slots.rs`).
//!
//! # Connection
//!
//! ```no_run
//! use avln_client::{Client, ConnectOptions, Error};
//! use std::time::Duration;
//!
//! # #[tokio::main]
//! # async fn main() -> Result<(), Error> {
//! let options = ConnectOptions { ca: Some("authority.pem".into()), patience: Some(Duration::from_secs(600)), ..ConnectOptions::default() };
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
//! # What breaks
//!
//! - A stream that is lost is dialled again, and every open episode goes on at the step that it was at: [`Episode::step`]
//!   takes longer, and nothing else is seen of it. [`ConnectOptions::patience`] says for how long.
//! - A call whose answer was lost is made again for some seconds; a run that was asked for twice is begun once.
//! - What the server refuses is an [`Error::Refused`] with its [`Reason`]; [`Error::Lost`] says that patience was over. Errors
//!   tell what was attempted and what to do next.
//! - An episode that the server's fault ended is over, with [`EndReason::ServerFault`], and does not count; the run goes on.
//!
//! # Threads
//!
//! A runtime of one thread (`#[tokio::main(flavor = "current_thread")]`) spares a step in lock-step the way from thread to thread.
//! It suits agents that choose in less than some seconds: while they think nothing answers the server's pings.
//!
//! *Never*: shows a generated message; knows a target, a place or a score that the server hides; links the simulator.

mod action;
mod agent;
mod backoff;
mod calls;
mod client;
mod connect_options;
mod connection;
mod episode;
mod episodes;
mod error;
mod mission;
mod observation;
mod packing;
mod play;
mod resend_buffer;
mod service;
mod summary;
mod task;
mod welcome;

pub use action::{Action, EndReason, Order, UnknownOrder};
pub use agent::{Agent, evaluate, evaluate_slots, evaluate_with};
pub use avln_proto::v1::Reason;
pub use client::Client;
pub use connect_options::ConnectOptions;
pub use episode::{Episode, TimeLeft};
pub use episodes::Episodes;
pub use error::Error;
pub use mission::{GoalCue, Image, Mission, RgbImage};
pub use observation::{Audio, DepthImage, Feedback, Observation, Pose};
pub use packing::Packing;
pub use play::Play;
pub use service::{
    Account, Phase, PhaseState, Quota, QuotaWindow, Run, RunOptions, RunState, RunStatus, RunWatch,
    ServerInfo,
};
pub use summary::{EpisodeEnd, Metric, Notice, Progress, RunSummary};
pub use task::{
    DepthNoise, DistanceRule, FeedbackRule, PoseFrame, RgbNoise, Sensors, SoundClip, SoundingRule, TaskSpec,
    WrongSubmit,
};
