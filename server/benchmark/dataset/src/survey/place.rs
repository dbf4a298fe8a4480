//! Success regions and viewpoints of targets.

use avln_episode::{Modality, Rules};
use avln_geom::{Aabb, Point3, Pose, Vector3, angle};
use avln_scene::{InstanceId, Object};
use avln_truth::Target;
use avln_world::{NavPoint, SceneAssets};
use std::f32::consts::TAU;

/// Spacing of the sampled points of a success region, metres.
const REGION_SPACING_M: f32 = 0.25;
/// Fewest points of a success region.
const MIN_REGION_POINTS: usize = 4;
/// Largest distance of an imported viewpoint from the walkable floor, metres.
const SNAP_M: f32 = 0.5;
/// Most viewpoints of an imported target.
const MAX_VIEWPOINTS: usize = 12;

/// Returns the target for an object with the success region, without viewpoints; `None` if the region is too small.
pub(crate) fn target_without_views(
    assets: &SceneAssets,
    rules: &Rules,
    object: &Object,
    category: &str,
) -> Option<Target> {
    let mut target = Target {
        instance: object.id.0,
        category: category.to_owned(),
        modality: Modality::Category,
        bounds: object.bounds,
        source: object.bounds.center(),
        floor_y_m: floor_below(assets, &object.bounds)?,
        region: Vec::new(),
        viewpoints: Vec::new(),
        start_distance_m: 0.0,
    };
    target.region = success_region(assets, rules, &target);
    (target.region.len() >= MIN_REGION_POINTS).then_some(target)
}

/// Returns the target for an imported object. Uses the given viewpoints near the floor; without any, spreads
/// viewpoints over the success region. `None` if the region is too small.
pub fn target_at(
    assets: &SceneAssets,
    rules: &Rules,
    object: &Object,
    category: &str,
    viewpoints: &[Pose],
) -> Option<Target> {
    let mut target = target_without_views(assets, rules, object, category)?;
    let snapped = viewpoints.iter().filter_map(|pose| {
        let point = assets.navmesh.snap(&pose.position, SNAP_M)?;
        Some(Pose::new(point.position(), pose.heading_rad))
    });
    target.viewpoints = snapped.take(MAX_VIEWPOINTS).collect();
    if target.viewpoints.is_empty() {
        let center = object.bounds.center();
        let bases = spread(&target.region, &center, MAX_VIEWPOINTS);
        target.viewpoints = bases.iter().map(|base| facing(base, &center)).collect();
    }
    Some(target)
}

/// Highest floor near the box on the largest island, not above the box centre.
fn floor_below(assets: &SceneAssets, bounds: &Aabb) -> Option<f32> {
    const SEARCH_M: f32 = 1.5;
    let mut column = bounds.grown(SEARCH_M);
    // 3 m below reaches the floor under objects on furniture and under ceiling lamps. The centre is the upper limit, so
    // that no upper storey is chosen.
    column.min.y = bounds.min.y - 3.0;
    column.max.y = bounds.center().y;
    let floors = island_grid(assets, &column).into_iter().map(|point| point.position().y);
    floors.max_by(f32::total_cmp)
}

fn island_grid(assets: &SceneAssets, bounds: &Aabb) -> Vec<NavPoint> {
    // Other islands are unreachable: table tops, closed rooms, the roof.
    let island = assets.navmesh.largest_island();
    let points = assets.navmesh.grid(bounds, REGION_SPACING_M);
    points.into_iter().filter(|point| assets.navmesh.island_of(point) == island).collect()
}

/// Grid points with a valid Submit.
fn success_region(assets: &SceneAssets, rules: &Rules, target: &Target) -> Vec<Point3<f32>> {
    let mut around = target.bounds.grown(rules.success_radius_m);
    (around.min.y, around.max.y) = (target.floor_y_m - 1.0, target.floor_y_m + 1.0);
    let points = island_grid(assets, &around).into_iter().map(|point| point.position());
    points.filter(|base| counts(assets, rules, target, base)).collect()
}

/// Returns true if a Submit for the target counts at `base`.
pub(crate) fn counts(assets: &SceneAssets, rules: &Rules, target: &Target, base: &Point3<f32>) -> bool {
    let instance = InstanceId(target.instance);
    let to_mesh_m = |eye: &Point3<f32>| assets.distance_to_mesh_m(eye, instance);
    let sees = |eye: &Point3<f32>, half_view_rad| assets.sees(eye, instance, half_view_rad);
    target.distance_within_region(base, rules, to_mesh_m, sees).is_some()
}

/// Chooses up to `count` places in all directions from `center`, near and distant in turn.
pub(crate) fn spread(places: &[Point3<f32>], center: &Point3<f32>, count: usize) -> Vec<Point3<f32>> {
    let sectors = count.max(1);
    let mut around: Vec<Vec<(f32, Point3<f32>)>> = vec![Vec::new(); sectors];
    for place in places {
        let offset = place - center;
        let turn = (angle::atan2(offset.z, offset.x) / TAU + 1.0).fract();
        let sector = ((turn * sectors as f32) as usize).min(sectors - 1);
        around[sector].push((offset.norm(), *place));
    }
    around.iter_mut().for_each(|sector| sector.sort_by(|a, b| a.0.total_cmp(&b.0)));
    // Middle distance per sector first, then farther and nearer.
    let rounds = [(1, 2), (5, 6), (1, 6), (2, 3), (1, 3)];
    let mut chosen: Vec<Point3<f32>> = Vec::new();
    for (over, under) in rounds {
        // Opposite sectors alternate: a few looks already cover all sides.
        for sector in (0..2).flat_map(|half| (half..sectors).step_by(2)).map(|sector| &around[sector]) {
            let Some((_, place)) = sector.get(sector.len() * over / under) else { continue };
            if chosen.len() < count && !chosen.contains(place) {
                chosen.push(*place);
            }
        }
    }
    chosen
}

pub(crate) fn facing(base: &Point3<f32>, place: &Point3<f32>) -> Pose {
    let offset: Vector3<f32> = place - base;
    Pose::new(*base, angle::atan2(-offset.x, -offset.z))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn facing_looks_at_the_place() {
        let pose = facing(&Point3::new(1.0, 0.0, 1.0), &Point3::new(-2.0, 1.0, 1.0));
        assert!((pose.forward() - Vector3::new(-1.0, 0.0, 0.0)).norm() < 1e-6);
    }

    #[test]
    fn places_are_spread_over_all_sides() {
        let ring = |i: usize| {
            let (sin, cos) = angle::sin_cos(i as f32 * TAU / 40.0);
            Point3::new(2.0 + 1.5 * cos, 0.0, 1.5 * sin)
        };
        let places: Vec<_> = (0..40).map(ring).collect();
        let center = Point3::new(2.0, 0.5, 0.0);
        let chosen = spread(&places, &center, 4);
        assert_eq!(chosen.len(), 4);
        let sides: std::collections::BTreeSet<_> =
            chosen.iter().map(|place| (place.x > 2.0, place.z > 0.0)).collect();
        assert_eq!(sides.len(), 4, "{chosen:?}");
        assert_eq!(spread(&places[..3], &center, 10).len(), 3, "no place twice");
        assert!(spread(&[], &center, 4).is_empty());
    }
}
