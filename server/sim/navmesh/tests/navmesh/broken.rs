use crate::build::Builder;
use avln_geom::Point3;
use avln_navmesh::{Body, NavMesh, NavMeshError};
use avln_scene::Scene;

fn refusal(scene: &Scene, body: &Body) -> NavMeshError {
    NavMesh::build(scene, body).err().expect("nobody can stand here")
}

#[test]
fn scenes_without_floor_are_refused_with_a_reason() {
    let body = Body::default();
    let empty = refusal(&Builder::default().scene(), &body);
    assert!(matches!(empty, NavMeshError::Empty { .. }));
    assert!(empty.to_string().contains("`blocks`"), "{empty}");

    let shelf = Builder::default().floor([0.0; 3], [0.5, 0.0, 0.5]).scene();
    assert!(matches!(refusal(&shelf, &body), NavMeshError::NoFloor { .. }));
    let crawlway =
        Builder::default().floor([0.0; 3], [4.0, 0.0, 4.0]).block([0.0, 1.2, 0.0], [4.0, 1.4, 4.0]);
    let low = NavMesh::build(&crawlway.scene(), &body).expect("its roof");
    assert!(low.polygons().iter().flatten().all(|corner| corner.y > 1.3));
}

#[test]
fn a_mesh_that_is_none_is_refused() {
    let body = Body::default();
    let mut scene = Builder::default().floor([0.0; 3], [4.0, 0.0, 4.0]).scene();
    scene.mesh.triangles.push([0, 1, 9]);
    let error = refusal(&scene, &body);
    assert!(matches!(error, NavMeshError::Malformed { .. }));
    assert!(error.to_string().contains("triangle 2"), "{error}");
    scene.mesh.triangles.pop();
    scene.mesh.positions[1].y = f32::NAN;
    assert!(matches!(refusal(&scene, &body), NavMeshError::Malformed { .. }));
}

#[test]
fn a_point_is_no_floor_and_a_landscape_is_too_much() {
    let body = Body::default();
    let mut scene = Builder::default().floor([0.0; 3], [4.0, 0.0, 4.0]).scene();
    scene.mesh.positions.iter_mut().for_each(|corner| *corner = Point3::new(1.0, 2.0, 3.0));
    assert!(matches!(refusal(&scene, &body), NavMeshError::NoFloor { .. }));
    let landscape = Builder::default().floor([0.0; 3], [5000.0, 0.0, 5000.0]).scene();
    let error = refusal(&landscape, &body);
    assert!(matches!(error, NavMeshError::TooLarge { .. }));
    assert!(error.to_string().contains("5000.0 x 0.0 x 5000.0 m"), "{error}");
}

#[test]
fn impossible_bodies_are_refused() {
    let scene = Builder::default().floor([0.0; 3], [4.0, 0.0, 4.0]).scene();
    for body in [
        Body { radius_m: -0.1, ..Body::default() },
        Body { height_m: f32::NAN, ..Body::default() },
        Body { climb_m: 3.0, ..Body::default() },
        Body { slope_deg: 90.0, ..Body::default() },
    ] {
        assert!(matches!(refusal(&scene, &body), NavMeshError::Body { .. }), "{body:?}");
    }
}
