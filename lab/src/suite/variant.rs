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
    /// Remembers a few views that cover all objects; deaf.
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
    /// Returns the name in tables, files and on the command line.
    pub fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
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

    /// Creates the agent for one episode. PAG-Nav and unprivileged ablations write a trace into `folder`.
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
        Baseline::ALL.into_iter().find(|baseline| baseline.name() == self.name())
    }
}

/// An agent for one episode; dropping it completes the trace.
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
    fn names_are_those_of_published_results() {
        let names: Vec<String> =
            AgentVariant::value_variants().iter().map(|variant| variant.name()).collect();
        let published = "random forward-and-turn frontier sound-follower detector snapshot pag-nav \
             pag-nav-no-audio pag-nav-no-priors pag-nav-no-memory pag-nav-no-gate pag-nav-no-network \
             pag-nav-true-sounds pag-nav-true-sight shortest-path";
        assert_eq!(names.join(" "), published);
        let baselines = AgentVariant::value_variants().iter().filter_map(|variant| variant.baseline());
        assert_eq!(baselines.collect::<Vec<_>>(), Baseline::ALL);
    }
}
