//! Demonstrations to learn from: what the oracle did, and what an agent would have sensed before each of its actions.
//!
//! Start reading at [`RolloutOptions::run`]. A folder holds `rollouts.json`, which tells what its episodes have in common, and
//! `episodes/ID.npz` for each episode. The same split and plan give the same bytes, on any number of threads.

mod archive;
mod record;

use crate::parallel;
use crate::suite::Oracle;
use avln_arena::{Failure, FailureKind, dataset::{SplitFolder, check_plain, write_whole}};
use avln_dataset::{EpisodeSpec, SceneLine};
use avln_episode::{Action, DistanceRule, Order, Rules, Sensors};
use avln_referee::Audio;
use avln_world::Cache;
use record::Recorded;
use serde::Serialize;
use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

/// Millimetres of depth in what the depth sensor says in metres.
const M_PER_MM: f32 = 1e-3;

/// A sense that is written down.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Sense {
    /// Colours.
    Rgb,
    /// Distances.
    Depth,
    /// Pose of the agent, as sent to clients.
    Pose,
    /// Sound at both ears.
    Audio,
}

/// Recorded sensors.
pub struct RolloutOptions<'a> {
    /// The split; one that is there to learn from.
    pub split: &'a SplitFolder,
    /// The rules that it is played by.
    pub rules: Rules,
    /// Clips and ears.
    pub audio: Audio,
    /// Order of the goals.
    pub order: Order,
    /// Recorded arrays, each once.
    pub senses: Vec<Sense>,
    /// Pixels along a side of the pictures.
    pub side_px: u32,
    /// Number of missions: the first of each scene, then the second of each, and so on; all for `None`.
    pub episodes: Option<usize>,
    /// Scenes at the same time; one for each processor for `None`.
    pub threads: Option<usize>,
    /// Folder of cached results.
    pub cache: Arc<dyn Cache>,
}

/// Number of recorded items.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RolloutTally {
    /// Episodes that were there already.
    pub before: usize,
    /// Episodes that were played now.
    pub now: usize,
    /// Those of them in which a goal was not found.
    pub incomplete: usize,
}

/// Content of `rollouts.json`.
#[derive(Serialize)]
struct RolloutManifest<'a> {
    /// `avln-rollouts`.
    format: &'static str,
    version: u32,
    agent: &'static str,
    split: &'a str,
    /// Digest of the split.
    digest: &'a str,
    order: Order,
    sensors: Vec<Sense>,
    side_px: u32,
    hfov_rad: f32,
    sample_rate_hz: u32,
    /// Factor from stored depth values to metres.
    depth_scale: f32,
    /// Names of the action numbers.
    actions: [String; 5],
    rules: &'a Rules,
}

impl RolloutOptions<'_> {
    /// Plays what `folder` does not hold yet. It can be stopped at any time; the next call goes on. `watch` hears of each
    /// episode, played now or before.
    ///
    /// # Errors
    /// When the folder holds other rollouts or cannot be written, or a scene cannot be used. What was recorded stays.
    pub fn run(&self, folder: &Path, watch: impl Fn() + Sync) -> Result<RolloutTally, Failure> {
        self.check_rules()?;
        self.claim(folder)?;
        let visits = self.visits();
        let mut tally = RolloutTally::default();
        let visit = |&(scene, count): &(usize, usize)| self.visit(scene, count, folder, &watch);
        parallel::share(&visits, parallel::threads(self.threads), visit, |_, part: RolloutTally| {
            tally.before += part.before;
            tally.now += part.now;
            tally.incomplete += part.incomplete;
        })?;
        Ok(tally)
    }

    /// Number of planned episodes.
    pub fn count(&self) -> usize {
        self.split.mission_count().min(self.episodes.unwrap_or(usize::MAX))
    }

    /// The oracle knows by one rule alone where a goal counts.
    fn check_rules(&self) -> Result<(), Failure> {
        if self.rules.success_distance == DistanceRule::CameraToBox {
            return Ok(());
        }
        let message = format!("the oracle does not play by rule set '{}'", self.rules.name);
        Err(Failure::new(FailureKind::Scene, message).hinted("use a split that was made for lh-avln-v1"))
    }

    /// Makes the folder one for this plan; one of another plan is refused.
    fn claim(&self, folder: &Path) -> Result<(), Failure> {
        let path = folder.join("rollouts.json");
        let text = serde_json::to_vec_pretty(&self.manifest())
            .map_err(|error| Failure::new(FailureKind::Internal, error))?;
        match std::fs::read(&path) {
            Ok(there) if there == text => Ok(()),
            Ok(_) => {
                let message =
                    format!("{} holds rollouts of another split or of other sensors", folder.display());
                Err(Failure::new(FailureKind::Data, message)
                    .hinted("name another folder with --out, or give the options that it was begun with"))
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

    /// The scenes that are visited, with the number of their missions that are played, which are the first ones.
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

    /// Plays the first `count` missions of a scene that are not there.
    fn visit(
        &self,
        scene: usize,
        count: usize,
        folder: &Path,
        watch: &(impl Fn() + Sync),
    ) -> Result<RolloutTally, Failure> {
        let scene = &self.split.scenes()[scene];
        let mut missing = Vec::new();
        for episode in self.split.episodes(scene)?.into_iter().take(count) {
            let path = path_of(folder, &episode)?;
            if !path.exists() {
                missing.push((episode, path));
            }
        }
        let mut tally = RolloutTally { before: count - missing.len(), ..RolloutTally::default() };
        (0..tally.before).for_each(|_| watch());
        if missing.is_empty() {
            return Ok(tally);
        }
        let assets = Arc::new(self.open(scene)?);
        for (episode, path) in missing {
            let Recorded { bytes, is_complete } = record::record(self, &assets, &episode)?;
            write_whole(&path, &bytes)?;
            tally.now += 1;
            tally.incomplete += usize::from(!is_complete);
            watch();
        }
        Ok(tally)
    }

    fn open(&self, scene: &SceneLine) -> Result<avln_world::SceneAssets, Failure> {
        Ok(scene.spec().open_with(&self.rules, Some(&self.cache))?)
    }
}

fn path_of(folder: &Path, episode: &EpisodeSpec) -> Result<PathBuf, Failure> {
    check_plain(&episode.id)?;
    Ok(folder.join("episodes").join(format!("{}.npz", episode.id)))
}
