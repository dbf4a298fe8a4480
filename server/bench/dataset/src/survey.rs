use crate::cue::View;
use avln_episode::{Modality, Rules};
use avln_geom::{Aabb, Point3, Pose, Vector3, angle};
use avln_scene::{InstanceId, Object, categories};
use avln_truth::Target;
use avln_world::{NavPoint, SceneAssets};

/// Spacing of the sampled points of a success region, metres.
const REGION_SPACING_M: f32 = 0.25;
/// Fewest points of a success region that one can really stand in.
const MIN_REGION_POINTS: usize = 4;
/// Poses from which a target is looked at, spread over its region.
const LOOKS: usize = 10;
/// Viewpoints that are kept, best first.
const MAX_VIEWPOINTS: usize = 4;
/// Reference pictures of an image goal at most.
const MAX_IMAGES: usize = 3;
/// Side of the pictures with which visibility is checked, pixels.
const LOOK_SIDE_PX: u32 = 96;
/// Share of such a picture that a recognisable target fills at least.
const MIN_PICTURE_SHARE: f32 = 0.006;

/// An instance that can be a target: reachable, and recognisable from where one can stand.
#[derive(Clone, Debug)]
pub struct Instance {
    /// The target, with a modality that the mission overwrites.
    pub target: Target,
    /// Views of it, the one that shows most of it first; never empty.
    pub views: Vec<View>,
    /// Sentences that fit this instance of the scene alone, the plainest first; empty when words do not suffice.
    pub sentences: Vec<String>,
    /// One to three reference pictures that tell it from its kind, the best first; empty when pictures do not suffice.
    pub images: Vec<View>,
    /// Other instances of its category in the scene, 255 for more.
    pub distractors: u8,
}

/// Finds the instances of the target categories that are reachable from the largest island and can be seen.
pub fn survey(assets: &SceneAssets, rules: &Rules) -> Vec<Instance> {
    let candidates = assets.scene.objects.iter().filter(|object| categories::is_target(&object.category));
    candidates.filter_map(|object| inspect(assets, rules, object)).collect()
}

fn inspect(assets: &SceneAssets, rules: &Rules, object: &Object) -> Option<Instance> {
    let mut target = Target {
        instance: object.id.0,
        category: object.category.clone(),
        modality: Modality::Category,
        bounds: object.bounds,
        source: object.bounds.center(),
        floor_y_m: floor_below(assets, &object.bounds)?,
        region: Vec::new(),
        viewpoints: Vec::new(),
        start_distance_m: 0.0,
    };
    target.region = success_region(assets, rules, &target);
    if target.region.len() < MIN_REGION_POINTS {
        return None;
    }
    let views = views_of(assets, rules, object, &target.region);
    target.viewpoints = views.iter().map(|view| view.pose).collect();
    let sentences = crate::describe::describe(&assets.scene, object).into_iter().collect();
    let images = views.iter().take(MAX_IMAGES).map(View::as_cue).collect();
    let distractors = distractors(assets, object);
    (!views.is_empty()).then_some(Instance { target, views, sentences, images, distractors })
}

/// How many other objects of the scene share the category.
fn distractors(assets: &SceneAssets, object: &Object) -> u8 {
    let same = |other: &&Object| other.category == object.category && other.id != object.id;
    u8::try_from(assets.scene.objects.iter().filter(same).count()).unwrap_or(u8::MAX)
}

/// Height of the highest floor of the largest island near the box that is not above its lower half.
fn floor_below(assets: &SceneAssets, bounds: &Aabb) -> Option<f32> {
    const SEARCH_M: f32 = 1.5;
    let mut column = bounds.grown(SEARCH_M);
    column.min.y = bounds.min.y - 3.0;
    column.max.y = bounds.center().y;
    let floors = island_grid(assets, &column).into_iter().map(|point| point.position().y);
    floors.max_by(f32::total_cmp)
}

fn island_grid(assets: &SceneAssets, bounds: &Aabb) -> Vec<NavPoint> {
    let island = assets.navmesh.largest_island();
    let points = assets.navmesh.grid(bounds, REGION_SPACING_M);
    points.into_iter().filter(|point| assets.navmesh.island_of(point) == island).collect()
}

/// The grid points from which a Submit would count.
fn success_region(assets: &SceneAssets, rules: &Rules, target: &Target) -> Vec<Point3<f32>> {
    let mut around = target.bounds.grown(rules.success_radius_m);
    (around.min.y, around.max.y) = (target.floor_y_m - 1.0, target.floor_y_m + 1.0);
    let sees =
        |eye: &Point3<f32>, half_view_rad| assets.sees(eye, InstanceId(target.instance), half_view_rad);
    island_grid(assets, &around)
        .into_iter()
        .map(|point| point.position())
        .filter(|base| target.distance_within_region(base, rules, sees).is_some())
        .collect()
}

/// Views from places spread over the region, kept when the instance fills enough of the picture.
fn views_of(assets: &SceneAssets, rules: &Rules, object: &Object, region: &[Point3<f32>]) -> Vec<View> {
    let stride = region.len().div_ceil(LOOKS).max(1);
    let looks = region.iter().step_by(stride).map(|base| facing(base, &object.bounds.center()));
    let mut seen: Vec<_> = looks
        .map(|pose| View { pose, hfov_rad: 2.0 * Rules::HALF_VIEW_RAD, side_px: LOOK_SIDE_PX })
        .map(|view| (view.share_of(assets, rules, object.id), view))
        .filter(|(share, _)| *share >= MIN_PICTURE_SHARE)
        .collect();
    seen.sort_by(|a, b| b.0.total_cmp(&a.0));
    seen.into_iter().take(MAX_VIEWPOINTS).map(|(_, view)| view).collect()
}

/// The pose at `base` that faces `place`.
fn facing(base: &Point3<f32>, place: &Point3<f32>) -> Pose {
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
}
