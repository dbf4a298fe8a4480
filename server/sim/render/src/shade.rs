use crate::camera::Lens;
use crate::texture::{Pyramid, rounded};
use crate::triangle::{Outline, Plane};
use avln_geom::Vector3;
use avln_scene::Scene;

/// Colours of surfaces: texture times base colour times vertex colour.
pub(crate) struct Shader {
    materials: Vec<Paint>,
    textures: Vec<Option<Pyramid>>,
    /// What surfaces without a known material are painted with.
    plain: Paint,
}

struct Paint {
    /// RGB, 0 to 1.
    color: [f32; 3],
    /// 0 to 255.
    alpha: u8,
    texture: Option<usize>,
    alpha_cutoff: Option<u8>,
}

/// A number that is linear on a triangle: `base + depth · slope(x, y)`.
struct Varying {
    base: f32,
    slope: Plane,
}

/// All that is needed to colour the pixels of one triangle.
pub(crate) struct Surface<'a> {
    paint: &'a Paint,
    texture: Option<&'a Pyramid>,
    uv: [Varying; 2],
    /// Factors of red, green and blue, 0 to 1.
    tint: Tint,
    /// Texels of the full size on a pixel, at one metre of depth; grows with its third power.
    footprint: f32,
}

enum Tint {
    Even([f32; 3]),
    Varying([Varying; 3]),
}

impl Varying {
    /// From its values at the three corners.
    #[inline]
    fn new(outline: &Outline, [a, b, c]: [f32; 3]) -> Self {
        let [_, weight_b, weight_c] = &outline.weights;
        let slope = weight_b.mixed((b - a) * outline.scale, weight_c, (c - a) * outline.scale);
        Self { base: a, slope }
    }

    #[inline]
    fn at(&self, x: f32, y: f32, depth_m: f32) -> f32 {
        self.base + self.slope.at(x, y) * depth_m
    }
}

impl Shader {
    pub(crate) fn new(scene: &Scene) -> Self {
        let materials = scene.materials.iter().map(|material| Paint {
            color: [0, 1, 2].map(|channel| f32::from(material.base_color[channel]) / 255.0),
            alpha: material.base_color[3],
            texture: material.texture.map(usize::from),
            alpha_cutoff: material.alpha_cutoff,
        });
        Self {
            materials: materials.collect(),
            textures: scene.textures.iter().map(Pyramid::new).collect(),
            plain: Paint { color: [1.0; 3], alpha: 255, texture: None, alpha_cutoff: None },
        }
    }

    fn paint(&self, scene: &Scene, triangle: u32) -> &Paint {
        let material = scene.mesh.material_of[triangle as usize];
        self.materials.get(usize::from(material)).unwrap_or(&self.plain)
    }

    /// Whether rays may pass through some points of a triangle.
    #[inline]
    pub(crate) fn has_holes(&self, scene: &Scene, triangle: u32) -> bool {
        self.paint(scene, triangle).alpha_cutoff.is_some()
    }

    /// What to colour a triangle with, given its corners in the camera frame and their outline.
    pub(crate) fn surface(
        &self,
        scene: &Scene,
        lens: &Lens,
        triangle: u32,
        corners: &[Vector3<f32>; 3],
        outline: &Outline,
    ) -> Surface<'_> {
        let paint = self.paint(scene, triangle);
        let texture = paint.texture.and_then(|index| self.textures.get(index)?.as_ref());
        let indices = scene.mesh.triangles[triangle as usize].map(|index| index as usize);
        let uv = indices.map(|index| scene.mesh.uvs[index]);
        Surface {
            paint,
            texture,
            uv: [Varying::new(outline, uv.map(|uv| uv.x)), Varying::new(outline, uv.map(|uv| uv.y))],
            tint: tint(paint, outline, indices.map(|index| scene.mesh.colors[index])),
            footprint: texture.map_or(0.0, |texture| {
                let [along, across] = [uv[1] - uv[0], uv[2] - uv[0]];
                let texels = (along.x * across.y - along.y * across.x).abs() * texture.area();
                texels / grazing_area(corners, lens.focal_px())
            }),
        }
    }
}

/// Twice the area of a triangle times its plane's distance from the eye times `focal_px`², metres cubed · pixels².
///
/// A pixel at depth t sees t² / focal² m² of a surface that faces it, and t / distance times more of a tilted one.
fn grazing_area(corners: &[Vector3<f32>; 3], focal_px: f32) -> f32 {
    let [a, b, c] = corners.map(|corner| Vector3::new(corner.x / focal_px, corner.y / focal_px, corner.z));
    // The volume is twice the area times the distance.
    a.dot(&(b - a).cross(&(c - a))).abs() * focal_px * focal_px
}

fn tint(paint: &Paint, outline: &Outline, colors: [[u8; 3]; 3]) -> Tint {
    let factor = |channel: usize, byte: u8| paint.color[channel] * (f32::from(byte) / 255.0);
    let channels = [0, 1, 2];
    if colors[0] == colors[1] && colors[1] == colors[2] {
        return Tint::Even(channels.map(|channel| factor(channel, colors[0][channel])));
    }
    Tint::Varying(
        channels.map(|channel| Varying::new(outline, colors.map(|color| factor(channel, color[channel])))),
    )
}

impl Surface<'_> {
    #[inline]
    fn texel(&self, x: f32, y: f32, depth_m: f32) -> [u8; 4] {
        let Some(texture) = self.texture else { return [255; 4] };
        let uv = [self.uv[0].at(x, y, depth_m), self.uv[1].at(x, y, depth_m)];
        texture.sample(uv, self.footprint * depth_m * depth_m * depth_m)
    }

    /// RGB, 0 to 255, where the ray through (x, y) meets the surface.
    #[inline]
    pub(crate) fn color(&self, x: f32, y: f32, depth_m: f32) -> [u8; 3] {
        let texel = self.texel(x, y, depth_m);
        let shade = |factor: f32, channel: usize| {
            rounded((f32::from(texel[channel]) * factor).clamp(0.0, 255.0)) as u8
        };
        match &self.tint {
            Tint::Even(tint) => [0, 1, 2].map(|channel| shade(tint[channel], channel)),
            Tint::Varying(tint) => [0, 1, 2].map(|channel| shade(tint[channel].at(x, y, depth_m), channel)),
        }
    }

    /// Whether the surface is there where the ray through (x, y) meets it.
    #[inline]
    pub(crate) fn is_solid(&self, x: f32, y: f32, depth_m: f32) -> bool {
        let alpha = u32::from(self.texel(x, y, depth_m)[3]) * u32::from(self.paint.alpha);
        self.paint.alpha_cutoff.is_none_or(|cutoff| alpha >= u32::from(cutoff) * 255)
    }
}
