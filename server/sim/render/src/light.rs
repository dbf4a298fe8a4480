//! Baked light for scenes with lamps, stored in the vertex colours of a finer mesh.
//!
//! Every triangle of the finer mesh is a sample: indirect light with ambient occlusion from a fixed set of
//! rays, and the visible lamps. A vertex uses the mean of the smoothly adjacent triangles.

mod cut;
mod gather;
mod spread;
#[cfg(test)]
mod tests;

use avln_geom::RayMesh;
use avln_scene::{Lighting, Mesh, Scene};

/// Returns the mesh of `scene`, subdivided for light, with light factors as vertex colours: RGB, 0 to 255,
/// multiplied with the sRGB surface colour. `None` if surfaces contain their light. `rays` contains the scene
/// triangles in order; the result has a different order.
pub(crate) fn lit(scene: &Scene, rays: &RayMesh) -> Option<Mesh> {
    let Lighting::Lamps(lamps) = &scene.lighting else { return None };
    let mut mesh = cut::cut(&scene.mesh);
    let samples = gather::samples(&scene.mesh, rays, lamps, &mesh);
    spread::spread(samples, &mut mesh);
    Some(mesh)
}
