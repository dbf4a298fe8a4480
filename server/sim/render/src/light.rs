//! Light on the surfaces of scenes with lamps: found once for a scene, kept in the colours of a finer mesh.
//!
//! Each triangle of the finer mesh is one sample: indirect light, which is the same everywhere but where things are
//! near (ambient occlusion with a fixed set of rays), and that of every lamp which is not hidden. A corner gets the
//! mean of the triangles around it which go on smoothly.

mod cut;
mod gather;
mod spread;
#[cfg(test)]
mod tests;

use avln_geom::RayMesh;
use avln_scene::{Lighting, Mesh, Scene};

/// The mesh of `scene`, cut finely enough to carry light, which its colours hold: RGB, 0 to 255, factors of the surface's
/// own sRGB colour. `None` where surfaces carry their light themselves. `rays` holds the triangles of the scene in their
/// order; those of the result differ.
pub(crate) fn lit(scene: &Scene, rays: &RayMesh) -> Option<Mesh> {
    let Lighting::Lamps(lamps) = &scene.lighting else { return None };
    let mut mesh = cut::cut(&scene.mesh);
    let samples = gather::samples(&scene.mesh, rays, lamps, &mesh);
    spread::spread(samples, &mut mesh);
    Some(mesh)
}
