//! The suite's results: a JSON line per finished episode.

use super::hints::claimable;
use crate::internal;
use avln_arena::{Failure, FailureKind};
use avln_episode::{Action, EndReason, Modality, Order, Rules};
use avln_scoring::Metrics;
use avln_truth::{EpisodeTruth, Record, SubmitFacts};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

/// A result's key.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct EpisodeKey {
    /// [`AgentVariant::name`](super::AgentVariant::name).
    pub agent: String,
    /// `ordered` or `unordered`.
    pub order: String,
    /// Episode id in the split.
    pub episode: String,
    /// Random agents' seed.
    pub seed: u64,
    /// Program version; includes the agents.
    pub program: String,
    /// Benchmark version.
    pub benchmark: String,
    /// Split digest.
    pub split: String,
    /// Track, see [`Track::label`](super::Track::label); empty in results of earlier versions.
    #[serde(default)]
    pub track: String,
    /// Rule set name.
    #[serde(default)]
    pub rules: String,
    /// Feedback to Submits.
    #[serde(default)]
    pub feedback: String,
    /// Image side, pixels.
    #[serde(default)]
    pub side_px: u32,
    /// Seed of the split's houses and missions; `None` for the recipe's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub split_seed: Option<u64>,
}

/// Facts about a mission and its house.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MissionFacts {
    /// Reference steps in the played order.
    pub reference_steps: u32,
    /// Storeys of the house.
    pub storeys: u32,
    /// Walkable area of the house, square metres.
    pub area_m2: f64,
}

/// An episode's result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResultLine {
    /// Key.
    pub key: EpisodeKey,
    /// Scene name.
    pub scene: String,
    /// Mission and house.
    #[serde(default)]
    pub mission: MissionFacts,
    /// Modality by goal.
    pub modalities: Vec<Modality>,
    /// End reason.
    pub end: EndReason,
    /// Metrics.
    pub metrics: Metrics,
    /// Submits without completion, by cause.
    pub wrong: BTreeMap<Cause, u32>,
    /// Mean time to choose an action, milliseconds.
    pub think_ms: f64,
    /// Episode duration, seconds.
    pub wall_s: f64,
}

impl ResultLine {
    /// Returns the goal order.
    pub fn order(&self) -> Order {
        self.key.order.parse().unwrap_or(Order::Ordered)
    }
}

/// The results file.
pub struct Results {
    path: PathBuf,
    file: File,
    /// Results by key; the last line counts.
    lines: BTreeMap<EpisodeKey, ResultLine>,
}

impl Results {
    /// Opens or creates the file.
    ///
    /// # Errors
    /// If the file cannot be read or written, or a line is malformed.
    pub fn open(path: &Path) -> Result<Self, Failure> {
        let cannot = |error: std::io::Error| {
            Failure::new(FailureKind::Data, format!("cannot open results {}: {error}", path.display()))
        };
        let mut file = OpenOptions::new().create(true).read(true).append(true).open(path).map_err(cannot)?;
        let mut text = String::new();
        file.read_to_string(&mut text).map_err(cannot)?;
        // A killed process may leave half a line; that episode is repeated.
        let complete = complete_lines(&text);
        file.set_len(complete.len() as u64).map_err(cannot)?;
        let lines = parse(path, complete)?;
        Ok(Self { path: path.to_owned(), file, lines })
    }

    /// Appends a result.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn add(&mut self, line: ResultLine) -> Result<(), Failure> {
        let json = serde_json::to_string(&line).map_err(internal)?;
        self.file.write_all((json + "\n").as_bytes()).map_err(|error| {
            Failure::new(FailureKind::Data, format!("cannot write {}: {error}", self.path.display()))
        })?;
        self.lines.insert(line.key.clone(), line);
        Ok(())
    }

    /// Returns `true` if the key has a result.
    pub fn has(&self, key: &EpisodeKey) -> bool {
        self.lines.contains_key(key)
    }

    /// Returns a key's result.
    pub(super) fn get(&self, key: &EpisodeKey) -> Option<&ResultLine> {
        self.lines.get(key)
    }

    /// Returns all results, by key.
    pub fn lines(&self) -> impl Iterator<Item = &ResultLine> {
        self.lines.values()
    }
}

