use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// How many missions to draw in a scene, and what makes one worth playing.
#[derive(Clone, Debug, PartialEq)]
pub struct MissionOptions {
    /// Missions to draw.
    pub episodes: usize,
    /// Goals of a mission, 2 to 4 in the paper; every number is as likely as the others.
    pub goals: RangeInclusive<usize>,
    /// Least walking distance from the start to a success region, metres.
    pub min_start_m: f64,
    /// Least walking distance between two success regions of a mission, metres.
    pub min_separation_m: f64,
    /// How many other instances of its category a target may have in the scene.
    pub distractors: RangeInclusive<u8>,
    /// How long missions should be; as they come when there is none.
    pub steps: Option<StepGoal>,
    /// Seed of everything that is drawn.
    pub seed: u64,
}

/// How many reference steps missions should have, ordered.
///
/// Each mission is drawn a few times, and the draw nearest to a wanted number is kept. The wanted number is `mean` for
/// a mission of the middle number of goals, in proportion for others, spread evenly by `spread` to both sides.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StepGoal {
    /// Wanted mean over all missions, actions.
    pub mean: f64,
    /// Half the width of the wanted distribution as a share of the mean, 0 to 1.
    pub spread: f64,
    /// Draws that are compared, at least 1.
    pub draws: u32,
}

impl MissionOptions {
    /// `episodes` missions of 2 to 4 goals, at least 2 m from the start and 1 m from each other.
    pub fn new(episodes: usize, seed: u64) -> Self {
        Self {
            episodes,
            goals: 2..=4,
            min_start_m: 2.0,
            min_separation_m: 1.0,
            distractors: 0..=u8::MAX,
            steps: None,
            seed,
        }
    }
}
