use crate::corners::Link;
use crate::mesh::{NavMesh, NavPoint};
use crate::plane::Spot;
use crate::sight::{Eye, VisiblePart, look};

/// Visibility of a point on its mesh, reusable for many fields
/// ([`DistanceField::distance_from_m`](crate::DistanceField::distance_from_m)).
pub struct Outlook {
    eye: Eye,
    height_m: f64,
    views: Vec<(u32, VisiblePart)>,
    links: Vec<Link>,
}

impl Outlook {
    pub(crate) fn new(mesh: &NavMesh, point: &NavPoint) -> Self {
        let (eye, height_m) = (mesh.eye(point), f64::from(point.position().y));
        let (mut views, mut links) = (Vec::new(), Vec::new());
        look(&mesh.polygons, &eye, |polygon, view| {
            views.push((polygon, *view));
            mesh.corners.in_view(mesh.polygons.edges(polygon), view, (&eye.spot, height_m), |link| {
                links.push(link);
            });
        });
        Self { eye, height_m, views, links }
    }

    pub(crate) fn place(&self) -> (&Spot, f64) {
        (&self.eye.spot, self.height_m)
    }

    pub(crate) fn views(&self) -> &[(u32, VisiblePart)] {
        &self.views
    }

    pub(crate) fn links(&self) -> &[Link] {
        &self.links
    }
}
