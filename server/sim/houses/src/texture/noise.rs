use avln_geom::Rng;

/// Texels per side of a pattern.
pub(super) const SIZE: u32 = 64;

/// Repeatable noise on the texel grid, 0 to 1, that repeats with the picture.
pub(super) struct Noise(Vec<f32>);

impl Noise {
    pub(super) fn new(seed: u64) -> Self {
        let mut rng = Rng::new(seed);
        Self((0..SIZE * SIZE).map(|_| rng.unit() as f32).collect())
    }

    pub(super) fn at(&self, x: u32, y: u32) -> f32 {
        self.0[((y % SIZE) * SIZE + x % SIZE) as usize]
    }

    /// Noise on a grid of `step_x` by `step_y` texels, linear in between.
    pub(super) fn smooth(&self, x: u32, y: u32, step_x: u32, step_y: u32) -> f32 {
        let split = |value: u32, step: u32| (value / step * step, (value % step) as f32 / step as f32);
        let ((x0, fx), (y0, fy)) = (split(x, step_x), split(y, step_y));
        let row = |y: u32| self.at(x0, y) * (1.0 - fx) + self.at(x0 + step_x, y) * fx;
        row(y0) * (1.0 - fy) + row(y0 + step_y) * fy
    }
}
