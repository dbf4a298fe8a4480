use avln_episode::{DistanceRule, Rules};
use avln_truth::Target;
use avln_world::{Camera, DistanceField, InstanceId, NavPoint, SceneAssets, World};

/// Picture side for the pixel test in the authors' rule.
const LOOK_SIDE_PX: u32 = 128;
/// Largest snap distance from a stored point to the mesh, metres.
const SNAP_M: f32 = 0.5;

/// Test for success regions.
pub(crate) struct SuccessTest {
    rule: DistanceRule,
    /// Per target: walking distance to the success region.
    to_region: Vec<DistanceField>,
    /// Per target: walking distance to the viewpoints.
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

    /// Returns the distance to `goal` by the rules' measure, if the body is in the success region.
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

    /// True if the body is within the success radius and in sight of another instance in the target's category.
    /// Measured from camera to box under every rule set.
    pub(crate) fn is_at_distractor(world: &World, target: &Target, rules: &Rules) -> bool {
        let assets = world.assets();
        let base = world.pose().position;
        let distractors =
            assets.scene.objects.iter().filter(|object| {
                object.category == target.category && object.id != InstanceId(target.instance)
            });
        distractors.into_iter().any(|object| {
            let sees = |eye: &_, half_view_rad| assets.sees(eye, object.id, half_view_rad);
            // Its floor is unknown. Anything visible within the radius is on the body's floor.
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

    /// Walking distance from the body to the success region of `goal`, metres.
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
