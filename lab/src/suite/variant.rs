//! The suite's agents.

use super::{hints::TrueHints, oracle::ShortestPath};
use avln_arena::{Failure, FailureKind};
use avln_baselines::{Baseline, RandomAgent};
use avln_client::{Action, Agent, Mission, Observation, Sensors, TaskSpec};
use avln_kit::perception::{ClassicalRecognition, HintRecognition};
use avln_pag_nav::{Ablation, PagNav, Recorder};
use clap::ValueEnum;
use std::{path::Path, sync::Arc};

/// The suite's agents, in table order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub enum AgentVariant {
    /// Walks at random.
    Random,
    /// Walks forward and turns at obstacles.
    ForwardAndTurn,
    /// Explores the nearest unseen area.
    Frontier,
    /// Follows sound; blind.
    SoundFollower,
    /// Explores until it sees a goal's category; deaf.
    Detector,
    /// Remembers a few views of all objects; deaf.
    Snapshot,
    /// PAG-Nav.
    PagNav,
    /// PAG-Nav without hearing.
    PagNavNoAudio,
    /// PAG-Nav without room and object priors.
    PagNavNoPriors,
    /// PAG-Nav without a memory for objects out of view.
    PagNavNoMemory,
    /// PAG-Nav without verification before a Submit.
    PagNavNoGate,
    /// PAG-Nav with depth and colours instead of the perception network.
    PagNavNoNetwork,
    /// PAG-Nav with true sound directions; privileged.
    PagNavTrueSounds,
    /// PAG-Nav with true visible targets; privileged.
    PagNavTrueSight,
    /// Walks the reference tour; privileged.
    ShortestPath,
}

impl AgentVariant {
    /// All variants.
    pub const ALL: [Self; 15] = [
        Self::Random,
        Self::ForwardAndTurn,
        Self::Frontier,
        Self::SoundFollower,
        Self::Detector,
        Self::Snapshot,
        Self::PagNav,
        Self::PagNavNoAudio,
        Self::PagNavNoPriors,
        Self::PagNavNoMemory,
        Self::PagNavNoGate,
        Self::PagNavNoNetwork,
        Self::PagNavTrueSounds,
        Self::PagNavTrueSight,
        Self::ShortestPath,
    ];

    /// Returns the name in tables, files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Random => "random",
            Self::PagNav => "pag-nav",
            Self::PagNavNoAudio => "pag-nav-no-audio",
            Self::PagNavNoPriors => "pag-nav-no-priors",
            Self::PagNavNoMemory => "pag-nav-no-memory",
            Self::PagNavNoGate => "pag-nav-no-gate",
            Self::PagNavNoNetwork => "pag-nav-no-network",
            Self::PagNavTrueSounds => "pag-nav-true-sounds",
            Self::PagNavTrueSight => "pag-nav-true-sight",
            Self::ShortestPath => "shortest-path",
            Self::ForwardAndTurn | Self::Frontier | Self::SoundFollower | Self::Detector | Self::Snapshot => {
                self.baseline().map_or("", Baseline::name)
            }
        }
    }

    /// Returns the variant with a name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|variant| variant.name() == name)
    }

    /// Returns `true` if the variant receives ground truth.
    pub fn is_privileged(self) -> bool {
        matches!(self, Self::PagNavTrueSounds | Self::PagNavTrueSight | Self::ShortestPath)
    }

    /// Returns `true` for PAG-Nav's ablations.
    pub fn is_variant(self) -> bool {
        self.name().starts_with("pag-nav-")
    }

    /// Returns `true` if the variant uses sound.
    pub fn hears(self) -> bool {
        match self.baseline() {
            Some(baseline) => baseline.hears(),
            None => !matches!(self, Self::Random | Self::PagNavNoAudio | Self::ShortestPath),
        }
    }

    /// Returns the requested sensors, with images of `side` pixels.
    pub(super) fn sensors(self, side: u32) -> Sensors {
        let all = Sensors::square(side);
        match (self, self.baseline()) {
            (_, Some(baseline)) => baseline.sensors(side),
            (Self::Random | Self::ShortestPath, _) => {
                Sensors { rgb: false, depth: false, audio: false, ..all }
            }
            _ => Sensors { audio: self.hears(), ..all },
        }
    }

    /// Creates the agent for one episode. PAG-Nav and its unprivileged variants write a trace into `folder`.
    pub(super) fn agent(
        self,
        seed: u64,
        hints: &Arc<TrueHints>,
        folder: Option<&Path>,
    ) -> Result<Box<dyn Agent + Send>, Failure> {
        if let Some(agent) = self.pag_nav(hints) {
            let untraced = |error| Failure::new(FailureKind::Data, error);
            // A privileged agent's trace would publish ground truth.
            let folder = folder.filter(|_| !self.is_privileged());
            let trace = folder.map(Recorder::new).transpose().map_err(untraced)?;
            return Ok(match trace {
                Some(trace) => Box::new(Traced(agent.traced(trace))),
                None => Box::new(agent),
            });
        }
        Ok(match self {
            Self::ShortestPath => Box::new(ShortestPath::new(hints.clone())),
            _ => self.baseline().map_or_else(|| Box::new(RandomAgent::new(seed)) as Box<_>, Baseline::agent),
        })
    }

    /// Creates PAG-Nav or an ablation.
    fn pag_nav(self, hints: &Arc<TrueHints>) -> Option<PagNav> {
        let agent = PagNav::default;
        let none = Ablation::default();
        Some(match self {
            Self::PagNav => agent(),
            Self::PagNavNoAudio => agent().without(Ablation { no_audio: true, ..none }),
            Self::PagNavNoPriors => agent().without(Ablation { no_priors: true, ..none }),
            Self::PagNavNoMemory => agent().without(Ablation { no_memory: true, ..none }),
            Self::PagNavNoGate => agent().without(Ablation { no_gate: true, ..none }),
            Self::PagNavNoNetwork => agent().seeing(ClassicalRecognition::default()),
            Self::PagNavTrueSounds => agent().hinted(hints.clone()),
            Self::PagNavTrueSight => agent().seeing(HintRecognition::new(hints.clone())),
            _ => return None,
        })
    }

    fn baseline(self) -> Option<Baseline> {
        match self {
            Self::ForwardAndTurn => Some(Baseline::ForwardAndTurn),
            Self::Frontier => Some(Baseline::Frontier),
            Self::SoundFollower => Some(Baseline::SoundFollower),
            Self::Detector => Some(Baseline::Detector),
            Self::Snapshot => Some(Baseline::Snapshot),
            _ => None,
        }
    }
}

/// An agent for one episode that completes its trace when dropped.
struct Traced(PagNav);

impl Agent for Traced {
    fn enter(&mut self, episode: &str) {
        self.0.enter(episode);
    }

    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        self.0.begin(task, mission);
    }

    fn act(&mut self, observation: &Observation) -> Action {
        self.0.act(observation)
    }
}

impl Drop for Traced {
    fn drop(&mut self) {
        if let Err(error) = self.0.end_trace() {
            eprintln!("{error}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_variant_has_its_command_line_name() {
        let values: Vec<_> =
            AgentVariant::value_variants().iter().filter_map(ValueEnum::to_possible_value).collect();
        let names: Vec<_> = values.iter().map(|value| value.get_name().to_owned()).collect();
        assert_eq!(names, AgentVariant::ALL.map(|variant| variant.name().to_owned()));
        assert_eq!(AgentVariant::named("pag-nav-no-gate"), Some(AgentVariant::PagNavNoGate));
    }
}
