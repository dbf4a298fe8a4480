use crate::NavMeshError;

/// The upright cylinder that walks. The default is Habitat's: radius 0.1 m, height 1.5 m, climb 0.2 m, slope 45 degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// Distance from the centre to walls, metres, 0 to 2; rounded up to whole lattice cells of 5 cm, at least
    /// one.
    pub radius_m: f32,
    /// Headroom that is needed, metres, 0.2 to 10.
    pub height_m: f32,
    /// The highest step that is walked, metres, 0 to 1.
    pub climb_m: f32,
    /// The steepest slope that is walked, degrees, 0 to 89.
    pub slope_deg: f32,
}

impl Default for Body {
    fn default() -> Self {
        Self { radius_m: 0.1, height_m: 1.5, climb_m: 0.2, slope_deg: 45.0 }
    }
}

impl Body {
    /// Refuses measures outside of the ranges that the fields name.
    pub(crate) fn check(&self) -> Result<(), NavMeshError> {
        let checks = [
            ("radius_m", self.radius_m, 0.0, 2.0),
            ("height_m", self.height_m, 0.2, 10.0),
            ("climb_m", self.climb_m, 0.0, 1.0),
            ("slope_deg", self.slope_deg, 0.0, 89.0),
        ];
        for (field, value, low, high) in checks {
            if !(low..=high).contains(&value) {
                return Err(NavMeshError::Body { field, value, low, high });
            }
        }
        Ok(())
    }
}