/// Reads all results; empty without a file.
///
/// # Errors
/// If the file cannot be read, or a line is malformed.
pub(super) fn read(path: &Path) -> Result<BTreeMap<EpisodeKey, ResultLine>, Failure> {
    match fs::read_to_string(path) {
        // Another process may be writing the last line.
        Ok(text) => parse(path, complete_lines(&text)),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(BTreeMap::new()),
        Err(error) => {
            Err(Failure::new(FailureKind::Data, format!("cannot read results {}: {error}", path.display())))
        }
    }
}

fn complete_lines(text: &str) -> &str {
    &text[..text.rfind('\n').map_or(0, |end| end + 1)]
}

fn parse(path: &Path, text: &str) -> Result<BTreeMap<EpisodeKey, ResultLine>, Failure> {
    let line = |(number, json): (usize, &str)| {
        let line: ResultLine = serde_json::from_str(json).map_err(|error| {
            let message = format!("{}, line {number}: {error}", path.display());
            Failure::new(FailureKind::Data, message).hinted("delete the line to repeat the episode")
        })?;
        Ok((line.key.clone(), line))
    };
    (1..).zip(text.lines()).map(line).collect()
}

/// Why a Submit completed no goal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// At a later goal's target in an ordered mission.
    WrongOrder,
    /// At a found target.
    FoundBefore,
    /// At another instance of a wanted category.
    WrongInstance,
    /// Within twice the success radius around a wanted target, outside the region.
    TooFar,
    /// Near no wanted object.
    WrongCategory,
}

impl Cause {
    /// All causes, in table order.
    pub const ALL: [Self; 5] =
        [Self::WrongInstance, Self::WrongCategory, Self::TooFar, Self::WrongOrder, Self::FoundBefore];

    /// Returns the column heading.
    pub fn words(self) -> &'static str {
        match self {
            Self::WrongOrder => "wrong order",
            Self::FoundBefore => "found before",
            Self::WrongInstance => "wrong instance",
            Self::TooFar => "too far",
            Self::WrongCategory => "wrong category",
        }
    }
}

/// Returns the causes for an episode's Submits without completion.
pub(super) fn causes(truth: &EpisodeTruth, record: &Record, rules: &Rules) -> Vec<Cause> {
    let mut found = vec![false; truth.targets.len()];
    let mut causes = Vec::new();
    for submit in &record.submits {
        match submit.completed.or(submit.skipped) {
            Some(goal) => {
                if let Some(found) = found.get_mut(usize::from(goal)) {
                    *found = true;
                }
            }
            None => causes.extend(cause(truth, record, rules, submit, &found)),
        }
    }
    causes
}

