//! Cheap senses for training, which no benchmark phase has.

use crate::layout::{ArrayKind, Layout, Row};
use crate::map::{self, ExploredMap, Lidar};
use crate::options::outside;
use crate::{EnvOptions, TrainingEpisode, TrainingError};
use avln_episode::Rules;
use avln_referee::{Audio, Referee, RefereeError, episode_sounds};
use avln_truth::EpisodeTruth;
use avln_world::{
    ClipLevels, Detail, LEVEL_BANDS, LevelMeter, Listener, Pose, SceneAssets, SoundSource, Vector3,
};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Senses without images and waveforms:
///
/// | key | type and shape | content |
/// | --- | --- | --- |
/// | `lidar` | `f32 [72]` | distance at camera height, metres: a ray every 5 degrees, the first ahead, left positive; 0: none within the depth range |
/// | `ears` | `f32 [15]` | per octave band the level at the left ear, then at the right ear, dB above silence; interaural delay, ms, positive if the left ear leads; direct-to-reverberant ratio, dB; 1 in a step with an onset |
/// | `map` | `u8 [32, 32]` | explored cells with 0.25 m around the agent, straight ahead up: 0 unknown, 1 free, 2 occupied |
///
/// A silent step has zeros in `ears`. docs/training.md has the formulas.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CheapSenses {
    /// Distances around the camera.
    pub lidar: bool,
    /// Levels and bearing evidence of the sound.
    pub ears: bool,
    /// Explored part of the storey.
    pub map: bool,
}

impl CheapSenses {
    /// Definition of each sense in the observation digest: a changed number or formula needs a new version.
    const DEFINITIONS: [(&str, &str); 3] = [("lidar", "1"), ("ears", "2"), ("map", "1")];

    /// Returns the arrays: name, type, shape.
    pub(crate) fn arrays(self) -> impl Iterator<Item = (&'static str, ArrayKind, Vec<usize>)> {
        let arrays = [
            (self.lidar, "lidar", ArrayKind::F32, vec![map::RAYS]),
            (self.ears, "ears", ArrayKind::F32, vec![EAR_NUMBERS]),
            (self.map, "map", ArrayKind::U8, vec![map::SIDE, map::SIDE]),
        ];
        arrays.into_iter().filter(|array| array.0).map(|(_, name, kind, shape)| (name, kind, shape))
    }

    fn has_rays(self) -> bool {
        self.lidar || self.map
    }

    pub(crate) fn check(self, options: &EnvOptions) -> Result<(), TrainingError> {
        let turn_deg = options.rules.turn_deg;
        if self.has_rays() && !turn_deg.is_multiple_of(map::STEP_DEG) {
            let limits = format!("`lidar` and `map` need a multiple of {} degrees", map::STEP_DEG);
            return Err(outside("turn_deg", turn_deg.to_string(), &limits));
        }
        Ok(())
    }
}

// Version of images at half a pixel in the observation digest: a changed simplification needs a new one.
const HALF_PIXEL: u32 = 2;

impl Layout {
    /// Returns a name for the definition of the observation: arrays, versions, and the sensor parameters of the rules, as 16
    /// hexadecimal digits. Observations with equal digests mean the same. FNV-1a over a text.
    pub fn digest(&self, options: &EnvOptions) -> String {
        let (rules, sensors) = (&options.rules, &options.sensors);
        let version = |name: &str| {
            let known = CheapSenses::DEFINITIONS.iter().find(|(known, _)| *known == name);
            known.map_or("benchmark", |(_, version)| version)
        };
        let seen = self.arrays().iter().filter(|spec| !spec.is_info);
        let arrays =
            seen.map(|spec| format!("{} {:?} {:?} {}", spec.name, spec.kind, spec.shape, version(spec.name)));
        let optics = [
            sensors.hfov_rad,
            rules.camera_height_m,
            rules.ear_height_m,
            rules.depth_max_m,
            rules.depth_divisor,
        ];
        let noise = (&rules.depth_noise, &rules.rgb_noise, &rules.pose_frame);
        let mut text = format!("{:?} {optics:?} {noise:?}", arrays.collect::<Vec<_>>());
        if options.detail != Detail::Exact && (sensors.rgb || sensors.depth) {
            text += &format!(" {:?} {HALF_PIXEL}", options.detail);
        }
        let hash = text.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
        });
        format!("{hash:016x}")
    }
}

/// Levels of the used clips, by name.
#[derive(Default)]
pub(crate) struct ClipCache(Mutex<BTreeMap<String, Arc<ClipLevels>>>);

impl ClipCache {
    fn with_levels(&self, source: SoundSource) -> (SoundSource, Arc<ClipLevels>) {
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let entry = known.entry(source.clip.name.clone());
        let levels = entry.or_insert_with(|| Arc::new(ClipLevels::new(&source.clip)));
        let levels = Arc::clone(levels);
        (source, levels)
    }
}

/// The cheap senses during an episode.
pub(crate) struct Sensing {
    assets: Arc<SceneAssets>,
    wanted: CheapSenses,
    pose: Pose,
    lidar: Option<Lidar>,
    map: Option<ExploredMap>,
    ears: Option<EarLevels>,
}

