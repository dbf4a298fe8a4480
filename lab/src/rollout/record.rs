//! Recording of an episode as a NumPy `.npz` archive.

use super::{M_PER_MM, RolloutOptions, Sense};
use crate::suite::Oracle;
use crate::{internal, npy};
use avln_arena::{Failure, FailureKind};
use avln_dataset::EpisodeSpec;
use avln_episode::{Action, EndReason, Feedback, GoalCue, Mission, Observation, Sensors};
use avln_referee::Referee;
use avln_scoring::{Metrics, score};
use avln_world::SceneAssets;
use serde_json::{Value, json};
use std::io::{self, Cursor, Write};
use std::sync::Arc;
use zip::write::{PreparedZipFile, SimpleFileOptions, ZipFileBuilder};
use zip::{CompressionMethod, DateTime, ZipWriter};

pub(super) struct Recorded {
    pub(super) bytes: Vec<u8>,
    /// `true` if every goal was found.
    pub(super) is_complete: bool,
}

/// An episode with scene, mission and options.
struct Recording<'a> {
    plan: &'a RolloutOptions<'a>,
    assets: &'a Arc<SceneAssets>,
    episode: &'a EpisodeSpec,
    mission: Mission,
}

/// Plays an episode with the oracle and records it.
pub(super) fn record(
    plan: &RolloutOptions,
    assets: &Arc<SceneAssets>,
    episode: &EpisodeSpec,
) -> Result<Recorded, Failure> {
    let mission = episode.mission(assets, &plan.rules, plan.order);
    Recording { plan, assets, episode, mission }.record()
}

impl Recording<'_> {
    fn record(&self) -> Result<Recorded, Failure> {
        // An array's header contains the length. A first pass without sensors, which cost almost all of a step, finds the
        // length, so that the second pass can compress every observation at once instead of storing a whole episode.
        let actions = self.rehearse()?;
        let mut tape = Tape::new(self.plan, actions.len()).map_err(internal)?;
        let mut referee = self.referee(self.plan.sensors())?;
        let mut seen = referee.start();
        for action in actions {
            tape.add(&seen, action).map_err(internal)?;
            seen = referee.step(action).map_err(|error| self.failed(error))?.observation;
        }
        let (truth, record) = referee.into_record();
        let metrics = score(&truth, &record, &self.plan.rules);
        let bytes = tape.finish(&self.facts(record.end, &metrics), &self.mission).map_err(internal)?;
        Ok(Recorded { bytes, is_complete: metrics.found == metrics.goals })
    }

    fn rehearse(&self) -> Result<Vec<Action>, Failure> {
        let mut oracle = Oracle::new(self.episode.truth(self.plan.order), &self.plan.rules);
        let blind = Sensors { rgb: false, depth: false, audio: false, ..self.plan.sensors() };
        let mut referee = self.referee(blind)?;
        referee.start();
        let mut actions = Vec::new();
        loop {
            let action = oracle.choose(&referee);
            actions.push(action);
            if referee.step(action).map_err(|error| self.failed(error))?.end.is_some() {
                return Ok(actions);
            }
        }
    }

    fn referee(&self, sensors: Sensors) -> Result<Referee, Failure> {
        let plan = self.plan;
        let truth = plan.split.truth(self.episode, plan.order, &plan.rules, self.assets)?;
        let rules = self.plan.rules.clone();
        Referee::new(self.assets.clone(), self.mission.clone(), truth, rules, sensors, &self.plan.audio)
            .map_err(|error| self.failed(error))
    }

    fn failed(&self, error: impl std::fmt::Display) -> Failure {
        Failure::new(FailureKind::Scene, format!("mission {}: {error}", self.episode.id))
    }

    /// Returns `episode.json`.
    fn facts(&self, end: EndReason, metrics: &Metrics) -> Value {
        let goal = |(index, cue): (usize, &GoalCue)| match cue {
            GoalCue::Category(label) => json!({ "category": label }),
            GoalCue::Description(sentence) => json!({ "description": sentence }),
            GoalCue::Image(_) => json!({ "image": picture_name(index) }),
        };
        json!({
            "episode": self.episode.id,
            "scene": self.episode.scene,
            "order": self.mission.order,
            "goals": self.mission.goals.iter().enumerate().map(goal).collect::<Vec<_>>(),
            "end": end,
            "steps": metrics.steps,
            "found": metrics.found,
            "path_m": metrics.path_m,
            "reference_m": metrics.reference_m,
        })
    }
}

/// Returns the array name for a goal image.
fn picture_name(goal: usize) -> String {
    format!("goal_{goal}_rgb")
}

