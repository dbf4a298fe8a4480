use avln_episode::{DistanceRule, Rules};
use avln_truth::Target;
use avln_world::{Camera, DistanceField, InstanceId, NavPoint, SceneAssets, World};

/// Side of the picture in which the authors' rule looks for a pixel of the target.
const LOOK_SIDE_PX: u32 = 128;
/// How far from the mesh a stored place may lie and still be snapped to it, metres.
const SNAP_M: f32 = 0.5;

/// Decides whether the body stands in a target's success region.
pub(crate) struct SuccessTest {
    rule: DistanceRule,
    /// For each target: walking distance to its success region.
    to_region: Vec<DistanceField>,
    /// For each target: walking distance to its viewpoints.
    to_viewpoint: Vec<DistanceField>,
}

impl SuccessTest {
    pub(crate) fn new(assets: &SceneAssets, targets: &[Target], rules: &Rules) -> Self {
        let field = |places: &mut dyn Iterator<Item = avln_episode::Point3<f32>>| {
            let seeds: Vec<(NavPoint, f64)> = places
                .filter_map(|place| assets.navmesh.snap(&place, SNAP_M))
                .map(|point| (point, 0.0))
                .collect();
            assets.navmesh.field(&seeds)
        };
        Self {
            rule: rules.success_distance,
            to_region: targets.iter().map(|t| field(&mut t.region.iter().copied())).collect(),
            to_viewpoint: targets
                .iter()
                .map(|t| field(&mut t.viewpoints.iter().map(|v| v.position)))
                .collect(),
        }
    }

    /// How far the body is from goal `goal` by the measure of the rules, when it stands in its success region.
    pub(crate) fn distance_within(
        &self,
        world: &World,
        goal: usize,
        target: &Target,
        rules: &Rules,
    ) -> Option<f64> {
        match self.rule {
            DistanceRule::CameraToBox => {
                let assets = world.assets();
                let sees =
                    |eye: &_, half_view_rad| assets.sees(eye, InstanceId(target.instance), half_view_rad);
                target.distance_within_region(&world.pose().position, rules, sees)
            }
            DistanceRule::BaseToViewpoint => {
                let distance_m =
                    self.to_viewpoint[goal].distance_m(&world.assets().navmesh, &world.standing())?;
                let near = distance_m < f64::from(rules.success_radius_m);
                (near && in_picture(world, target, rules)).then_some(distance_m)
            }
        }
    }

    /// Whether the body stands within the radius of success of the box of another instance of the target's category,
    /// in sight of it. Under every rule set this is measured from the camera to the box.
    pub(crate) fn is_at_distractor(world: &World, target: &Target, rules: &Rules) -> bool {
        let assets = world.assets();
        let base = world.pose().position;
        let distractors =
            assets.scene.objects.iter().filter(|object| {
                object.category == target.category && object.id != InstanceId(target.instance)
            });
        distractors.into_iter().any(|object| {
            let sees = |eye: &_, half_view_rad| assets.sees(eye, object.id, half_view_rad);
            // Its own floor is not known: what is in sight within the radius is on the floor where the body stands.
            let it = Target {
                instance: object.id.0,
                bounds: object.bounds,
                floor_y_m: base.y,
                region: Vec::new(),
                viewpoints: Vec::new(),
                category: String::new(),
                ..*target
            };
            it.distance_within_region(&base, rules, sees).is_some()
        })
    }

    /// Walking distance from where the body stands to the success region of goal `goal`, metres.
    pub(crate) fn walk_m(&self, world: &World, goal: usize) -> Option<f64> {
        self.to_region[goal].distance_m(&world.assets().navmesh, &world.standing())
    }
}

fn in_picture(world: &World, target: &Target, rules: &Rules) -> bool {
    let camera = Camera {
        eye: world.eye(),
        world_from_camera: world.pose().rotation(),
        width: LOOK_SIDE_PX,
        height: LOOK_SIDE_PX,
        hfov_rad: 2.0 * Rules::HALF_VIEW_RAD,
        depth_max_m: rules.depth_max_m,
    };
    world.assets().render(&camera).instances.contains(&InstanceId(target.instance))
}