impl Sensing {
    /// Prepares the senses in the options.
    pub(crate) fn new(
        options: &EnvOptions,
        audio: &Audio,
        clips: &ClipCache,
        scene: &TrainingEpisode,
        referee: &Referee,
    ) -> Result<Self, TrainingError> {
        let (wanted, rules) = (options.cheap, &options.rules);
        let assets = Arc::clone(referee.world().assets());
        let pose = referee.world().pose();
        let lidar = || Lidar::new(pose.heading_rad, rules.camera_height_m, rules.depth_max_m);
        let ears = || ears_of(rules, audio, clips, &assets, &scene.truth);
        let ears = wanted.ears.then(ears).transpose()?;
        Ok(Self {
            lidar: wanted.has_rays().then(lidar),
            map: wanted.map.then(|| ExploredMap::new(scene.cells())),
            ears,
            wanted,
            pose,
            assets,
        })
    }

    /// Senses the start and every step, in order.
    pub(crate) fn sense(&mut self, pose: Pose, sounding: Option<usize>) {
        self.pose = pose;
        if let Some(lidar) = &mut self.lidar
            && lidar.look(&self.assets, &pose)
            && let Some(map) = &mut self.map
        {
            map.add(lidar, &pose);
        }
        if let Some(ears) = &mut self.ears {
            ears.hear(&pose, sounding);
        }
    }

    /// Writes the entries of the last step.
    pub(crate) fn put(&self, row: &mut Row, layout: &Layout) {
        if let Some(lidar) = self.lidar.as_ref().filter(|_| self.wanted.lidar) {
            row.put(layout, "lidar", &lidar.distances_m(self.pose.heading_rad));
        }
        if let Some(ears) = &self.ears {
            row.put(layout, "ears", &ears.numbers);
        }
        if let Some((map, crop)) = self.map.as_ref().zip(row.array(layout, "map")) {
            map.crop(&self.pose, crop);
        }
    }
}

fn ears_of(
    rules: &Rules,
    audio: &Audio,
    clips: &ClipCache,
    assets: &SceneAssets,
    truth: &EpisodeTruth,
) -> Result<EarLevels, TrainingError> {
    let sounds = episode_sounds(rules, truth, &audio.bank)
        .map_err(|source| RefereeError::Sounds { episode: truth.episode.clone(), source })?;
    let sounds = sounds.into_iter().map(|sound| clips.with_levels(sound)).collect();
    let meter = assets.level_meter(sounds, &audio.head, rules.samples_per_step() as usize);
    Ok(EarLevels::new(meter, rules.ear_height_m))
}

/// Numbers of the sense: levels of both ears, interaural delay, direct sound, onset.
pub(crate) const EAR_NUMBERS: usize = 2 * LEVEL_BANDS + 3;

/// Level of silence, decibels re full scale: a root mean square of 1e-5.
const SILENCE_DB: f32 = -100.0;
/// Largest direct-to-reverberant ratio, either way, decibels.
const MOST_DIRECT_DB: f32 = 30.0;
/// Level rise of an onset, decibels.
const ONSET_DB: f32 = 6.0;

/// Levels at both ears during an episode.
pub(crate) struct EarLevels {
    meter: LevelMeter,
    height_m: f32,
    /// Level of the last step, both ears and all bands, decibels above silence.
    level_db: f32,
    /// Numbers of the last step.
    pub(crate) numbers: [f32; EAR_NUMBERS],
}

impl EarLevels {
    /// Creates silent ears at this height above the base.
    pub(crate) fn new(meter: LevelMeter, height_m: f32) -> Self {
        Self { meter, height_m, level_db: 0.0, numbers: [0.0; EAR_NUMBERS] }
    }

    /// Hears a step at a pose; only source `sounding` plays.
    pub(crate) fn hear(&mut self, pose: &Pose, sounding: Option<usize>) {
        let position = pose.position + Vector3::y() * self.height_m;
        let listener = Listener { position, heading_rad: pose.heading_rad };
        let heard = self.meter.hear(&listener, sounding);
        let level_db = above_silence_db(0.5 * heard.power.as_flattened().iter().sum::<f32>());
        let is_onset = level_db >= self.level_db + ONSET_DB;
        self.level_db = level_db;
        self.numbers = [0.0; EAR_NUMBERS];
        if level_db == 0.0 {
            return;
        }
        for (number, power) in self.numbers.iter_mut().zip(heard.power.as_flattened()) {
            *number = above_silence_db(*power);
        }
        let first = heard.first.unwrap_or_default();
        let rest = [
            1e3 * first.lead_s,
            first.direct_db.clamp(-MOST_DIRECT_DB, MOST_DIRECT_DB),
            f32::from(u8::from(is_onset)),
        ];
        self.numbers[2 * LEVEL_BANDS..].copy_from_slice(&rest);
    }
}

/// Converts a mean square to decibels above silence, at least 0.
fn above_silence_db(power: f32) -> f32 {
    let least = 1e-10;
    if power <= least { 0.0 } else { 10.0 * libm::log10f(power) - SILENCE_DB }
}
