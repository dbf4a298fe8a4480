/// Distances, metres, and how loud a source in sight is there, in terms of [`LEVEL_AT_1_M`]: geometric means over walks through
/// twenty missions in ten furnished houses of the training pool. Rooms add late sound, so that the level falls slowly inside of
/// one and faster from room to room.
const CURVE: [[f32; 2]; 8] =
    [[0.5, 3.4], [1.25, 2.0], [2.25, 1.55], [3.25, 1.3], [4.5, 0.8], [7.0, 0.3], [9.5, 0.17], [15.0, 0.06]];
/// Level of a source 1 m away in the free field.
const LEVEL_AT_1_M: f32 = 0.05;

/// How loud a source is expected to be that is `distance_m` away and in sight.
pub fn expected_level(distance_m: f32) -> f32 {
    let logs = CURVE.map(|[distance_m, level]| [distance_m.ln(), level.ln()]);
    LEVEL_AT_1_M * between(&logs, distance_m.max(0.05).ln()).exp()
}

/// How far away a source of this level is expected to be, metres, 0.1 to 100.
pub fn range_m(level: f32) -> f32 {
    let mut logs = CURVE.map(|[distance_m, level]| [level.ln(), distance_m.ln()]);
    logs.reverse();
    between(&logs, (level.max(1e-6) / LEVEL_AT_1_M).ln()).exp().clamp(0.1, 100.0)
}

/// The value at `x` of the straight lines between points whose x rises; the first and the last line go on.
fn between<const N: usize>(points: &[[f32; 2]; N], x: f32) -> f32 {
    let passed = points[1..N - 1].iter().take_while(|[px, _]| *px < x).count();
    let ([x0, y0], [x1, y1]) = (points[passed], points[passed + 1]);
    y0 + (y1 - y0) * (x - x0) / (x1 - x0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn level_and_range_are_inverse() {
        for distance_m in [0.4, 0.75, 2.0, 3.5, 6.0, 12.0, 30.0] {
            let told_m = range_m(expected_level(distance_m));
            assert!((told_m / distance_m - 1.0).abs() < 1e-3, "{distance_m}: {told_m}");
        }
        assert!((expected_level(4.5) - 0.04).abs() < 1e-6 && range_m(0.0) == 100.0 && range_m(9.0) == 0.1);
    }

    #[test]
    fn level_falls_with_distance() {
        let levels: Vec<f32> = (1..80).map(|quarter| expected_level(0.25 * quarter as f32)).collect();
        assert!(levels.is_sorted_by(|a, b| a > b), "{levels:?}");
    }
}
