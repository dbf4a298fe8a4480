//! Verification of targets by a detector.

use crate::{
    cue::CueView,
    error::DatasetError,
    survey::{Sighting, SurveyOptions, look::Look},
};
use avln_episode::Rules;
use avln_geom::Pose;
use avln_scene::{InstanceId, Object};
use avln_world::{CameraImage, SceneAssets};
use serde::{Deserialize, Serialize};
use std::{collections::BTreeSet, fmt};

/// Side of the verifier's pictures, pixels.
const VERIFIER_PX: u32 = 256;

/// Identity of a verifier, recorded in recipes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VerifierId {
    /// `network` for the bundled network, or the name of a file with models.
    pub name: String,
    /// BLAKE3 of the weights, or of the file and its models, hex; recorded by the build.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub digest: Option<String>,
}

impl fmt::Display for VerifierId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let digest = self.digest.as_deref().unwrap_or("without a digest");
        write!(f, "{} ({digest})", self.name)
    }
}

/// Picture for a verifier.
#[derive(Clone, Copy, Debug)]
pub struct DetectorView<'a> {
    /// Body pose.
    pub pose: Pose,
    /// Field of view, radians.
    pub hfov_rad: f32,
    /// Camera height above the body's base, metres.
    pub camera_height_m: f32,
    /// Depth range, metres.
    pub depth_max_m: f32,
    /// Colours and depths; the instances are ground truth.
    pub frame: &'a CameraImage,
}

/// Extra recognition check after the built-in thresholds, for example a detector.
pub trait Verifier: Sync {
    /// Returns the identity; `None` without checks.
    fn id(&self) -> Option<VerifierId>;

    /// Returns an entry per object in the view, true if recognisable; an error if the detector fails. All `objects`
    /// satisfy the built-in thresholds.
    fn recognises(&self, view: &DetectorView, objects: &[&Object]) -> Result<Vec<bool>, String>;
}

/// Verifier without checks.
#[derive(Clone, Copy, Debug, Default)]
pub struct ThresholdsOnly;

impl Verifier for ThresholdsOnly {
    fn id(&self) -> Option<VerifierId> {
        None
    }

    fn recognises(&self, _: &DetectorView, objects: &[&Object]) -> Result<Vec<bool>, String> {
        Ok(vec![true; objects.len()])
    }
}

/// Returns the recognised ones among the sighted instances; all of them without a verifier.
pub(crate) fn recognised(
    assets: &SceneAssets,
    rules: &Rules,
    options: &SurveyOptions,
    sightings: &[Sighting],
    verifier: &dyn Verifier,
) -> Result<BTreeSet<InstanceId>, DatasetError> {
    let pending: BTreeSet<InstanceId> = sightings.iter().map(|seen| seen.id(assets)).collect();
    if verifier.id().is_none() {
        return Ok(pending);
    }
    let mut found = BTreeSet::new();
    let mut queue = Queue { assets, options, sightings, pending, used: BTreeSet::new() };
    while let Some(view) = queue.next() {
        let view = CueView { side_px: VERIFIER_PX, ..view };
        let frame = view.render(assets, rules);
        let objects = queue.shown(view, &frame);
        let detector_view = DetectorView {
            pose: view.pose,
            hfov_rad: view.hfov_rad,
            camera_height_m: rules.camera_height_m,
            depth_max_m: rules.depth_max_m,
            frame: &frame,
        };
        let verdicts = verifier.recognises(&detector_view, &objects).map_err(DatasetError::Verifier)?;
        let new = objects.iter().zip(verdicts).filter(|(_, is_recognised)| *is_recognised);
        for (object, _) in new {
            queue.pending.remove(&object.id);
            found.insert(object.id);
        }
    }
    Ok(found)
}

/// Views of pending instances. A view counts for all pending instances in it, so that few views verify many instances.
struct Queue<'a> {
    assets: &'a SceneAssets,
    options: &'a SurveyOptions,
    sightings: &'a [Sighting],
    pending: BTreeSet<InstanceId>,
    /// Used views: sighting and look.
    used: BTreeSet<(usize, usize)>,
}

impl<'a> Queue<'a> {
    /// Returns the unused view of a pending instance with most pending instances; the earliest of equals.
    fn next(&mut self) -> Option<CueView> {
        let mut best: Option<(usize, (usize, usize))> = None;
        for (number, sighting) in self.sightings.iter().enumerate() {
            if !self.pending.contains(&sighting.id(self.assets)) {
                continue;
            }
            for (index, look) in sighting.looks.iter().enumerate() {
                let key = (number, index);
                if self.used.contains(&key) {
                    continue;
                }
                let count = self.neighbours(look);
                if best.is_none_or(|(most, _)| count > most) {
                    best = Some((count, key));
                }
            }
        }
        let (_, key) = best?;
        self.used.insert(key);
        Some(self.sightings[key.0].looks[key.1].view)
    }

    /// Returns the number of other pending instances with enough pixels.
    fn neighbours(&self, look: &Look) -> usize {
        let enough = self.options.min_share * (look.view.side_px * look.view.side_px) as f32;
        let is_shown =
            |(id, pixels): &(&InstanceId, &u32)| **pixels as f32 >= enough && self.pending.contains(*id);
        look.beside.iter().filter(is_shown).count()
    }

    /// Returns the pending instances that satisfy the thresholds in `frame`.
    fn shown(&self, view: CueView, frame: &CameraImage) -> Vec<&'a Object> {
        let visible: BTreeSet<InstanceId> =
            frame.instances.chunk_by(|a, b| a == b).map(|run| run[0]).collect();
        let objects = self.assets.scene.objects.iter();
        let is_good = |object: &&Object| {
            let look = Look::of(view, frame, object.id, self.options);
            look.is_some_and(|look| look.is_good(self.options))
        };
        objects
            .filter(|object| visible.contains(&object.id) && self.pending.contains(&object.id))
            .filter(is_good)
            .collect()
    }
}
