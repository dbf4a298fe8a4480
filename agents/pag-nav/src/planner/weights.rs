/// The tunable numbers of [`PagNav`](crate::PagNav).
#[derive(Clone, Debug, PartialEq)]
pub struct Weights {
    /// Steps forward and turns that a metre of a way takes.
    pub steps_per_m: f32,
    /// How many steps sooner another source must be reached to be preferred to the one that the agent is heading for.
    pub loyalty_steps: f32,
    /// Weight of visual compatibility in the score of a candidate (lambda_v).
    pub ground_vis: f32,
    /// Weight of the rooms and things around it (lambda_c).
    pub ground_context: f32,
    /// Weight of its consistency with what was heard (lambda_a).
    pub ground_audio: f32,
    /// Distance from the believed source at which that consistency has fallen to 1/sqrt(e), metres.
    pub sound_scale_m: f32,
    /// Certainty of a believed source from which on it counts fully, 0 to 1.
    pub certain: f32,
    /// Score from which on a candidate is plausible.
    pub plausible: f32,
    /// Looks from nearby that verification asks for.
    pub verify_looks: u32,
    /// Visual compatibility that verification asks for, 0 to 1; see `patience_steps`.
    pub verify_fit: f32,
    /// Distance to the candidate within which the agent submits (the paper's delta_sub), metres.
    pub submit_m: f32,
    /// Angle to the candidate within which the agent submits (theta_sub), radians.
    pub submit_rad: f32,
    /// A Submit in this share of the loudness before it was followed by silence of the source: it found its target.
    pub found_level: f32,
    /// Distance that the loudness must have allowed before what is seen at a source counts, metres.
    pub look_range_m: f32,
    /// Probability that a source is the goal that is next at which the agent submits without looking at the others.
    pub commit: f32,
    /// Steps of heading for a source after which it counts as looked at, and verification starts to ask for less.
    pub patience_steps: u32,
    /// What a step of having headed for a source in vain adds to what the rest of the way is thought to cost, in steps.
    pub vain: f32,
    /// Steps before the end from which on verification asks for one look only.
    pub hurry_steps: u32,
    /// Distance from the believed source at which the agent looks around instead of exploring, metres.
    pub arrived_m: f32,
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

impl Weights {
    /// The same for an agent that hears nothing: sight takes over what sound was worth.
    pub fn silent(self) -> Self {
        let seen = (self.ground_vis + self.ground_context).max(f32::EPSILON);
        let share = (seen + self.ground_audio) / seen;
        let (ground_vis, ground_context) = (self.ground_vis * share, self.ground_context * share);
        Self { ground_vis, ground_context, ground_audio: 0.0, search_audio: 0.0, ..self }
    }
}

impl Default for Weights {
    fn default() -> Self {
        Self {
            steps_per_m: 6.0,
            loyalty_steps: 15.0,
            ground_vis: 0.4,
            ground_context: 0.1,
            ground_audio: 0.5,
            sound_scale_m: 0.35,
            certain: 0.5,
            plausible: 0.45,
            verify_looks: 3,
            verify_fit: 0.25,
            submit_m: 1.2,
            submit_rad: 0.6,
            found_level: 0.5,
            look_range_m: 3.0,
            commit: 0.75,
            patience_steps: 100,
            vain: 0.3,
            hurry_steps: 150,
            arrived_m: 2.2,
            lost_m: 1.5,
            search_audio: 1.0,
            search_scale_m: 4.0,
            search_context: 0.2,
            search_way: 0.05,
            nearer: 0.7,
        }
    }
}
