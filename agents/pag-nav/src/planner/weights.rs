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
    /// Distance that the loudness must allow for a Submit, metres; a third more once the agent has lost its
    /// patience with a source.
    pub submit_range_m: f32,
    /// A Submit in this share of the loudness before it was followed by silence of the source: it found its target.
    pub found_level: f32,
    /// Distance that the loudness must have allowed before what is seen at a source counts, metres.
    pub look_range_m: f32,
    /// Probability that a source is the goal that is next at which the agent submits without looking at the others.
    pub commit: f32,
    /// Weight of the colours of the thing itself and of the layout of the whole view in the fit with a picture.
    pub middle: f32,
    /// See `middle`.
    pub layout: f32,
    /// Steps for which the agent heads for a source before it decides without having looked at it.
    pub patience_steps: u32,
    /// What a step of having headed for a source in vain adds to what the rest of the way is thought to cost, in steps.
    pub vain: f32,
    /// Steps before the end from which on the agent claims what it has.
    pub hurry_steps: u32,
    /// Where ways end this far from the believed source the agent explores, metres.
    pub lost_m: f32,
    /// Weight of the sound in the choice of a frontier (lambda_a).
    pub search_audio: f32,
    /// Distance from the believed source at which that weight has fallen to 1/e, metres.
    pub search_scale_m: f32,
    /// Weight of rooms and things around a frontier (lambda_r and lambda_o).
    pub search_context: f32,
    /// What a metre of way to a frontier costs.
    pub search_way: f32,
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
            look_range_m: 3.0,
            commit: 0.75,
            middle: 0.5,
            layout: 1.5,
            patience_steps: 150,
            vain: 0.3,
            hurry_steps: 150,
            lost_m: 1.5,
            search_audio: 1.0,
            search_scale_m: 4.0,
            search_context: 0.2,
            search_way: 0.05,
            nearer: 0.7,
        }
    }
}
