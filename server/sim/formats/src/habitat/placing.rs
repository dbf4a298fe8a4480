//! Where an asset stands: from its own frame to the world's.

use super::config::{Instance, Origin};
use super::templates::Template;
use crate::files::Checked;
use avln_geom::{Aabb, Point3};
use avln_scene::Mesh;
use nalgebra::{Matrix3, Matrix4, Quaternion, UnitQuaternion, Vector3};

/// Directions shorter than this, and quaternions, have no direction.
const TINY: f64 = 1e-6;
/// Scales beyond this are mistakes.
const MAX_SCALE: f64 = 1.0e4;

/// World from asset of the stage, which always stands on its own origin.
pub(super) fn stage(template: &Template, instance: &Instance) -> Checked<Matrix4<f64>> {
    Ok(motion(instance)? * upright(template, instance)?)
}

/// World from asset of an object: T · R · (-C) · S · F, with the centre C of habitat-sim's `RigidObject`.
pub(super) fn object(
    template: &Template,
    instance: &Instance,
    origin: Origin,
    mesh: &Mesh,
) -> Checked<Matrix4<f64>> {
    let upright = upright(template, instance)?;
    let center = match origin {
        Origin::Asset => Vector3::zeros(),
        Origin::CenterOfMass => center(template, instance, mesh, &upright)?,
    };
    Ok(motion(instance)? * Matrix4::new_translation(&-center) * upright)
}

fn center(
    template: &Template,
    instance: &Instance,
    mesh: &Mesh,
    upright: &Matrix4<f64>,
) -> Checked<Vector3<f64>> {
    if let Some(given) = template.center_of_mass {
        return Ok(scale(template, instance)?.component_mul(&Vector3::from(given)));
    }
    let corners: Vec<Point3<f32>> =
        mesh.positions.iter().map(|point| upright.transform_point(&point.cast()).cast()).collect();
    Ok(Aabb::around(&corners).map_or(Vector3::zeros(), |bounds| bounds.center().coords.cast()))
}

/// Scale and frame: the asset standing upright at the origin.
fn upright(template: &Template, instance: &Instance) -> Checked<Matrix4<f64>> {
    Ok(Matrix4::new_nonuniform_scaling(&scale(template, instance)?) * frame(template)?)
}

fn scale(template: &Template, instance: &Instance) -> Checked<Vector3<f64>> {
    let own =
        Vector3::from(template.scale) * template.units_to_meters * instance.uniform_scale.unwrap_or(1.0);
    let scale = own.component_mul(&Vector3::from(instance.non_uniform_scale.unwrap_or([1.0; 3])));
    let sane = |factor: &f64| factor.is_finite() && (1.0 / MAX_SCALE..=MAX_SCALE).contains(&factor.abs());
    if scale.iter().all(sane) {
        Ok(scale)
    } else {
        Err(format!("is scaled by {} x {} x {}; correct its scale", scale.x, scale.y, scale.z))
    }
}

fn motion(instance: &Instance) -> Checked<Matrix4<f64>> {
    let [w, x, y, z] = instance.rotation.unwrap_or([1.0, 0.0, 0.0, 0.0]);
    let quaternion = Quaternion::new(w, x, y, z);
    let rotation = UnitQuaternion::try_new(quaternion, TINY)
        .filter(|rotation| rotation.coords.iter().all(|part| part.is_finite()))
        .ok_or_else(|| {
            format!("has rotation [{w}, {x}, {y}, {z}], which is no quaternion w, x, y, z; correct it")
        })?;
    Ok(rotation.to_homogeneous().append_translation(&Vector3::from(instance.translation)))
}

/// The rotation that carries `up` to +Y and `front` to -Z.
fn frame(template: &Template) -> Checked<Matrix4<f64>> {
    let Template { up, front, .. } = template;
    let fail = || format!("has up {up:?} and front {front:?}, which make no frame; correct them");
    let up = Vector3::from(*up).try_normalize(TINY).ok_or_else(fail)?;
    let front = Vector3::from(*front);
    let front = (front - up * up.dot(&front)).try_normalize(TINY).ok_or_else(fail)?;
    let rows = [front.cross(&up), up, -front].map(|row| row.transpose());
    Ok(Matrix3::from_rows(&rows).to_homogeneous())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn template(up: [f64; 3], front: [f64; 3]) -> Template {
        Template { up, front, ..Template::default() }
    }

    fn image(matrix: &Matrix4<f64>, point: [f64; 3]) -> [f64; 3] {
        matrix.transform_point(&Point3::from(point)).coords.map(|value| (value * 1e9).round() / 1e9).into()
    }

    #[test]
    fn up_and_front_become_y_and_minus_z() {
        let turned = stage(&template([0.0, 0.0, 1.0], [0.0, 1.0, 0.0]), &Instance::default()).unwrap();
        // (x, y, z) becomes (x, z, -y).
        assert_eq!(image(&turned, [1.0, 2.0, 3.0]), [1.0, 3.0, -2.0]);
        let plain = stage(&Template::default(), &Instance::default()).unwrap();
        assert_eq!(image(&plain, [1.0, 2.0, 3.0]), [1.0, 2.0, 3.0]);
        let error = stage(&template([0.0, 1.0, 0.0], [0.0, 2.0, 0.0]), &Instance::default()).unwrap_err();
        assert!(error.contains("no frame"), "{error}");
    }

    #[test]
    fn a_rotation_begins_with_w() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let instance = Instance {
            rotation: Some([half, 0.0, half, 0.0]),
            translation: [10.0, 0.0, 0.0],
            ..Instance::default()
        };
        // A quarter turn to the left about +Y carries -Z to -X.
        let place = stage(&Template::default(), &instance).unwrap();
        assert_eq!(image(&place, [0.0, 1.0, -2.0]), [8.0, 1.0, 0.0]);
        let none = Instance { rotation: Some([0.0; 4]), ..Instance::default() };
        assert!(stage(&Template::default(), &none).unwrap_err().contains("quaternion"));
    }

    #[test]
    fn the_centre_of_mass_is_moved_unless_the_asset_origin_is() {
        let mesh = Mesh {
            positions: vec![Point3::new(0.0, 0.0, 0.0), Point3::new(2.0, 4.0, 6.0)],
            ..Mesh::default()
        };
        let scaled = Template { scale: [2.0, 1.0, 1.0], ..Template::default() };
        let instance =
            Instance { translation: [0.0, 1.0, 0.0], uniform_scale: Some(0.5), ..Instance::default() };
        let place = |template: &Template, origin| object(template, &instance, origin, &mesh).unwrap();
        // Scaled by (1, 0.5, 0.5) the box is 2 x 2 x 3 with its centre at (1, 1, 1.5).
        assert_eq!(image(&place(&scaled, Origin::Asset), [2.0, 4.0, 6.0]), [2.0, 3.0, 3.0]);
        assert_eq!(image(&place(&scaled, Origin::CenterOfMass), [2.0, 4.0, 6.0]), [1.0, 2.0, 1.5]);
        let given = Template { center_of_mass: Some([2.0, 0.0, 0.0]), ..scaled };
        assert_eq!(image(&place(&given, Origin::CenterOfMass), [2.0, 4.0, 6.0]), [0.0, 3.0, 3.0]);
    }
}
