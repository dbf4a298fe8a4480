//! The suite's agents.

use super::{hints::TrueHints, oracle::ShortestPath};
use avln_arena::{Failure, FailureKind};
use avln_baselines::{Baseline, RandomAgent};
use avln_client::{Action, Agent, MethodType, Mission, Observation, Sensors, TaskSpec};
use avln_kit::onnx::{OnnxRecognition, SharedFailure};
use avln_kit::perception::{ClassicalRecognition, HintRecognition};
use avln_pag_nav::{Ablation, PagNav, Preset, Recorder, Switch, Switches, Weights};
use clap::ValueEnum;
use std::{path::Path, sync::Arc};

/// The suite's agents, in playing and table order: the most important first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub enum AgentVariant {
    /// Walks at random.
    Random,
    /// Walks the reference tour; privileged.
    ShortestPath,
    /// Follows sound; blind.
    SoundFollower,
    /// PAG-Nav, with the formulas of the paper.
    PagNav,
    /// PAG-Nav with all extensions and other weights.
    PagNavPlus,
    /// PAG-Nav+ without hearing.
    PagNavPlusNoAudio,
    /// PAG-Nav+ with outcomes by sound, but no search by sound.
    PagNavPlusNoSearchSound,
    /// PAG-Nav+ with search by sound, but no outcomes by sound.
    PagNavPlusNoOutcomes,
    /// PAG-Nav+ without visual verification before a Submit.
    PagNavPlusNoGate,
    /// PAG-Nav+ without a memory for objects out of view.
    PagNavPlusNoObjectMemory,
    /// PAG-Nav+ that verifies with a single look, as without object memory.
    PagNavPlusNoSecondLook,
    /// PAG-Nav+ without a memory for earlier sounds.
    PagNavPlusNoAcousticMemory,
    /// PAG-Nav+ without an accumulated map.
    PagNavPlusNoMap,
    /// PAG-Nav+ without room and object priors.
    PagNavPlusNoPriors,
    /// PAG-Nav without a network: depth and colours; training-free.
    PagNavClassical,
    /// PAG-Nav with the user's ONNX models instead of the network; needs `--models`.
    PagNavModels,
    /// PAG-Nav without hearing.
    PagNavNoAudio,
    /// PAG-Nav without visual verification before a Submit.
    PagNavNoGate,
    /// PAG-Nav without a memory for objects out of view.
    PagNavNoObjectMemory,
    /// PAG-Nav without sound in search and grounding.
    PagNavNoSearchSound,
    /// Explores until it sees a goal's category; deaf.
    Detector,
    /// Remembers a few views that cover all objects; deaf.
    Snapshot,
    /// Explores the nearest unseen area.
    Frontier,
    /// Walks forward and turns at obstacles.
    ForwardAndTurn,
    /// PAG-Nav+ without a network: depth and colours.
    PagNavPlusNoNetwork,
    /// PAG-Nav+ without estimated source positions, and without the extensions that need them.
    PagNavPlusNoPositions,
    /// PAG-Nav+ without counted sounding windows, and without the extensions that need them.
    PagNavPlusNoWindows,
    /// PAG-Nav+ without direct approaches to estimated sources.
    PagNavPlusNoDirect,
    /// PAG-Nav+ without joint association of sounds and goals.
    PagNavPlusNoAssociation,
    /// PAG-Nav+ without stairs.
    PagNavPlusNoStairs,
    /// PAG-Nav+ without a lower visual floor at located sources.
    PagNavPlusNoHeardFloor,
    /// PAG-Nav+ without any extension: PAG-Nav with the weights of PAG-Nav+.
    PagNavPlusNoExtensions,
    /// PAG-Nav+ with true sound positions; privileged.
    PagNavPlusTrueSounds,
    /// PAG-Nav+ with true visible targets; privileged.
    PagNavPlusTrueSight,
    /// PAG-Nav+ with true visible targets, without a memory for objects out of view; privileged.
    PagNavPlusTrueSightNoObjectMemory,
    /// PAG-Nav+ with true visible targets and outcomes by sound, but no search by sound; privileged.
    PagNavPlusTrueSightNoSearchSound,
}

