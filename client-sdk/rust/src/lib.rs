//! The Rust client of LH-AVLN Arena: connection, episodes, steps.
//!
//! Start reading at [`Arena`], [`Play`], [`Episode`] and [`Agent`].
//!
//! ```no_run
//! use avln_client::{Action, Arena, Error, Order, RunOptions, Sensors};
//!
//! # #[tokio::main]
//! # async fn main() -> Result<(), Error> {
//! let arena = Arena::connect("http://127.0.0.1:50051", "my-account-token").await?;
//! let run = arena.start_run(RunOptions::new("practice", "my-method").order(Order::Unordered)).await?;
//! let mut play = arena.play(&run, Sensors::default()).await?;
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
//! A runtime of one thread (`#[tokio::main(flavor = "current_thread")]`) spares a step in lock-step the way from thread to thread.
//! It suits agents that choose in less than some seconds: while they think nothing answers the server's pings.
//!
//! An agent that implements [`Agent`] needs no loop of its own: [`evaluate`] plays it, and [`evaluate_slots`] several at the same
//! time, on the slots of [`Arena::play_slots`].
//!
//! *Never*: shows a generated message; knows a target, a place or a score that the server hides; links the simulator.

mod action;
mod agent;
mod arena;
mod episode;
mod error;
mod ledger;
mod line;
mod link;
mod mission;
mod observation;
mod packing;
mod play;
mod service;
mod summary;
mod task;
mod welcome;

pub use action::{Action, EndReason, Order, UnknownOrder};
pub use agent::{Agent, evaluate, evaluate_slots, evaluate_with};
pub use arena::Arena;
pub use avln_proto::v1::Reason;
pub use episode::{Episode, TimeLeft};
pub use error::Error;
pub use link::Link;
pub use mission::{GoalCue, Image, Mission, RgbImage};
pub use observation::{Audio, DepthImage, Feedback, Observation, Pose};
pub use packing::Packing;
pub use play::Play;
pub use service::{
    Account, Phase, PhaseState, Quota, Run, RunOptions, RunState, RunStatus, RunWatch, ServerInfo, Window,
};
pub use summary::{EpisodeEnd, Metric, Notice, Progress, RunSummary};
pub use task::{
    DepthNoise, DistanceRule, FeedbackRule, PoseFrame, RgbNoise, Sensors, SoundClip, SoundingRule, TaskSpec,
    WrongSubmit,
};
