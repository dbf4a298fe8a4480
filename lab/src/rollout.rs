//! Demonstrations for imitation learning: the oracle's actions, with an agent's observation before every action.
//!
//! Start reading at [`RolloutOptions::run`]. A folder contains `rollouts.json` with the common facts, and `episodes/ID.npz` per
//! episode. Equal splits and options result in equal bytes, for any thread count.

use crate::suite::Oracle;
use crate::{internal, npy, parallel};
use avln_arena::dataset::{SplitFolder, check_plain, write_whole};
use avln_arena::{Failure, FailureKind};
use avln_dataset::EpisodeSpec;
use avln_episode::{
    Action, DistanceRule, EndReason, Feedback, GoalCue, Mission, Observation, Order, Rules, Sensors,
};
use avln_referee::{Audio, Referee};
use avln_scoring::{Metrics, score};
use avln_world::{Cache, SceneAssets};
use serde::Serialize;
use serde_json::{Value, json};
use std::io::{self, Cursor, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use zip::write::{PreparedZipFile, SimpleFileOptions, ZipFileBuilder};
use zip::{CompressionMethod, DateTime, ZipWriter};

/// Stored depth unit, metres.
const M_PER_MM: f32 = 1e-3;

/// A recorded sense.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Sense {
    /// Colours.
    Rgb,
    /// Distances.
    Depth,
    /// Agent pose, as sent to clients.
    Pose,
    /// Sound at both ears.
    Audio,
}

/// Settings for rollouts.
pub struct RolloutOptions<'a> {
    /// A training split.
    pub split: &'a SplitFolder,
    /// Episode rules.
    pub rules: Rules,
    /// Clips and ears.
    pub audio: Audio,
    /// Goal order.
    pub order: Order,
    /// Recorded senses, without repetition.
    pub senses: Vec<Sense>,
    /// Image side, pixels.
    pub side_px: u32,
    /// Mission limit, spread evenly over the scenes; `None` for all missions.
    pub episodes: Option<usize>,
    /// Thread count; `None` for one per processor.
    pub threads: Option<usize>,
    /// Cache for scenes.
    pub cache: Arc<dyn Cache>,
}

/// Episode counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RolloutTally {
    /// Episodes from earlier calls.
    pub before: usize,
    /// Episodes recorded now.
    pub now: usize,
    /// Episodes recorded now that miss a goal.
    pub incomplete: usize,
}

/// `rollouts.json`.
#[derive(Serialize)]
struct RolloutManifest<'a> {
    /// `avln-rollouts`.
    format: &'static str,
    version: u32,
    agent: &'static str,
    split: &'a str,
    digest: &'a str,
    order: Order,
    sensors: Vec<Sense>,
    side_px: u32,
    hfov_rad: f32,
    sample_rate_hz: u32,
    /// Factor from stored depth values to metres.
    depth_scale: f32,
    actions: [String; 5],
    rules: &'a Rules,
}