/// The arrays of an episode, with an item per action: the observation before the action.
struct Tape {
    action: Array,
    feedback: Array,
    rgb: Option<Array>,
    depth: Option<Array>,
    pose: Option<Array>,
    audio: Option<Array>,
    /// Factor from depth values to millimetres.
    mm_per_depth: f32,
}

impl Tape {
    fn new(plan: &RolloutOptions, steps: usize) -> io::Result<Self> {
        let side = plan.side_px as usize;
        let samples = plan.rules.audio_samples.max(plan.rules.samples_per_step()) as usize;
        let wanted = |sense: Sense, name: &str, kind: &str, item: &[usize]| {
            let is_wanted = plan.senses.contains(&sense);
            is_wanted.then(|| Array::new(name, kind, &[&[steps], item].concat())).transpose()
        };
        Ok(Self {
            action: Array::new("action", "|u1", &[steps])?,
            feedback: Array::new("feedback", "|u1", &[steps])?,
            rgb: wanted(Sense::Rgb, "rgb", "|u1", &[side, side, 3])?,
            depth: wanted(Sense::Depth, "depth_mm", "<u2", &[side, side])?,
            pose: wanted(Sense::Pose, "pose", "<f4", &[4])?,
            audio: wanted(Sense::Audio, "audio", "<f4", &[Sensors::AUDIO_CHANNELS as usize, samples])?,
            mm_per_depth: plan.rules.depth_divisor / M_PER_MM,
        })
    }

    /// Adds an observation and the following action.
    fn add(&mut self, seen: &Observation, action: Action) -> io::Result<()> {
        self.action.0.write_all(&[action.index()])?;
        self.feedback.0.write_all(&[feedback_number(seen.feedback)])?;
        if let (Some(array), Some(rgb)) = (&mut self.rgb, &seen.rgb) {
            array.0.write_all(rgb)?;
        }
        if let (Some(array), Some(depth)) = (&mut self.depth, &seen.depth) {
            let mm = |depth: &f32| ((depth * self.mm_per_depth).round() as u16).to_le_bytes();
            array.0.write_all(&depth.iter().flat_map(mm).collect::<Vec<_>>())?;
        }
        if let Some(array) = &mut self.pose {
            let place = seen.pose.position;
            array.add_floats(&[place.x, place.y, place.z, seen.pose.heading_rad])?;
        }
        if let (Some(array), Some(audio)) = (&mut self.audio, &seen.audio) {
            array.add_floats(audio)?;
        }
        Ok(())
    }

    fn finish(self, facts: &Value, mission: &Mission) -> io::Result<Vec<u8>> {
        let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
        let mut episode = ZipFileBuilder::new("episode.json", options())?;
        episode.write_all(&serde_json::to_vec_pretty(facts)?)?;
        archive.add_prepared_file(episode.finish()?)?;
        for (index, goal) in mission.goals.iter().enumerate() {
            if let GoalCue::Image(picture) = goal {
                let shape = [picture.height as usize, picture.width as usize, 3];
                let mut array = Array::new(&picture_name(index), "|u1", &shape)?;
                array.0.write_all(&picture.pixels)?;
                archive.add_prepared_file(array.finish()?)?;
            }
        }
        let senses = [self.rgb, self.depth, self.pose, self.audio].into_iter().flatten();
        for array in [self.action, self.feedback].into_iter().chain(senses) {
            archive.add_prepared_file(array.finish()?)?;
        }
        Ok(archive.finish()?.into_inner())
    }
}

/// A NumPy array, compressed while it is written.
struct Array(ZipFileBuilder);

impl Array {
    /// Begins an array; `kind` is NumPy's type string.
    fn new(name: &str, kind: &str, shape: &[usize]) -> io::Result<Self> {
        let mut file = ZipFileBuilder::new(format!("{name}.npy"), options().compression_level(Some(1)))?;
        npy::write_header(&mut file, &format!("'{kind}'"), shape)?;
        Ok(Self(file))
    }

    fn add_floats(&mut self, numbers: &[f32]) -> io::Result<()> {
        let bytes: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
        self.0.write_all(&bytes)
    }

    fn finish(self) -> io::Result<PreparedZipFile> {
        Ok(self.0.finish()?)
    }
}

/// Returns options for archive members. The date is constant, so that equal episodes have equal bytes.
fn options() -> SimpleFileOptions {
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Deflated);
    options.last_modified_time(DateTime::default())
}

/// Returns the number for feedback in files: as on the wire, with separate numbers for the verdicts.
fn feedback_number(feedback: Feedback) -> u8 {
    match feedback {
        Feedback::None => 0,
        Feedback::Accepted => 1,
        Feedback::Verdict(true) => 2,
        Feedback::Verdict(false) => 3,
    }
}