fn cause(
    truth: &EpisodeTruth,
    record: &Record,
    rules: &Rules,
    submit: &SubmitFacts,
    found: &[bool],
) -> Option<Cause> {
    let step = record.steps.get((submit.step as usize).checked_sub(1)?)?;
    // A Stop ends the episode: it is not a failed Submit.
    if step.action != Action::Submit {
        return None;
    }
    let is_in = |goal: &usize| step.in_region >> goal & 1 == 1;
    let (done, open): (Vec<usize>, Vec<usize>) = (0..found.len()).partition(|&goal| found[goal]);
    let mut eye = step.pose.position;
    eye.y += rules.camera_height_m;
    let is_close =
        |goal: &usize| truth.targets[*goal].bounds.distance_m(&eye) <= 2.0 * rules.success_radius_m;
    Some(if open.iter().any(is_in) {
        Cause::WrongOrder
    } else if done.iter().any(is_in) {
        Cause::FoundBefore
    } else if submit.wrong_instance.is_some() {
        Cause::WrongInstance
    } else if claimable(truth.order, &open).iter().any(is_close) {
        Cause::TooFar
    } else {
        Cause::WrongCategory
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_episode::Pose;
    use avln_geom::{Aabb, Point3};
    use avln_truth::{StepFacts, Target};

    fn target(x: f32) -> Target {
        let corner = |x| Point3::new(x, 0.5, 0.0);
        Target {
            instance: 1,
            category: "chair".to_owned(),
            modality: Modality::Category,
            bounds: Aabb::new(corner(x), corner(x + 1.0)),
            source: corner(x),
            floor_y_m: 0.0,
            region: vec![],
            viewpoints: vec![],
            start_distance_m: 1.0,
        }
    }

    /// Returns the causes for Submits: x, regions as bits, completed goal, and `true` at a wrong instance.
    fn of(submits: &[(f32, u8, Option<u8>, bool)]) -> Vec<Cause> {
        let truth = EpisodeTruth {
            episode: "e".to_owned(),
            scene: "s".to_owned(),
            seed: 1,
            start: Pose::new(Point3::origin(), 0.0),
            order: Order::Ordered,
            targets: vec![target(0.0), target(20.0)],
            distractor_sources: vec![],
            reference_m: 1.0,
            reference_path: vec![],
        };
        let step = |&(x, in_region, _, _): &(f32, u8, Option<u8>, bool)| StepFacts {
            action: Action::Submit,
            pose: Pose::new(Point3::new(x, 0.0, 0.0), 0.0),
            collided: false,
            in_region,
            sounding: None,
            state_hash: 0,
        };
        let facts = |(step, &(_, _, completed, wrong)): (u32, &(f32, u8, Option<u8>, bool))| SubmitFacts {
            step,
            completed,
            skipped: None,
            wrong_instance: wrong.then_some(0),
        };
        let record = Record {
            rules: "r".to_owned(),
            start: Pose::new(Point3::origin(), 0.0),
            steps: submits.iter().map(step).collect(),
            submits: (1..).zip(submits).map(facts).collect(),
            in_region_at_start: vec![false; 2],
            final_distance_m: vec![None; 2],
            end: EndReason::FinalSubmit,
        };
        causes(&truth, &record, &Rules::paper())
    }

    #[test]
    fn every_cause_follows_from_the_record() {
        assert_eq!(of(&[(20.0, 2, None, false)]), [Cause::WrongOrder]);
        assert_eq!(of(&[(0.0, 1, Some(0), false), (0.0, 1, None, false)]), [Cause::FoundBefore]);
        assert_eq!(of(&[(9.0, 0, None, true)]), [Cause::WrongInstance]);
        assert_eq!(
            of(&[(-3.5, 0, None, false), (9.0, 0, None, false)]),
            [Cause::TooFar, Cause::WrongCategory]
        );
    }
}

/// Results for tests.
#[cfg(test)]
pub(super) mod samples {
    use super::{EpisodeKey, MissionFacts, ResultLine};
    use avln_episode::{EndReason, Modality, Order};
    use avln_scoring::Metrics;
    use std::collections::BTreeMap;

    /// Returns a result on the main track: two goals, of which `found` are found; two episodes per house.
    pub(in crate::suite) fn line(agent: &str, order: Order, episode: u32, found: u32) -> ResultLine {
        let share = f64::from(found) / 2.0;
        let sr = if found == 2 { 1.0 } else { 0.0 };
        let step = |goal: u32| (goal < found).then_some(10 * (goal + 1));
        let house = episode / 2;
        ResultLine {
            key: EpisodeKey {
                agent: agent.to_owned(),
                order: order.as_str().to_owned(),
                episode: format!("paper-val-{house:04}-{episode:04}"),
                seed: 0,
                program: "1".to_owned(),
                benchmark: "2".to_owned(),
                split: "digest".to_owned(),
                track: "main".to_owned(),
                rules: "lh-avln-v1".to_owned(),
                feedback: "none".to_owned(),
                side_px: 128,
                split_seed: None,
            },
            scene: format!("paper-val-{house:04}"),
            mission: MissionFacts { reference_steps: 100 + episode, storeys: 1 + house % 2, area_m2: 120.0 },
            modalities: vec![Modality::Category, Modality::Image],
            end: EndReason::Stopped,
            metrics: Metrics {
                goals: 2,
                found,
                sr,
                isr: share,
                osr: share,
                osr_all: sr,
                spl: sr / 2.0,
                soft_spl: share / 2.0,
                steps: 100,
                path_m: 40.0,
                reference_m: 20.0 + f64::from(episode),
                steps_to_goal: (0..2).map(step).collect(),
                ..Metrics::default()
            },
            wrong: BTreeMap::new(),
            think_ms: 1.0,
            wall_s: 2.0,
        }
    }

    /// Returns the same result on another track with feedback.
    pub(in crate::suite) fn moved(line: ResultLine, track: &str, feedback: &str) -> ResultLine {
        let (track, feedback) = (track.to_owned(), feedback.to_owned());
        ResultLine { key: EpisodeKey { track, feedback, ..line.key }, ..line }
    }
}
