//! Descriptive words for instances, from labels and surfaces.

use crate::categories::{mpcat40, noun};
use crate::colors::{code_of, light_of, name_of};
use crate::limits::MAX_WORD_CHARS;
use crate::{Attributes, Material, Mesh, Texture};
use avln_geom::{Aabb, Point2, Vector3};

/// Structural mpcat40 categories: these surfaces are no objects.
const STRUCTURE: &str = "void wall floor ceiling door window stairs column beam railing misc unlabeled";

/// Least height between two storeys' floors, metres.
const STOREY_STEP_M: f32 = 1.8;
/// Greatest side for the word `small`, metres.
const SMALL_M: f32 = 0.35;
/// Least height for the word `tall`, metres; a tall object is also [`SLENDER`] times as high as wide.
const TALL_M: f32 = 1.6;
/// Least length for the word `long`, metres; a long object is also [`SLENDER`] times as long as deep.
const LONG_M: f32 = 1.5;
const SLENDER: f32 = 2.0;
/// Least box volume for the word `large`, cubic metres.
const LARGE_M3: f32 = 1.5;

/// Returns whether a category is structural.
pub fn is_structure(category: &str) -> bool {
    STRUCTURE.split(' ').any(|name| name == category)
}

/// An annotator's meaning.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Meaning {
    /// An object.
    Object {
        /// The mpcat40 category, or the annotator's words in lower case.
        category: String,
        /// The more exact noun; empty if the category is as exact.
        noun: String,
    },
    /// Building structure.
    Structure,
    /// No usable word.
    Unknown,
}

/// Interprets `words`. Words without an mpcat40 category become a new category, in lower case.
pub fn meaning(words: &str) -> Meaning {
    if let Some(category) = mpcat40(words) {
        let noun = noun(words).unwrap_or_default().to_owned();
        return match is_structure(category) {
            true => Meaning::Structure,
            false => Meaning::Object { category: category.to_owned(), noun },
        };
    }
    let plain = words.trim().to_lowercase();
    let category: String = plain.chars().filter(|letter| !letter.is_control()).take(MAX_WORD_CHARS).collect();
    let is_said = !category.is_empty()
        && !["unknown", "undefined", "unlabeled"].iter().any(|no| category.starts_with(no));
    if is_said { Meaning::Object { category, noun: String::new() } } else { Meaning::Unknown }
}

/// Returns storeys for floor heights in metres. A new storey begins at a jump in the sorted heights.
pub fn storeys(floors_m: &[f32]) -> Vec<u16> {
    let mut order: Vec<usize> = (0..floors_m.len()).collect();
    order.sort_by(|&a, &b| floors_m[a].total_cmp(&floors_m[b]));
    let mut storeys = vec![0; floors_m.len()];
    let mut storey = 0;
    let mut base_m = order.first().map_or(0.0, |&lowest| floors_m[lowest]);
    for index in order {
        if floors_m[index] - base_m > STOREY_STEP_M {
            storey += 1;
            base_m = floors_m[index];
        }
        storeys[index] = storey;
    }
    storeys
}

/// Surfaces and their looks, for descriptions.
pub struct Surfaces<'a> {
    /// Triangles.
    pub mesh: &'a Mesh,
    /// Materials for the triangles.
    pub materials: &'a [Material],
    /// Textures for the materials.
    pub textures: &'a [Texture],
}

impl Surfaces<'_> {
    /// Returns colour and size words for an instance with these triangles.
    pub fn attributes(&self, triangles: &[u32], bounds: &Aabb) -> Attributes {
        let color = self.mean_color(triangles).map_or("", name_of);
        Attributes { color: color.to_owned(), size: size_word(bounds).to_owned(), ..Attributes::default() }
    }

    /// Returns the mean colour over the area, averaged as light; `None` if everything is invisible.
    pub fn mean_color(&self, triangles: &[u32]) -> Option<[u8; 3]> {
        let mut sum = [0.0_f64; 3];
        let mut weight = 0.0_f64;
        for &triangle in triangles {
            let area = f64::from(self.area_m2(triangle as usize));
            // Light is averaged, not sRGB codes: a chequered surface has the colour that a camera sees from afar.
            for color in self.samples(triangle as usize).into_iter().flatten() {
                (0..3).for_each(|channel| sum[channel] += area * f64::from(light_of(color[channel])));
                weight += area;
            }
        }
        (weight > 0.0).then(|| sum.map(|light| code_of((light / weight) as f32)))
    }

    fn area_m2(&self, triangle: usize) -> f32 {
        let [a, b, c] = self.mesh.triangles[triangle].map(|corner| self.mesh.positions[corner as usize]);
        let normal: Vector3<f32> = (b - a).cross(&(c - a));
        normal.norm() / 2.0
    }

    /// Colours at a triangle's centre, and half-way to the corners; `None` for cut-out texels.
    fn samples(&self, triangle: usize) -> [Option<[u8; 3]>; 4] {
        let corners = self.mesh.triangles[triangle];
        let light = corners.map(|corner| self.mesh.colors[corner as usize]);
        let light: [u8; 3] = std::array::from_fn(|channel| {
            (light.iter().map(|corner| u16::from(corner[channel])).sum::<u16>() / 3) as u8
        });
        let material = &self.materials[usize::from(self.mesh.material_of[triangle])];
        let texture = material.texture.map(|index| &self.textures[usize::from(index)]);
        inner_points(&corners.map(|corner| self.mesh.uvs[corner as usize])).map(|uv| {
            let texel = texture.map_or([255; 4], |texture| texel_at(texture, &uv));
            let color: [u8; 4] =
                std::array::from_fn(|channel| scaled(texel[channel], material.base_color[channel]));
            let visible = color[3] >= material.alpha_cutoff.unwrap_or(0);
            visible.then(|| std::array::from_fn(|channel| scaled(color[channel], light[channel])))
        })
    }
}