impl RolloutOptions<'_> {
    /// Records the missing episodes in `folder`; calls `on_episode` per episode, old or new. An interrupted call can be repeated.
    ///
    /// # Errors
    /// If the folder contains other rollouts or cannot be written, or a scene cannot be used. Recorded episodes remain.
    pub fn run(&self, folder: &Path, on_episode: impl Fn() + Sync) -> Result<RolloutTally, Failure> {
        self.check_rules()?;
        self.claim(folder)?;
        let mut tally = RolloutTally::default();
        let visit = |&(scene, count): &(usize, usize)| self.record_scene(scene, count, folder, &on_episode);
        parallel::share(&self.visits(), self.threads, visit, |_, part: RolloutTally| {
            tally.before += part.before;
            tally.now += part.now;
            tally.incomplete += part.incomplete;
        })?;
        Ok(tally)
    }

    /// Returns the planned episode count.
    pub fn count(&self) -> usize {
        self.split.mission_count().min(self.episodes.unwrap_or(usize::MAX))
    }

    fn check_rules(&self) -> Result<(), Failure> {
        // The oracle computes success regions by these rules only.
        if matches!(self.rules.success_distance, DistanceRule::CameraToBox | DistanceRule::CameraToMesh) {
            return Ok(());
        }
        let message = format!("the oracle does not support rule set '{}'", self.rules.name);
        Err(Failure::new(FailureKind::Scene, message).hinted("use a split with the rules lh-avln-v1"))
    }

    /// Writes the manifest, or compares it with the existing one.
    fn claim(&self, folder: &Path) -> Result<(), Failure> {
        let path = folder.join("rollouts.json");
        let text = serde_json::to_vec_pretty(&self.manifest()).map_err(internal)?;
        match std::fs::read(&path) {
            Ok(existing) if existing == text => Ok(()),
            Ok(_) => {
                let message =
                    format!("{} contains rollouts of another split or of other sensors", folder.display());
                Err(Failure::new(FailureKind::Data, message)
                    .hinted("choose another folder with --out, or repeat the first call's options"))
            }
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => write_whole(&path, &text),
            Err(error) => Err(Failure::file("read", &path, error)),
        }
    }

    fn manifest(&self) -> RolloutManifest<'_> {
        RolloutManifest {
            format: "avln-rollouts",
            version: 1,
            agent: Oracle::NAME,
            split: self.split.name(),
            digest: self.split.digest(),
            order: self.order,
            sensors: self.senses.clone(),
            side_px: self.side_px,
            hfov_rad: self.sensors().hfov_rad,
            sample_rate_hz: Sensors::SAMPLE_RATE_HZ,
            depth_scale: M_PER_MM / self.rules.depth_divisor,
            actions: Action::ALL.map(|action| action.to_string()),
            rules: &self.rules,
        }
    }

    fn sensors(&self) -> Sensors {
        let has = |sense: Sense| self.senses.contains(&sense);
        let all = Sensors::all(self.side_px, self.side_px);
        Sensors { rgb: has(Sense::Rgb), depth: has(Sense::Depth), audio: has(Sense::Audio), ..all }
    }

    /// Returns the planned scenes with their mission counts: every scene's first mission, then every second, and so on.
    fn visits(&self) -> Vec<(usize, usize)> {
        let scenes = self.split.scenes();
        let mut counts = vec![0; scenes.len()];
        let mut left = self.count();
        let rounds = scenes.iter().map(|scene| scene.missions).max().unwrap_or(0);
        for round in 0..rounds {
            let has_more = scenes.iter().zip(&mut counts).filter(|(scene, _)| scene.missions > round);
            for (_, count) in has_more.take(left) {
                *count += 1;
                left -= 1;
            }
        }
        counts.into_iter().enumerate().filter(|(_, count)| *count > 0).collect()
    }

    /// Records the missing episodes among a scene's first `count` missions.
    fn record_scene(
        &self,
        scene: usize,
        count: usize,
        folder: &Path,
        on_episode: &(impl Fn() + Sync),
    ) -> Result<RolloutTally, Failure> {
        let scene = &self.split.scenes()[scene];
        let mut missing = Vec::new();
        for episode in self.split.episodes(scene)?.into_iter().take(count) {
            let path = episode_path(folder, &episode)?;
            if !path.exists() {
                missing.push((episode, path));
            }
        }
        let mut tally = RolloutTally { before: count - missing.len(), ..RolloutTally::default() };
        (0..tally.before).for_each(|_| on_episode());
        if missing.is_empty() {
            return Ok(tally);
        }
        let assets = Arc::new(scene.spec().open_with(&self.rules, Some(&self.cache))?);
        for (episode, path) in missing {
            let Recorded { bytes, is_complete } = record(self, &assets, &episode)?;
            write_whole(&path, &bytes)?;
            tally.now += 1;
            tally.incomplete += usize::from(!is_complete);
            on_episode();
        }
        Ok(tally)
    }
}

fn episode_path(folder: &Path, episode: &EpisodeSpec) -> Result<PathBuf, Failure> {
    check_plain(&episode.id)?;
    Ok(folder.join("episodes").join(format!("{}.npz", episode.id)))
}

struct Recorded {
    bytes: Vec<u8>,
    /// `true` if every goal was found.
    is_complete: bool,
}

/// An episode with scene, mission and options.
struct Recording<'a> {
    plan: &'a RolloutOptions<'a>,
    assets: &'a Arc<SceneAssets>,
    episode: &'a EpisodeSpec,
    mission: Mission,
}

/// Plays an episode with the oracle and records it.
fn record(
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
