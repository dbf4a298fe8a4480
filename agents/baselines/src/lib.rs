//! Simple agents for comparison, built from the parts of `avln-kit`, and the random agent.
//!
//! Start reading at [`Baseline`] and [`RandomAgent`]. No agent here reimplements a published method.
//!
//! This crate never links a server crate other than `avln-simd` or uses information beyond observations.

mod unguided;
mod visual;

pub use unguided::{ForwardAndTurn, Frontier, RandomAgent, SoundFollower};
pub use visual::{Detector, Snapshot};

use avln_client::{Agent, Error, MethodType, RunSummary, Sensors, evaluate_with};
use avln_kit::run::{AgentArgs, Method, OnEnd, RunArgs, play};
use clap::{Args, ValueEnum};

/// The simple agents that `avln agent baseline` offers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub enum Baseline {
    /// Walks ahead and turns at obstacles; senses only the pose.
    ForwardAndTurn,
    /// Walks to the nearest unseen area; ignores goals.
    Frontier,
    /// Walks to sounds and submits there; does not see.
    SoundFollower,
    /// Explores until it sees an object of a goal's category, and submits there; does not hear.
    Detector,
    /// Remembers a few views that cover all objects, and weighs them against frontiers; does not hear.
    Snapshot,
}

impl Baseline {
    /// All baselines.
    pub const ALL: [Self; 5] =
        [Self::ForwardAndTurn, Self::Frontier, Self::SoundFollower, Self::Detector, Self::Snapshot];

    /// Returns the name on leaderboards and the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::ForwardAndTurn => "forward-and-turn",
            Self::Frontier => "frontier",
            Self::SoundFollower => "sound-follower",
            Self::Detector => "detector",
            Self::Snapshot => "snapshot",
        }
    }

    /// Returns the method type.
    pub fn method_type(self) -> MethodType {
        match self {
            Self::ForwardAndTurn | Self::Frontier | Self::SoundFollower => MethodType::TrainingFree,
            // Both see with the bundled network.
            Self::Detector | Self::Snapshot => MethodType::LearntPerception,
        }
    }

    /// Creates an agent of this kind.
    pub fn agent(self) -> Box<dyn Agent + Send> {
        match self {
            Self::ForwardAndTurn => Box::<ForwardAndTurn>::default(),
            Self::Frontier => Box::<Frontier>::default(),
            Self::SoundFollower => Box::<SoundFollower>::default(),
            Self::Detector => Box::<Detector>::default(),
            Self::Snapshot => Box::<Snapshot>::default(),
        }
    }

    /// Returns the required sensors, with images at `side` pixels.
    pub fn sensors(self, side: u32) -> Sensors {
        let sees = !matches!(self, Self::ForwardAndTurn | Self::SoundFollower);
        let rgb = matches!(self, Self::Detector | Self::Snapshot);
        Sensors { rgb, depth: sees, audio: self.hears(), ..Sensors::square(side) }
    }

    /// Returns true if the agent uses audio.
    pub fn hears(self) -> bool {
        self == Self::SoundFollower
    }
}

/// Command-line arguments of the simple agents.
#[derive(Args, Clone, Debug)]
pub struct BaselineArgs {
    /// Agent to run
    #[arg(value_enum, value_name = "NAME")]
    pub agent: Baseline,
    /// Run, image size and slots.
    #[command(flatten)]
    pub run: AgentArgs,
}

/// Plays one run with a simple agent; fails like [`avln_client::evaluate`] and [`RunArgs::begin`].
pub async fn run(args: BaselineArgs) -> Result<RunSummary, Error> {
    run_with(args, &mut |_| {}).await
}

/// Plays one run with a simple agent like [`run`], and calls `on_end` after each episode.
pub async fn run_with(args: BaselineArgs, on_end: OnEnd<'_>) -> Result<RunSummary, Error> {
    let BaselineArgs { agent, run } = args;
    let sensors = agent.sensors(run.size);
    let method = Method {
        name: agent.name().to_owned(),
        version: env!("CARGO_PKG_VERSION"),
        method_type: agent.method_type(),
        sensors,
    };
    let mut agents = run.agents(|| Ok::<_, Error>(agent.agent()))?;
    play(run, method, &mut agents, on_end).await
}

/// Command-line arguments of the random agent.
#[derive(Args, Clone, Debug)]
pub struct RandomArgs {
    /// The run.
    #[command(flatten)]
    pub run: RunArgs,
    /// Seed of the agent's choices
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Side of the images in pixels, 64 to 1024
    #[arg(long, default_value_t = 128, value_name = "PIXELS")]
    pub size: u32,
}

/// Plays one run with [`RandomAgent`]; fails like [`avln_client::evaluate`] and [`RunArgs::begin`].
pub async fn run_random(args: RandomArgs) -> Result<RunSummary, Error> {
    run_random_with(args, &mut |_| {}).await
}

/// Plays one run with [`RandomAgent`] like [`run_random`], and calls `on_end` after each episode.
pub async fn run_random_with(args: RandomArgs, on_end: OnEnd<'_>) -> Result<RunSummary, Error> {
    let method_type = Some(MethodType::TrainingFree);
    let (arena, run) = args.run.begin("random", env!("CARGO_PKG_VERSION"), method_type).await?;
    let mut agent = RandomAgent::new(args.seed);
    evaluate_with(&arena, &run, Sensors::square(args.size), &mut agent, on_end).await
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_match_the_command_line() {
        for baseline in Baseline::ALL {
            assert_eq!(Baseline::from_str(baseline.name(), false), Ok(baseline));
        }
    }
}
