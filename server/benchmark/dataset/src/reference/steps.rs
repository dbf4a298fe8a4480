use avln_episode::Rules;
use avln_geom::{Point3, Pose, angle};
use std::f32::consts::TAU;

/// Legs shorter than this turn nobody, metres.
const SHORTEST_LEG_M: f32 = 1e-3;

/// Actions of a tour: moves, turns and one Submit or Stop a goal.
///
/// Moves are the length over the length of one move, rounded up once for the whole tour; turns are those from the
/// heading nearest to one leg to the heading nearest to the next, among the headings that the body can take.
pub(crate) fn reference_steps(
    rules: &Rules,
    start: &Pose,
    path: &[Point3<f32>],
    length_m: f64,
    goals: usize,
) -> u32 {
    let moves = (length_m / f64::from(rules.forward_m) - 1e-6).ceil().max(0.0) as u32;
    let headings = (360 / rules.turn_deg.max(1)).max(1) as i32;
    let unit_rad = TAU / headings as f32;
    let (mut heading, mut turns) = (0, 0);
    for leg in path.windows(2).map(|leg| leg[1] - leg[0]) {
        if leg.xz().norm() < SHORTEST_LEG_M {
            continue;
        }
        let bearing_rad = angle::atan2(-leg.x, -leg.z) - start.heading_rad;
        let wanted = ((bearing_rad / unit_rad).round() as i32).rem_euclid(headings);
        let around = (wanted - heading).rem_euclid(headings);
        turns += around.min(headings - around) as u32;
        heading = wanted;
    }
    moves + turns + goals as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_l_takes_its_moves_its_turns_and_its_claims() {
        let path = [[0.0, 0.0], [0.0, -1.0], [1.1, -1.0]].map(|[x, z]| Point3::new(x, 0.0, z));
        let start = Pose::new(path[0], 0.0);
        // 2.1 m are 9 moves, the corner is 3 turns to the right, and there are 2 goals.
        assert_eq!(reference_steps(&Rules::paper(), &start, &path, 2.1, 2), 9 + 3 + 2);
        // Looking back at first costs 6 turns; a heading 10 degrees off is none.
        let back = Pose::new(path[0], std::f32::consts::PI);
        assert_eq!(reference_steps(&Rules::paper(), &back, &path, 2.1, 2), 6 + 9 + 3 + 2);
        let askew = Pose::new(path[0], 10_f32.to_radians());
        assert_eq!(reference_steps(&Rules::paper(), &askew, &path, 2.1, 2), 9 + 3 + 2);
    }
}
