/// The tunable numbers of [`PagNav`](crate::PagNav).
#[derive(Clone, Debug, PartialEq)]
pub struct Weights {
    /// Steps forward and turns that a metre of a way takes.
    pub steps_per_m: f32,
    /// How many steps sooner another source must be reached to be preferred to the one that the agent is heading for.
    pub loyalty_steps: f32,
    /// Distance to the believed source at which the agent submits (the paper's delta_sub), metres.
    pub submit_m: f32,
    /// The same where no way leads nearer: a source inside furniture, metres.
    pub submit_blocked_m: f32,
    /// Angle to the believed source within which the agent submits (theta_sub), radians.
    pub submit_rad: f32,
    /// Certainty of the believed source that a Submit needs, 0 to 1.
    pub submit_certainty: f32,
    /// Distance that the loudness must allow for a Submit, metres.
    pub submit_range_m: f32,
    /// A Submit in this share of the loudness before it was followed by silence of the source: it found its target.
    pub found_level: f32,
    /// How much nearer the agent goes after a Submit that found nothing, as a factor on the distances.
    pub nearer: f32,
}

impl Default for Weights {
    fn default() -> Self {
        Self {
            steps_per_m: 6.0,
            loyalty_steps: 15.0,
            submit_m: 1.2,
            submit_blocked_m: 2.0,
            submit_rad: 0.6,
            submit_certainty: 0.5,
            submit_range_m: 2.2,
            found_level: 0.5,
            nearer: 0.7,
        }
    }
}
