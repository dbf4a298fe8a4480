//! Demonstrations for imitation learning: the oracle's actions, with an agent's observation before every action.
//!
//! Start reading at [`RolloutOptions::run`]. A folder contains `rollouts.json` with the common facts, and `episodes/ID.npz` per
//! episode. Equal splits and options result in equal bytes, for any thread count.

mod record;

use crate::suite::Oracle;
use crate::{internal, parallel};
use avln_arena::dataset::{SplitFolder, check_plain, write_whole};
use avln_arena::{Failure, FailureKind};
use avln_dataset::EpisodeSpec;
use avln_episode::{Action, DistanceRule, Order, Rules, Sensors};
use avln_referee::Audio;
use avln_world::Cache;
use record::Recorded;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

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
            let Recorded { bytes, is_complete } = record::record(self, &assets, &episode)?;
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
