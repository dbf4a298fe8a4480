//! Goal cues, and the claims of sentences.

use avln_episode::{GoalCue, Modality, RgbImage, Rules};
use avln_geom::Pose;
use avln_truth::Target;
use avln_world::{Camera, CameraImage, SceneAssets};
use serde::{Deserialize, Serialize};

/// Reference picture side, pixels.
const CUE_SIDE_PX: u32 = 256;

/// Stored goal cue. Pictures are rendered at episode start.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CueSpec {
    /// Category label of the target.
    Category,
    /// Sentence.
    Description(Description),
    /// Picture with this view.
    Image(CueView),
}

/// Sentence with the claims. Imported sentences have none.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Description {
    /// Sentence for the agent.
    pub text: String,
    /// Claims, if known.
    pub claims: Option<Claims>,
}

/// Square picture, rendered on demand.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CueView {
    /// Body pose.
    pub pose: Pose,
    /// Field of view, radians.
    pub hfov_rad: f32,
    /// Pixels per side.
    pub side_px: u32,
}

impl CueView {
    pub(crate) fn render(&self, assets: &SceneAssets, rules: &Rules) -> CameraImage {
        let mut eye = self.pose.position;
        eye.y += rules.camera_height_m;
        assets.render(&Camera {
            eye,
            world_from_camera: self.pose.rotation(),
            width: self.side_px,
            height: self.side_px,
            hfov_rad: self.hfov_rad,
            depth_max_m: rules.depth_max_m,
        })
    }

    /// Returns this view with the reference picture size.
    pub fn as_cue(&self) -> Self {
        Self { side_px: CUE_SIDE_PX, ..*self }
    }
}

impl CueSpec {
    /// Returns the cue kind.
    pub fn modality(&self) -> Modality {
        match self {
            Self::Category => Modality::Category,
            Self::Description(_) => Modality::Description,
            Self::Image(_) => Modality::Image,
        }
    }

    pub(crate) fn present(&self, assets: &SceneAssets, rules: &Rules, target: &Target) -> GoalCue {
        match self {
            Self::Category => GoalCue::Category(target.category.clone()),
            Self::Description(sentence) => GoalCue::Description(sentence.text.clone()),
            Self::Image(view) => {
                let frame = view.render(assets, rules);
                GoalCue::Image(RgbImage { width: frame.width, height: frame.height, pixels: frame.rgb })
            }
        }
    }
}

/// Machine-readable content of a sentence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Claims {
    pub(crate) head: Name,
    pub(crate) list: Vec<Claim>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Claim {
    Size(String),
    Shape(String),
    Color(String),
    Material(String),
    Room(String),
    /// Location relative to landmarks.
    Place(Relation, Vec<Landmark>),
}

/// Spatial relation, from a viewer on the floor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Relation {
    /// Carries another object.
    Holds,
    /// Rests on another object.
    On,
    /// Between table legs.
    Under,
    /// Hangs above another object.
    Above,
    /// Below a hanging object.
    Below,
    /// Left of a landmark on the same wall, for a viewer facing the wall.
    LeftOf,
    /// Right of a landmark on the same wall, for a viewer facing the wall.
    RightOf,
    Between,
    /// Closer than an arm's length.
    NextTo,
    /// Within a step.
    Near,
    /// Across the room, wall to wall.
    Opposite,
    Corner,
    /// Back against a wall.
    AgainstWall,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Landmark {
    pub(crate) name: Name,
    pub(crate) color: Option<String>,
    /// True if the noun is unique in the room.
    pub(crate) only: bool,
}

#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Name {
    pub(crate) noun: String,
    pub(crate) category: String,
}
