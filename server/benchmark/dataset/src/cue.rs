use crate::describe::Claims;
use avln_episode::{GoalCue, Modality, RgbImage, Rules};
use avln_geom::Pose;
use avln_truth::Target;
use avln_world::{Camera, Frame, SceneAssets};
use serde::{Deserialize, Serialize};

/// Side of a reference picture, pixels.
const CUE_SIDE_PX: u32 = 256;

/// How one goal is described, as the data set stores it: pictures are rendered when an episode starts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CueSpec {
    /// By the label of the target's category.
    Category,
    /// By a sentence.
    Description(Description),
    /// By the picture that this view shows.
    Image(View),
}

/// A sentence, and what it claims of its target where that is known: sentences of other data sets claim nothing that could
/// be checked.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Description {
    /// The sentence as the agent reads it.
    pub text: String,
    /// What it says.
    pub claims: Option<Claims>,
}

/// A square picture that can be rendered again at any time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct View {
    /// Where the body stands and looks.
    pub pose: Pose,
    /// Field of view, radians.
    pub hfov_rad: f32,
    /// Pixels a side.
    pub side_px: u32,
}

impl View {
    /// The picture.
    pub(crate) fn render(&self, assets: &SceneAssets, rules: &Rules) -> Frame {
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

    /// Returns this view with the size of a reference picture.
    pub fn as_cue(&self) -> Self {
        Self { side_px: CUE_SIDE_PX, ..*self }
    }
}

impl CueSpec {
    /// Which kind of cue this is.
    pub fn modality(&self) -> Modality {
        match self {
            Self::Category => Modality::Category,
            Self::Description(_) => Modality::Description,
            Self::Image(_) => Modality::Image,
        }
    }

    /// What the agent is given.
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