/// Returns a triangle's centre, and the points half-way between centre and corners.
pub fn inner_points(corners: &[Point2<f32>; 3]) -> [Point2<f32>; 4] {
    let [a, b, c] = corners.map(|corner| corner.coords);
    let center = (a + b + c) / 3.0;
    [center, (center + a) / 2.0, (center + b) / 2.0, (center + c) / 2.0].map(Point2::from)
}

/// Returns the texel at a texture coordinate; the texture repeats.
pub fn texel_at(texture: &Texture, uv: &Point2<f32>) -> [u8; 4] {
    let along =
        |share: f32, side: u32| (((share - share.floor()) * side as f32) as u32).min(side - 1) as usize;
    let column = along(uv.x, texture.width);
    let row = along(uv.y, texture.height);
    let start = 4 * (row * texture.width as usize + column);
    std::array::from_fn(|channel| texture.pixels[start + channel])
}

fn scaled(value: u8, by: u8) -> u8 {
    ((u16::from(value) * u16::from(by) + 127) / 255) as u8
}

/// Size word for a box; empty in doubtful cases.
fn size_word(bounds: &Aabb) -> &'static str {
    let size = bounds.size();
    let long = size.x.max(size.z);
    let deep = size.x.min(size.z);
    if size.max() <= SMALL_M {
        "small"
    } else if size.y >= TALL_M && size.y >= SLENDER * long {
        "tall"
    } else if size.x * size.y * size.z >= LARGE_M3 {
        "large"
    } else if long >= LONG_M && long >= SLENDER * deep && long >= size.y {
        "long"
    } else {
        ""
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_geom::Point3;

    fn size_word_of(x: f32, y: f32, z: f32) -> &'static str {
        size_word(&Aabb::new(Point3::origin(), Point3::new(x, y, z)))
    }

    #[test]
    fn labels_mean_objects_structure_or_neither() {
        let object =
            |category: &str, noun: &str| Meaning::Object { category: category.into(), noun: noun.into() };
        assert_eq!(meaning("Air-conditioner"), object("appliances", "air conditioner"));
        assert_eq!(meaning("bed"), object("bed", ""));
        assert_eq!(meaning(" Quxotron 7 "), object("quxotron 7", ""));
        assert_eq!(meaning("door frame"), Meaning::Structure);
        assert_eq!([meaning("Unknown"), meaning(" ")], [Meaning::Unknown, Meaning::Unknown]);
    }

    #[test]
    fn a_jump_of_floor_heights_begins_a_storey() {
        assert_eq!(storeys(&[2.9, 0.0, 0.3, 6.0, -0.1]), [1, 0, 0, 2, 0]);
        assert!(storeys(&[]).is_empty());
    }

    #[test]
    fn size_terms_need_clear_difference() {
        assert_eq!(size_word_of(0.2, 0.3, 0.2), "small");
        assert_eq!(size_word_of(0.6, 1.9, 0.6), "tall");
        assert_eq!(size_word_of(2.0, 1.9, 0.6), "large");
        assert_eq!(size_word_of(2.0, 0.5, 0.6), "long");
        assert_eq!(size_word_of(0.5, 0.9, 0.5), "");
    }

    #[test]
    fn mean_colour_multiplies_texels_and_material() {
        let texture = Texture { width: 2, height: 1, pixels: vec![255, 255, 255, 255, 9, 9, 9, 255] };
        let material = Material {
            name: String::new(),
            base_color: [200, 30, 30, 255],
            texture: Some(0),
            alpha_cutoff: None,
        };
        let mesh = Mesh {
            positions: vec![Point3::origin(), Point3::new(1.0, 0.0, 0.0), Point3::new(0.0, 1.0, 0.0)],
            uvs: vec![Point2::new(0.1, 0.1), Point2::new(0.2, 0.1), Point2::new(0.1, 0.2)],
            colors: vec![[255; 3]; 3],
            triangles: vec![[0, 1, 2]],
            material_of: vec![0],
            instance_of: vec![crate::InstanceId::NONE],
        };
        let (materials, textures) = ([material], [texture]);
        let surfaces = Surfaces { mesh: &mesh, materials: &materials, textures: &textures };
        assert_eq!(surfaces.mean_color(&[0]), Some([200, 30, 30]));
        assert_eq!(surfaces.mean_color(&[]), None);
    }

    #[test]
    fn texels_repeat_in_both_directions() {
        let texture = Texture { width: 2, height: 1, pixels: vec![1, 1, 1, 1, 2, 2, 2, 2] };
        for (u, expected) in [(0.25, 1), (0.75, 2), (1.25, 1), (-0.25, 2), (1.0, 1)] {
            assert_eq!(texel_at(&texture, &Point2::new(u, 3.5))[0], expected, "{u}");
        }
    }
}