/// Inputs for the agent of one episode.
pub(super) struct AgentSetup<'a> {
    /// Seed of the random agent.
    pub(super) seed: u64,
    /// Ground truth for privileged variants.
    pub(super) hints: &'a Arc<TrueHints>,
    /// ONNX models, for `pag-nav-models`.
    pub(super) models: Option<&'a Path>,
    /// Folder for a trace of PAG-Nav or an unprivileged variant.
    pub(super) traces: Option<&'a Path>,
}

/// An agent for one episode.
pub(super) struct EpisodeAgent {
    pub(super) agent: Box<dyn Agent + Send>,
    /// First failure of the models, if it uses any.
    pub(super) failure: Option<SharedFailure>,
}

/// A removed part of PAG-Nav.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Removed {
    Part(Ablation),
    Switch(Switch),
    /// The lower visual floor at a located source.
    HeardFloor,
    /// All switches.
    Extensions,
    Network,
}

impl AgentVariant {
    /// Returns the name in tables, files and on the command line.
    pub fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }

    /// Returns `true` if the variant receives ground truth.
    pub fn is_privileged(self) -> bool {
        self.has_true_sight() || matches!(self, Self::PagNavPlusTrueSounds | Self::ShortestPath)
    }

    /// Returns `true` if the variant receives the visible targets instead of recognising objects.
    fn has_true_sight(self) -> bool {
        self.name().starts_with("pag-nav-plus-true-sight")
    }

    /// Returns `true` for PAG-Nav's ablations and privileged variants.
    pub fn is_variant(self) -> bool {
        self.whole().is_some()
    }

    /// Returns the complete agent of an ablation or privileged variant; `None` for other agents.
    pub fn whole(self) -> Option<Self> {
        let name = self.name();
        if matches!(self, Self::PagNav | Self::PagNavPlus | Self::PagNavClassical | Self::PagNavModels) {
            None
        } else if name.starts_with("pag-nav-plus-true-sight-") {
            Some(Self::PagNavPlusTrueSight)
        } else if name.starts_with("pag-nav-plus-") {
            Some(Self::PagNavPlus)
        } else {
            name.starts_with("pag-nav-").then_some(Self::PagNav)
        }
    }

    /// Returns the type of the method.
    pub fn method_type(self) -> MethodType {
        match self {
            _ if self.has_true_sight() => MethodType::TrainingFree,
            Self::Random
            | Self::ForwardAndTurn
            | Self::Frontier
            | Self::SoundFollower
            | Self::ShortestPath
            | Self::PagNavClassical
            | Self::PagNavPlusNoNetwork => MethodType::TrainingFree,
            Self::PagNavModels => MethodType::FoundationModels,
            _ => MethodType::LearntPerception,
        }
    }

    /// Returns `true` if the variant uses sound.
    pub fn hears(self) -> bool {
        match self.baseline() {
            Some(baseline) => baseline.hears(),
            None => {
                let deaf = [Self::Random, Self::ShortestPath, Self::PagNavNoAudio, Self::PagNavPlusNoAudio];
                !deaf.contains(&self)
            }
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

    /// Creates the agent for one episode; fails if its models or its trace cannot be opened.
    pub(super) fn agent(self, setup: &AgentSetup) -> Result<EpisodeAgent, Failure> {
        let Some(agent) = self.pag_nav(setup.hints) else {
            let agent: Box<dyn Agent + Send> = match self {
                Self::ShortestPath => Box::new(ShortestPath::new(setup.hints.clone())),
                _ => self
                    .baseline()
                    .map_or_else(|| Box::new(RandomAgent::new(setup.seed)) as _, Baseline::agent),
            };
            return Ok(EpisodeAgent { agent, failure: None });
        };
        let (agent, failure) = match self {
            Self::PagNavModels => {
                let models = open_models(setup.models)?;
                let failure = models.failure();
                (agent.seeing(models), Some(failure))
            }
            _ => (agent, None),
        };
        // A privileged agent's trace would publish ground truth.
        let folder = setup.traces.filter(|_| !self.is_privileged());
        let trace = folder.map(Recorder::new).transpose();
        let agent: Box<dyn Agent + Send> =
            match trace.map_err(|error| Failure::new(FailureKind::Data, error))? {
                Some(trace) => Box::new(Traced(agent.traced(trace))),
                None => Box::new(agent),
            };
        Ok(EpisodeAgent { agent, failure })
    }

    /// Creates PAG-Nav or a variant.
    fn pag_nav(self, hints: &Arc<TrueHints>) -> Option<PagNav> {
        let whole = self.whole().unwrap_or(self);
        let preset = match whole {
            Self::PagNav | Self::PagNavClassical | Self::PagNavModels => Preset::PagNav,
            Self::PagNavPlus | Self::PagNavPlusTrueSight => Preset::PagNavPlus,
            _ => return None,
        };
        let agent = match self.removed() {
            None => PagNav::preset(preset),
            Some(Removed::Part(ablation)) => PagNav::preset(preset).without(ablation),
            Some(Removed::Network) => PagNav::preset(preset).seeing(ClassicalRecognition::default()),
            Some(Removed::HeardFloor) => {
                let weights = preset.weights();
                PagNav::new(Weights { verify_floor: weights.verify_unheard, ..weights })
            }
            Some(Removed::Extensions) => {
                PagNav::new(Weights { switches: Switches::default(), ..preset.weights() })
            }
            Some(Removed::Switch(switch)) => {
                let weights = preset.weights();
                PagNav::new(Weights { switches: weights.switches.without(switch), ..weights })
            }
        };
        Some(match self {
            Self::PagNavPlusTrueSounds => agent.hinted(hints.clone()),
            _ if self.has_true_sight() => agent.seeing(HintRecognition::new(hints.clone())),
            _ => agent,
        })
    }

    /// Returns the part that an ablation removes.
    fn removed(self) -> Option<Removed> {
        let none = Ablation::default();
        let part = |ablation| Some(Removed::Part(ablation));
        match self {
            Self::PagNavNoAudio | Self::PagNavPlusNoAudio => part(Ablation { no_audio: true, ..none }),
            Self::PagNavNoSearchSound
            | Self::PagNavPlusNoSearchSound
            | Self::PagNavPlusTrueSightNoSearchSound => part(Ablation { no_search_sound: true, ..none }),
            Self::PagNavPlusNoOutcomes => part(Ablation { no_outcomes: true, ..none }),
            Self::PagNavNoObjectMemory
            | Self::PagNavPlusNoObjectMemory
            | Self::PagNavPlusTrueSightNoObjectMemory => part(Ablation { no_object_memory: true, ..none }),
            Self::PagNavPlusNoSecondLook => part(Ablation { no_second_look: true, ..none }),
            Self::PagNavPlusNoAcousticMemory => part(Ablation { no_acoustic_memory: true, ..none }),
            Self::PagNavPlusNoMap => part(Ablation { no_map: true, ..none }),
            Self::PagNavPlusNoPriors => part(Ablation { no_priors: true, ..none }),
            Self::PagNavNoGate | Self::PagNavPlusNoGate => part(Ablation { no_gate: true, ..none }),
            Self::PagNavClassical | Self::PagNavPlusNoNetwork => Some(Removed::Network),
            Self::PagNavPlusNoPositions => Some(Removed::Switch(Switch::SourcePositions)),
            Self::PagNavPlusNoWindows => Some(Removed::Switch(Switch::CountWindows)),
            Self::PagNavPlusNoDirect => Some(Removed::Switch(Switch::DirectApproach)),
            Self::PagNavPlusNoAssociation => Some(Removed::Switch(Switch::JointAssociation)),
            Self::PagNavPlusNoStairs => Some(Removed::Switch(Switch::Stairs)),
            Self::PagNavPlusNoHeardFloor => Some(Removed::HeardFloor),
            Self::PagNavPlusNoExtensions => Some(Removed::Extensions),
            _ => None,
        }
    }

    fn baseline(self) -> Option<Baseline> {
        Baseline::ALL.into_iter().find(|baseline| baseline.name() == self.name())
    }
}

fn open_models(file: Option<&Path>) -> Result<OnnxRecognition, Failure> {
    let missing =
        || Failure::data("the row pag-nav-models has no models").hinted("name them with --models FILE");
    let file = file.ok_or_else(missing)?;
    OnnxRecognition::load(file).map_err(|error| Failure::new(FailureKind::Data, error))
}

/// PAG-Nav for one episode; dropping it completes the trace.
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
        let published = "random shortest-path sound-follower pag-nav pag-nav-plus pag-nav-plus-no-audio \
             pag-nav-plus-no-search-sound pag-nav-plus-no-outcomes pag-nav-plus-no-gate \
             pag-nav-plus-no-object-memory pag-nav-plus-no-second-look pag-nav-plus-no-acoustic-memory \
             pag-nav-plus-no-map pag-nav-plus-no-priors pag-nav-classical pag-nav-models pag-nav-no-audio pag-nav-no-gate \
             pag-nav-no-object-memory pag-nav-no-search-sound detector snapshot frontier forward-and-turn \
             pag-nav-plus-no-network pag-nav-plus-no-positions pag-nav-plus-no-windows \
             pag-nav-plus-no-direct pag-nav-plus-no-association pag-nav-plus-no-stairs \
             pag-nav-plus-no-heard-floor pag-nav-plus-no-extensions pag-nav-plus-true-sounds pag-nav-plus-true-sight \
             pag-nav-plus-true-sight-no-object-memory pag-nav-plus-true-sight-no-search-sound";
        assert_eq!(names.join(" "), published);
        let mut baselines: Vec<Baseline> =
            AgentVariant::value_variants().iter().filter_map(|variant| variant.baseline()).collect();
        baselines.sort();
        assert_eq!(baselines, Baseline::ALL);
    }

    #[test]
    fn ablations_remove_a_part_each() {
        let mut removed = Vec::new();
        for &variant in AgentVariant::value_variants() {
            let is_ablation = variant.name().contains("-no-") || variant == AgentVariant::PagNavClassical;
            assert_eq!(variant.removed().is_some(), is_ablation, "{}", variant.name());
            if let Some(part) =
                variant.removed().filter(|_| variant.whole() == Some(AgentVariant::PagNavPlus))
            {
                assert!(!removed.contains(&part), "{}", variant.name());
                removed.push(part);
            }
        }
        assert_eq!(AgentVariant::PagNavNoGate.whole(), Some(AgentVariant::PagNav));
        assert_eq!((AgentVariant::PagNavPlus.whole(), AgentVariant::Detector.whole()), (None, None));
    }

    #[test]
    fn method_types_follow_perception() {
        assert_eq!(AgentVariant::PagNavModels.method_type(), MethodType::FoundationModels);
        for variant in [AgentVariant::PagNav, AgentVariant::PagNavPlusNoGate, AgentVariant::Detector] {
            assert_eq!(variant.method_type(), MethodType::LearntPerception, "{}", variant.name());
        }
        for variant in [AgentVariant::PagNavClassical, AgentVariant::SoundFollower, AgentVariant::Random] {
            assert_eq!(variant.method_type(), MethodType::TrainingFree, "{}", variant.name());
        }
    }
}
