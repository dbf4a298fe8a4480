use avln_geom::Vector3;

/// A number that grows linearly over the picture: `x·columns + y·rows + constant`, pixels from the middle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Plane {
    pub(crate) x: f32,
    pub(crate) y: f32,
    pub(crate) constant: f32,
}

/// A triangle as the rays through the picture see it.
///
/// For the ray d = (x, y, 1) and corners a, b, c seen from the eye, d·(b×c), d·(c×a) and d·(a×b) have the sign of the
/// triangle's volume a·(b×c) exactly when d passes through it, and are in proportion to its barycentric weights.
/// Neighbours compute the same numbers with opposite signs, so that no ray slips between them.
/// Source: Olano and Greer, "Triangle scan conversion using 2D homogeneous coordinates" (1997).
pub(crate) struct Outline {
    /// Positive inside; in proportion to the barycentric weights of the three corners.
    pub(crate) weights: [Plane; 3],
    /// One over the planar depth, 1/metres.
    pub(crate) nearness: Plane,
    /// What turns weights into barycentric weights over depth.
    pub(crate) scale: f32,
}

impl Plane {
    #[inline]
    pub(crate) fn at(&self, x: f32, y: f32) -> f32 {
        self.x * x + (self.y * y + self.constant)
    }

    /// The most that the plane changes over half of a square of pixels.
    #[inline]
    pub(crate) fn swing(&self, half_side_px: f32) -> f32 {
        (self.x.abs() + self.y.abs()) * half_side_px
    }

    fn from_vector(v: &Vector3<f64>) -> Self {
        Self { x: v.x as f32, y: v.y as f32, constant: v.z as f32 }
    }

    /// The plane `a·self + b·other`.
    pub(crate) fn mixed(&self, a: f32, other: &Self, b: f32) -> Self {
        let mix = |x: f32, y: f32| x * a + y * b;
        Self {
            x: mix(self.x, other.x),
            y: mix(self.y, other.y),
            constant: mix(self.constant, other.constant),
        }
    }
}

impl Outline {
    /// Of the triangle with these corners, camera frame; `None` when it is seen edge-on or has no area.
    #[inline]
    pub(crate) fn new(corners: &[Vector3<f32>; 3]) -> Option<Self> {
        let [a, b, c] = corners.map(|corner| corner.cast::<f64>());
        let normal = (b - a).cross(&(c - a));
        let volume = a.dot(&normal);
        let nearness = Plane::from_vector(&(normal / volume));
        if !(nearness.x + nearness.y + nearness.constant).is_finite() {
            return None;
        }
        let side = volume.signum();
        let weights = [b.cross(&c), c.cross(&a), a.cross(&b)].map(|w| Plane::from_vector(&(w * side)));
        Some(Self { weights, nearness, scale: (1.0 / volume.abs()) as f32 })
    }
}
