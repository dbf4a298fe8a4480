//! Least-squares planes through triangles.

use super::Plane;
use avln_geom::{Point3, Vector3};
use nalgebra::{Matrix3, SymmetricEigen};

/// The area's centroid, through which the least-squares plane passes.
pub(super) struct PlaneFit {
    center: Option<Point3<f64>>,
}

impl PlaneFit {
    /// Least ratio between the spread along the plane and the spread across it, in variances.
    const FLATNESS: f64 = 16.0;

    /// Computes the centroid from areas with their centres.
    pub(super) fn new(parts: impl Iterator<Item = (f32, Point3<f32>)>) -> Self {
        let (mut moment, mut total_m2) = (Vector3::<f64>::zeros(), 0.0);
        for (area_m2, center) in parts {
            moment += center.coords.cast::<f64>() * f64::from(area_m2);
            total_m2 += f64::from(area_m2);
        }
        Self { center: (total_m2 > 0.0).then(|| Point3::from(moment / total_m2)) }
    }

    /// Returns the plane with a normal through the centroid; infinitely far without area.
    pub(super) fn plane(&self, normal: Vector3<f32>) -> Plane {
        let offset_m = self.center.map_or(f64::INFINITY, |center| normal.cast::<f64>().dot(&center.coords));
        Plane { normal, offset_m: offset_m as f32, slack_m: 0.0 }
    }

    /// Returns the direction of least spread, on the side of `direction`; `None` without area, or if the triangles are
    /// spread nearly as much across the plane as along it.
    pub(super) fn normal(
        &self,
        triangles: impl Iterator<Item = (f32, [Point3<f32>; 3])>,
        direction: &Vector3<f32>,
    ) -> Option<Vector3<f32>> {
        let center = self.center?;
        let spread: Matrix3<f64> = triangles.map(|triangle| second_moment(triangle, &center)).sum();
        let eigen = SymmetricEigen::new(spread);
        let mut axes = [0, 1, 2];
        axes.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        let [across, along] = [0, 1].map(|axis| eigen.eigenvalues[axes[axis]].max(0.0));
        let normal = eigen.eigenvectors.column(axes[0]).into_owned();
        let side = normal.dot(&direction.cast::<f64>()).signum();
        (along > Self::FLATNESS * across).then(|| (normal * side).cast::<f32>())
    }
}

/// Integral of the outer product of offsets from `center` over a triangle.
fn second_moment((area_m2, corners): (f32, [Point3<f32>; 3]), center: &Point3<f64>) -> Matrix3<f64> {
    let offsets = corners.map(|corner| corner.cast::<f64>() - center);
    let sum: Vector3<f64> = offsets.iter().sum();
    let squares: Matrix3<f64> = offsets.iter().map(|offset| offset * offset.transpose()).sum();
    (squares + sum * sum.transpose()) * (f64::from(area_m2) / 12.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_geom::Rng;

    fn fitted(corners: &[[Point3<f32>; 3]]) -> (PlaneFit, Option<Vector3<f32>>) {
        let area_m2 = |[a, b, c]: &[Point3<f32>; 3]| 0.5 * (b - a).cross(&(c - a)).norm();
        let center = |[a, b, c]: &[Point3<f32>; 3]| Point3::from((a.coords + b.coords + c.coords) / 3.0);
        let fit = PlaneFit::new(corners.iter().map(|corners| (area_m2(corners), center(corners))));
        let normal = fit.normal(corners.iter().map(|corners| (area_m2(corners), *corners)), &Vector3::y());
        (fit, normal)
    }

    /// A rectangle of triangles in the plane y = x / 2 + 1, with bumps.
    fn slope(width_m: f32, bump_m: f32) -> Vec<[Point3<f32>; 3]> {
        let mut rng = Rng::new(2);
        let mut at =
            |x: f32, z: f32| Point3::new(4.0 * x, 2.0 * x + 1.0 + rng.range(-bump_m, bump_m), width_m * z);
        let cells = (0..400).map(|cell| ((cell / 20) as f32 / 20.0, (cell % 20) as f32 / 20.0));
        cells.map(|(x, z)| [at(x, z), at(x, z + 0.05), at(x + 0.05, z)]).collect()
    }

    #[test]
    fn least_squares_normals_survive_bumps() {
        let wanted = Vector3::new(-0.5, 1.0, 0.0).normalize();
        let (fit, exact) = fitted(&slope(3.0, 0.0));
        let exact = exact.expect("flat");
        assert!((exact - wanted).norm() < 1e-6, "{exact}");
        assert!((fit.plane(exact).offset_m - wanted.y).abs() < 1e-5);
        let (_, bumpy) = fitted(&slope(3.0, 0.02));
        assert!((bumpy.expect("flat") - wanted).norm() < 0.01, "{bumpy:?}");
    }

    #[test]
    fn bumpy_strips_have_no_reliable_normal() {
        assert!(fitted(&slope(0.05, 0.0)).1.is_some());
        assert_eq!(fitted(&slope(0.05, 0.04)).1, None);
        let (fit, normal) = fitted(&[]);
        assert!(normal.is_none() && fit.plane(Vector3::y()).offset_m.is_infinite());
    }
}
