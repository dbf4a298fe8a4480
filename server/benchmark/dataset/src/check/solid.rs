//! Start poses and lines of sight by parry, independent of the navmesh and of the scene's ray tree.

use avln_episode::Rules;
use avln_geom::{Capsule, Point3, QueryMesh, Vector3};
use avln_scene::InstanceId;
use avln_world::{Body, SceneAssets};

/// Rounding of the navmesh: a cell and a level of 5 cm, metres.
const ROUNDING_M: f32 = 0.051;
/// Radius of a body's axis in messages, metres.
const AXIS_M: f32 = 0.005;
/// Largest gap between a hit and the aimed surface point, metres.
const TOLERANCE_M: f32 = 0.01;

/// A scene's triangles for a second opinion.
pub(super) struct Solid<'a> {
    assets: &'a SceneAssets,
    rules: &'a Rules,
    mesh: Option<QueryMesh>,
}

impl<'a> Solid<'a> {
    pub(super) fn new(assets: &'a SceneAssets, rules: &'a Rules) -> Self {
        let mesh = &assets.scene.mesh;
        let mesh = QueryMesh::new(&mesh.positions, (0..).zip(mesh.triangles.iter().copied()));
        Self { assets, rules, mesh }
    }

    /// Returns the problem with a body that stands at `base`.
    pub(super) fn stand_fault(&self, base: &Point3<f32>) -> Option<String> {
        let mesh = self.mesh.as_ref()?;
        let climb_m = Body::default().climb_m;
        let (radius_m, height_m) = (self.rules.body_radius_m, self.rules.body_height_m);
        let body = Capsule {
            base: *base,
            radius_m: (radius_m - ROUNDING_M).max(0.5 * radius_m),
            height_m: height_m - ROUNDING_M,
        };
        // Surfaces below the highest step are floor, not obstacles.
        let lift_m = climb_m + ROUNDING_M;
        let body = body.without_feet(lift_m);
        if mesh.intersects(&body) {
            let axis = Capsule { radius_m: AXIS_M, ..body };
            let room_m = mesh.clearance_m(&axis) + AXIS_M;
            return Some(format!(
                "a body of radius {radius_m} m and height {height_m} m does not fit at {base}: {room_m:.3} m are free around its axis"
            ));
        }
        let reach_m = lift_m + climb_m + ROUNDING_M;
        let stands = mesh.cast_capsule(&body, &-Vector3::y(), reach_m).is_some();
        (!stands).then(|| format!("no floor is within {climb_m} m below {base}"))
    }

    /// Returns true if a sampled surface point of `instance` is visible from the camera at `base` by parry's rays too.
    pub(super) fn confirms_sight(&self, base: &Point3<f32>, instance: InstanceId) -> bool {
        let eye = base + Vector3::y() * self.rules.camera_height_m;
        let mut points = self.assets.visible_points(&eye, instance, Rules::HALF_VIEW_RAD);
        points.any(|point| self.shows(&eye, point, instance))
    }

    fn shows(&self, eye: &Point3<f32>, point: &Point3<f32>, instance: InstanceId) -> bool {
        let offset = point - eye;
        let reach = 1.0 + TOLERANCE_M / offset.norm().max(TOLERANCE_M);
        let hit = self.mesh.as_ref().and_then(|mesh| mesh.cast(eye, &offset, reach));
        hit.is_some_and(|(triangle, _)| self.assets.scene.mesh.instance_of[triangle as usize] == instance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_scene::{RoomPlan, Scene};

    /// A room of 4 m by 4 m with a corner at the origin; the last triangle is instance 1.
    fn room() -> SceneAssets {
        let mut scene: Scene = RoomPlan::shoebox(4.0, 4.0, 2.5).expect("a room").scene();
        let last = scene.mesh.instance_of.last_mut().expect("triangles");
        *last = InstanceId(1);
        SceneAssets::prepare(scene, &Body::default()).expect("a floor")
    }

    #[test]
    fn bodies_need_room_and_a_floor() {
        let (assets, rules) = (room(), Rules::paper());
        let bounds = assets.scene.bounds().expect("walls");
        let solid = Solid::new(&assets, &rules);
        let at = |x: f32, y: f32| Point3::new(bounds.min.x + x, y, bounds.center().z);
        assert_eq!(solid.stand_fault(&at(2.0, 0.0)), None);
        assert_eq!(solid.stand_fault(&at(0.1, 0.0)), None, "a radius from the wall");
        let fault = |place: Point3<f32>| solid.stand_fault(&place).expect("a fault");
        assert!(fault(at(0.03, 0.0)).contains("does not fit"));
        assert!(fault(at(2.0, 1.2)).contains("does not fit"), "the ceiling");
        assert!(fault(at(2.0, 0.6)).contains("no floor"));
    }

    #[test]
    fn sight_is_confirmed_for_visible_instances() {
        let (assets, rules) = (room(), Rules::paper());
        let solid = Solid::new(&assets, &rules);
        let mut base = assets.scene.bounds().expect("walls").center();
        base.y = 0.0;
        assert!(solid.confirms_sight(&base, InstanceId(1)));
        base.x += 9.0;
        assert!(!solid.confirms_sight(&base, InstanceId(1)), "behind a wall, or without it");
        assert!(!solid.confirms_sight(&base, InstanceId(2)), "no such instance");
    }
}
