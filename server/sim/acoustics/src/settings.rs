//! Settings of the acoustic simulation.

use crate::stored::VERSION;
use crate::{Head, SAMPLE_RATE_HZ, SPEED_OF_SOUND_M_S};

/// Scope and resolution of the acoustic simulation. Equal settings give equal bits.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Length of impulse responses, seconds; later sound is dropped.
    pub response_s: f32,
    /// Rays that carry the late energy of a source.
    pub ray_count: usize,
    /// Highest order of discrete reflections, 0 to 3; 0 leaves all reflections to the late energy.
    pub reflection_order: usize,
    /// Head model; [`Source::heard_by`](crate::Source::heard_by) changes it later.
    pub head: Head,
}

impl Default for Settings {
    fn default() -> Self {
        Self { response_s: 1.0, ray_count: 8192, reflection_order: 2, head: Head::Sphere }
    }
}

impl Settings {
    /// Samples of the longest impulse response.
    pub(crate) fn response_samples(&self) -> usize {
        (self.response_s.max(0.0) * SAMPLE_RATE_HZ as f32) as usize
    }

    /// The name under which a source at a place is kept, in a building called `building`.
    pub(crate) fn name_of_source(&self, building: &str, [x, y, z]: [u32; 3]) -> String {
        let (samples, rays, order) = (self.response_samples(), self.ray_count, self.reflection_order);
        format!("{building}-{x:08x}{y:08x}{z:08x}-{samples}-{rays}-{order}-{VERSION}")
    }

    /// The farthest that sound comes from within a response, metres.
    pub(crate) fn reach_m(&self) -> f32 {
        self.response_s.max(0.0) * SPEED_OF_SOUND_M_S
    }
}
