//! Reference tours: shortest paths from a start through all success regions.

mod atlas;

use atlas::Way;
pub(crate) use atlas::{Atlas, Departure};
use avln_episode::Rules;
use avln_geom::{Point3, Pose, angle};
use std::f32::consts::TAU;

/// Shortest leg with a turn, metres.
const SHORTEST_LEG_M: f32 = 1e-3;

/// Tour without step count.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Tour {
    pub(crate) length_m: f64,
    pub(crate) path: Vec<Point3<f32>>,
}

/// Least cost per point in a region, metres; infinite if unreachable.
type Costs = Vec<f64>;

/// Shortest tour in this order, exact over the sampled points (dynamic programming); `None` if one is unreachable.
#[tracing::instrument(level = "debug", name = "reference_tour", skip_all, fields(order = "ordered"))]
pub(crate) fn ordered(atlas: &Atlas, start: &Departure, regions: &[usize]) -> Option<Tour> {
    let (&first, rest) = regions.split_first()?;
    let mut stages: Vec<Costs> = vec![atlas.depart(start, first)];
    for (&to, &from) in rest.iter().zip(regions) {
        let before = stages.last()?;
        stages.push(atlas.onward(from, before, to));
    }
    // Predecessors are searched backwards for the best tour only: storing them for all points would cost more.
    let (mut stand, length_m) = cheapest(stages.last()?)?;
    let mut tail = Vec::new();
    for stage in (1..regions.len()).rev() {
        let (from, to) = (regions[stage - 1], regions[stage]);
        let (before, way) = arrival(atlas, from, &stages[stage - 1], (to, stand))?;
        prepend(&mut tail, atlas.leg((from, before), (to, stand), &way));
        stand = before;
    }
    prepend(&mut tail, atlas.first_leg(start, (first, stand)));
    Some(Tour { length_m, path: tail })
}

/// Returns the shortest tour over all orders (Bellman 1962, Held and Karp 1962).
#[tracing::instrument(level = "debug", name = "reference_tour", skip_all, fields(order = "unordered"))]
pub(crate) fn unordered(atlas: &Atlas, start: &Departure, regions: &[usize]) -> Option<Tour> {
    let table = Table::fill(atlas, start, regions);
    let mut visited = (1 << regions.len()) - 1;
    let ends = (0..regions.len()).filter_map(|last| Some((last, cheapest(table.costs(visited, last))?)));
    let (mut last, (mut stand, length_m)) = ends.min_by(|a, b| a.1.1.total_cmp(&b.1.1))?;
    let mut tail = Vec::new();
    loop {
        let before = visited & !(1 << last);
        let to = (regions[last], stand);
        if before == 0 {
            prepend(&mut tail, atlas.first_leg(start, to));
            return Some(Tour { length_m, path: tail });
        }
        let earlier = (0..regions.len()).filter(|earlier| before >> earlier & 1 == 1);
        let came = earlier.filter_map(|earlier| {
            let (stand, way) = arrival(atlas, regions[earlier], table.costs(before, earlier), to)?;
            Some((earlier, stand, way, table.costs(before, earlier)[stand] + way.distance_m))
        });
        let (earlier, from, way, _) = came.min_by(|a, b| a.3.total_cmp(&b.3))?;
        prepend(&mut tail, atlas.leg((regions[earlier], from), to, &way));
        (visited, last, stand) = (before, earlier, from);
    }
}

/// Costs per visited set and last region.
struct Table {
    regions: usize,
    costs: Vec<Costs>,
}

impl Table {
    fn fill(atlas: &Atlas, start: &Departure, regions: &[usize]) -> Self {
        let count = regions.len();
        // 2^n sets with n ends. Missions have at most 8 goals, so the table has at most 2,048 rows.
        let mut table = Self { regions: count, costs: vec![Costs::new(); count << count] };
        for visited in 1_usize..1 << count {
            for last in (0..count).filter(|last| visited >> last & 1 == 1) {
                let before = visited & !(1 << last);
                let costs = if before == 0 {
                    atlas.depart(start, regions[last])
                } else {
                    let earlier = (0..count).filter(|earlier| before >> earlier & 1 == 1);
                    let ways = earlier
                        .map(|from| atlas.onward(regions[from], table.costs(before, from), regions[last]));
                    ways.reduce(least).unwrap_or_default()
                };
                table.costs[visited * count + last] = costs;
            }
        }
        table
    }

    fn costs(&self, visited: usize, last: usize) -> &Costs {
        &self.costs[visited * self.regions + last]
    }
}

fn least(mut a: Costs, b: Costs) -> Costs {
    a.iter_mut().zip(b).for_each(|(a, b)| *a = a.min(b));
    a
}

/// Cheapest reachable point, and the cost.
fn cheapest(costs: &Costs) -> Option<(usize, f64)> {
    let best = costs.iter().copied().enumerate().min_by(|a, b| a.1.total_cmp(&b.1))?;
    best.1.is_finite().then_some(best)
}

/// Predecessor point in `from` on the cheapest path to the point `to`.
fn arrival(atlas: &Atlas, from: usize, costs: &Costs, to: (usize, usize)) -> Option<(usize, Way)> {
    let ways = atlas.back(to, from);
    let all = ways.into_iter().enumerate();
    let (stand, way) =
        all.min_by(|(a, x), (b, y)| (costs[*a] + x.distance_m).total_cmp(&(costs[*b] + y.distance_m)))?;
    way.distance_m.is_finite().then_some((stand, way))
}

/// Prepends `leg` to `tail`; they share a point.
fn prepend(tail: &mut Vec<Point3<f32>>, mut leg: Vec<Point3<f32>>) {
    leg.append(tail);
    leg.dedup();
    *tail = leg;
}

/// Action count for a tour: moves (length over step length, rounded up once), turns between the allowed headings
/// closest to consecutive legs, a claim per goal.
pub(crate) fn reference_steps(
    rules: &Rules,
    start: &Pose,
    path: &[Point3<f32>],
    length_m: f64,
    goals: usize,
) -> u32 {
    // The margin: the length is a rounded sum, and exactly n moves must stay n.
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
    fn steps_count_moves_turns_and_claims() {
        let path = [[0.0, 0.0], [0.0, -1.0], [1.1, -1.0]].map(|[x, z]| Point3::new(x, 0.0, z));
        let start = Pose::new(path[0], 0.0);
        // 2.1 m are 9 moves, the corner has 3 right turns, and there are 2 goals.
        assert_eq!(reference_steps(&Rules::paper(), &start, &path, 2.1, 2), 9 + 3 + 2);
        // A start in the opposite direction costs 6 turns; a heading 10 degrees off costs none.
        let back = Pose::new(path[0], std::f32::consts::PI);
        assert_eq!(reference_steps(&Rules::paper(), &back, &path, 2.1, 2), 6 + 9 + 3 + 2);
        let askew = Pose::new(path[0], 10_f32.to_radians());
        assert_eq!(reference_steps(&Rules::paper(), &askew, &path, 2.1, 2), 9 + 3 + 2);
    }
}
