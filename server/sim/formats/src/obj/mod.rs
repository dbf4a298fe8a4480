//! Wavefront `.obj` files with material libraries: polygons, vertex colours and images. Objects or groups with a
//! category in their name (`chair_3`, `KitchenTable_01`) become instances.

mod mtl;

use crate::files::{self, Checked, ImportReport, neighbour, refuse_if};
use crate::images::ImageSet;
use crate::named_model::{Model, ModelNode, category_of_name, import_named_model};
use crate::obj::mtl::MtlMaterial;
use crate::world_frame::{ImportOptions, UpAxis, UpConvention};
use avln_geom::{Point2, Point3};
use avln_scene::limits::{MAX_ENTRIES, MAX_FILE_BYTES, MAX_TEXELS, MAX_TRIANGLES, MAX_VERTICES};
use avln_scene::{InstanceId, Material, Mesh, Scene, SceneError, polygon};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

/// Imports a file. Y is up, unless the shape of the building contradicts it. Errors name the line.
///
/// A missing library or image is replaced by plain grey or a checker, with a warning.
pub(crate) fn import(
    path: &Path,
    options: &ImportOptions,
    report: &mut ImportReport,
) -> Result<Scene, SceneError> {
    import_named_model(path, read(path, report)?, options, UpConvention::Usual(UpAxis::Y), report)
}

/// Reads a file in file coordinates.
pub(crate) fn read(path: &Path, report: &mut ImportReport) -> Result<Model, SceneError> {
    let real = files::resolve(path, report)?;
    let bytes = files::read(&real, MAX_FILE_BYTES, report)?;
    let folder = real.parent().unwrap_or(Path::new(""));
    model(&bytes, folder, report).map_err(|reason| files::malformed(path, reason))
}

fn model(bytes: &[u8], folder: &Path, report: &mut ImportReport) -> Checked<Model> {
    let surfaces = parse(bytes, report)?;
    let entries = libraries(&surfaces, folder, report);
    let mut pictures = ImageSet::new(folder, MAX_TEXELS);
    let mut materials = Vec::with_capacity(surfaces.materials.len());
    for name in &surfaces.materials {
        materials.push(material(name, &entries, &mut pictures, report)?);
    }
    let node = |name| ModelNode { name, parent: None, extras: None };
    Ok(Model {
        mesh: surfaces.mesh,
        materials,
        textures: pictures.textures,
        node_of: surfaces.part_of,
        nodes: surfaces.parts.into_iter().map(node).collect(),
        scene_extras: serde_json::Value::Null,
    })
}

fn libraries(surfaces: &ObjSurfaces, folder: &Path, report: &mut ImportReport) -> Vec<MtlMaterial> {
    let mut entries = Vec::new();
    for name in &surfaces.libraries {
        let text = neighbour(folder, &name.replace('\\', "/"))
            .and_then(|path| files::read(&path, MAX_FILE_BYTES, report).map_err(|error| error.to_string()));
        match text {
            Ok(bytes) => entries.extend(mtl::parse(&String::from_utf8_lossy(&bytes))),
            Err(reason) => report.warn(format!("material library {name:?} is left out: {reason}")),
        }
    }
    entries
}

fn material(
    name: &str,
    entries: &[MtlMaterial],
    pictures: &mut ImageSet,
    report: &mut ImportReport,
) -> Checked<Material> {
    let Some(entry) = entries.iter().find(|entry| entry.name == name) else {
        if !name.is_empty() {
            report.warn(format!("material {name:?} is in no library; plain grey replaces it"));
        }
        return Ok(mtl::plain(name));
    };
    let texture = entry.picture.as_ref().map(|picture| pictures.number(picture, report)).transpose()?;
    Ok(entry.material(texture))
}

/// Coordinate limit; larger ones are damage, in any unit.
const MAX_COORDINATE: f32 = 1.0e9;
const MAX_UV: f32 = 1.0e5;
const MAX_POLYGON: usize = 4096;
const MAX_LIBRARIES: usize = 64;
const NONE: u32 = u32::MAX;
/// Keywords without data for scenes.
const IGNORED: [&str; 10] = ["vn", "s", "l", "p", "vp", "usemap", "lod", "mg", "bevel", "maplib"];
/// Keywords for curved surfaces.
const CURVED: [&str; 5] = ["curv", "curv2", "surf", "cstype", "bmat"];

#[derive(Default)]
struct ObjSurfaces {
    mesh: Mesh,
    /// Material names in number order; the empty name is no material.
    materials: Vec<String>,
    parts: Vec<String>,
    /// Index into `parts` per triangle.
    part_of: Vec<u32>,
    libraries: Vec<String>,
}

fn parse(bytes: &[u8], report: &mut ImportReport) -> Checked<ObjSurfaces> {
    let mut parser = ObjParser::default();
    for (number, line) in lines(bytes) {
        parser
            .line(split(&line), report)
            .map_err(|reason| format!("line {number}: {reason}; export the file again"))?;
    }
    refuse_if(parser.found.mesh.triangles.is_empty(), || {
        "it has no faces; use the file with surfaces".into()
    })?;
    Ok(parser.found)
}

#[derive(Default)]
struct ObjParser {
    found: ObjSurfaces,
    positions: Vec<Point3<f32>>,
    colors: Vec<[u8; 3]>,
    uvs: Vec<Point2<f32>>,
    /// Linked lists for mesh vertices with the same position: the last vertex per position; per vertex the texture coordinate, and the
    /// vertex before it.
    last_vertex: Vec<u32>,
    vertex_uv: Vec<u32>,
    vertex_before: Vec<u32>,
    object: String,
    group: String,
    material: u16,
    material_of: BTreeMap<String, u16>,
    part: Option<u32>,
    part_of: BTreeMap<String, u32>,
}

impl ObjParser {
    fn line(&mut self, (keyword, rest): (&str, &str), report: &mut ImportReport) -> Checked<()> {
        match keyword {
            "v" => self.position(rest)?,
            "vt" => self.uv(rest)?,
            "f" | "fo" => self.face(rest)?,
            "o" => (self.object, self.group, self.part) = (rest.to_owned(), String::new(), None),
            "g" => (self.group, self.part) = (rest.to_owned(), None),
            "usemtl" => self.material = self.material_number(rest)?,
            "mtllib" => self.add_libraries(rest),
            "" => {}
            known if IGNORED.contains(&known) => {}
            curved if CURVED.contains(&curved) => {
                report.warn("its curved surfaces are left out; convert them to polygons");
            }
            other => {
                let start: String = other.chars().take(20).collect();
                report.warn(format!("lines that start with {start:?} are not supported and left out"));
            }
        }
        Ok(())
    }

    fn position(&mut self, text: &str) -> Checked<()> {
        let (numbers, count) = numbers::<7>(text, 3, MAX_COORDINATE)?;
        refuse_if(self.positions.len() >= MAX_VERTICES, || {
            format!("it has more than {MAX_VERTICES} vertices")
        })?;
        self.positions.push(Point3::new(numbers[0], numbers[1], numbers[2]));
        let code = |share: f32| (share.clamp(0.0, 1.0) * 255.0).round() as u8;
        // Six numbers are a position and a colour, seven a weight between them.
        let first_color = count - 3;
        let color = std::array::from_fn(|channel| code(numbers[first_color + channel]));
        self.colors.push(if count >= 6 { color } else { [255; 3] });
        self.last_vertex.push(NONE);
        Ok(())
    }

    // Texture coordinates count from the bottom row in OBJ, from the top row in scenes.
    fn uv(&mut self, text: &str) -> Checked<()> {
        let ([u, v], _) = numbers::<2>(text, 1, f32::INFINITY)?;
        refuse_if(self.uvs.len() >= MAX_VERTICES, || {
            format!("it has more than {MAX_VERTICES} texture coordinates")
        })?;
        let sane = |value: f32| if value.abs() <= MAX_UV { value } else { 0.0 };
        self.uvs.push(Point2::new(sane(u), 1.0 - sane(v)));
        Ok(())
    }

    fn face(&mut self, text: &str) -> Checked<()> {
        let corners: Checked<Vec<u32>> =
            text.split_whitespace().take(MAX_POLYGON + 1).map(|word| self.corner(word)).collect();
        let corners = corners?;
        refuse_if(!(3..=MAX_POLYGON).contains(&corners.len()), || {
            format!("a face has {} corners, 3 to {MAX_POLYGON} are read", corners.len())
        })?;
        let part = self.part()?;
        let mesh = &mut self.found.mesh;
        polygon::triangulate(&mesh.positions, &corners, &mut mesh.triangles);
        let total = mesh.triangles.len();
        refuse_if(total > MAX_TRIANGLES, || format!("it has more than {MAX_TRIANGLES} triangles"))?;
        if self.found.materials.is_empty() {
            self.material = self.material_number("")?;
        }
        self.found.mesh.material_of.resize(total, self.material);
        self.found.mesh.instance_of.resize(total, InstanceId::NONE);
        self.found.part_of.resize(total, part);
        Ok(())
    }

    /// Returns a corner's mesh vertex; creates it at the first use.
    fn corner(&mut self, word: &str) -> Checked<u32> {
        let (position, uv) = corner(word, self.positions.len(), self.uvs.len())?;
        let uv = uv.unwrap_or(NONE);
        // Linked lists instead of a map: most positions have one or two texture coordinates, and scans have millions of corners.
        let mut vertex = self.last_vertex[position as usize];
        while vertex != NONE && self.vertex_uv[vertex as usize] != uv {
            vertex = self.vertex_before[vertex as usize];
        }
        if vertex != NONE {
            return Ok(vertex);
        }
        let mesh = &mut self.found.mesh;
        refuse_if(mesh.positions.len() >= MAX_VERTICES, || {
            format!("it has more than {MAX_VERTICES} vertices")
        })?;
        let made = mesh.positions.len() as u32;
        mesh.positions.push(self.positions[position as usize]);
        mesh.colors.push(self.colors[position as usize]);
        mesh.uvs.push(self.uvs.get(uv as usize).copied().unwrap_or_else(Point2::origin));
        self.vertex_uv.push(uv);
        self.vertex_before.push(std::mem::replace(&mut self.last_vertex[position as usize], made));
        Ok(made)
    }

    /// Returns the current part's number: a group with a category in the name, or the object, or the group.
    fn part(&mut self) -> Checked<u32> {
        if let Some(part) = self.part {
            return Ok(part);
        }
        let has_category = self.object.is_empty() || category_of_name(&self.group).is_some();
        let name = if has_category { &self.group } else { &self.object };
        let next = self.found.parts.len();
        let part = match self.part_of.get(name) {
            Some(&known) => known,
            None if next >= MAX_ENTRIES => return Err(format!("it has more than {MAX_ENTRIES} objects")),
            None => {
                self.found.parts.push(name.clone());
                self.part_of.insert(name.clone(), next as u32);
                next as u32
            }
        };
        self.part = Some(part);
        Ok(part)
    }

    fn material_number(&mut self, name: &str) -> Checked<u16> {
        if let Some(&known) = self.material_of.get(name) {
            return Ok(known);
        }
        let number = u16::try_from(self.found.materials.len())
            .map_err(|_| "it uses more than 65536 materials".to_owned())?;
        self.found.materials.push(name.to_owned());
        self.material_of.insert(name.to_owned(), number);
        Ok(number)
    }

    /// Adds library names, separated by blanks; a single name may contain blanks.
    fn add_libraries(&mut self, text: &str) {
        let all_are_libraries =
            text.split_whitespace().all(|name| name.to_ascii_lowercase().ends_with(".mtl"));
        let names = if all_are_libraries { text.split_whitespace().collect() } else { vec![text] };
        for name in names {
            if !self.found.libraries.iter().any(|known| known == name)
                && self.found.libraries.len() < MAX_LIBRARIES
            {
                self.found.libraries.push(name.to_owned());
            }
        }
    }
}

/// Returns lines with their numbers; a backslash at a line's end joins the next line.
fn lines(bytes: &[u8]) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    let mut physical = bytes.split(|&byte| byte == b'\n').enumerate();
    std::iter::from_fn(move || {
        let (index, first) = physical.next()?;
        let mut line = String::from_utf8_lossy(first);
        while let Some(joined) = line.trim_end().strip_suffix('\\') {
            let joined = joined.to_owned();
            let Some((_, next)) = physical.next() else { return Some((index + 1, Cow::Owned(joined))) };
            line = Cow::Owned(format!("{joined} {}", String::from_utf8_lossy(next)));
        }
        Some((index + 1, line))
    })
}

/// Splits a line into keyword and values, without a comment.
fn split(line: &str) -> (&str, &str) {
    let line = line.split('#').next().unwrap_or_default().trim();
    line.split_once(char::is_whitespace).map_or((line, ""), |(keyword, rest)| (keyword, rest.trim()))
}

/// Parses up to `N` numbers, and returns their count; at least `least`, all finite and within `limit`.
fn numbers<const N: usize>(text: &str, least: usize, limit: f32) -> Checked<([f32; N], usize)> {
    let mut found = [0.0; N];
    let mut count = 0;
    for word in text.split_whitespace().take(N) {
        let number: f32 = word.parse().map_err(|_| format!("{word:?} is not a number"))?;
        refuse_if(number.is_nan() || number.abs() > limit, || format!("{word:?} is no usable coordinate"))?;
        found[count] = number;
        count += 1;
    }
    if count < least { Err(format!("{count} numbers, {least} are needed")) } else { Ok((found, count)) }
}

/// Parses a face's corner such as `3`, `3/1`, `3//2` or `-1/-1/-1`: position and texture coordinate, counted from 0.
/// `positions` and `uvs` are their numbers so far.
fn corner(word: &str, positions: usize, uvs: usize) -> Checked<(u32, Option<u32>)> {
    let mut parts = word.split('/');
    let position = index(parts.next().unwrap_or_default(), positions, "vertex")?;
    let uv = match parts.next() {
        None | Some("") => None,
        Some(part) => Some(index(part, uvs, "texture coordinate")?),
    };
    Ok((position, uv))
}

/// Parses an index, from 1 on, or backwards from the end if it is negative.
fn index(word: &str, count: usize, what: &str) -> Checked<u32> {
    let number: i64 = word.parse().map_err(|_| format!("{word:?} is no number of a {what}"))?;
    let index = if number < 0 { number.checked_add(count as i64) } else { number.checked_sub(1) };
    index
        .filter(|index| (0..count as i64).contains(index))
        .map(|index| index as u32)
        .ok_or_else(|| format!("it refers to {what} {number}, there are {count} so far"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{self, damaged};
    use avln_geom::{Aabb, Point3};

    const LIBRARY: &str = "newmtl floor\nKd 0.5 0.5 0.5\nnewmtl table_1\nKd 0.5 0.3 0.1\nmap_Kd wood.png\nnewmtl sofa_1\nKd 0.9 0.1 0.1\n";

    #[test]
    fn objects_named_by_category_are_instances() {
        let folder = tempfile::tempdir().unwrap();
        tests::write(folder.path(), "house.obj", tests::obj());
        tests::write(folder.path(), "scan.mtl", LIBRARY);
        let mut report = ImportReport::default();
        let scene = import(&folder.path().join("house.obj"), &ImportOptions::default(), &mut report).unwrap();
        // The scan has Z up, and is flat enough for recognition.
        assert_eq!(
            scene.bounds().unwrap(),
            Aabb::new(Point3::new(0.0, 0.0, -5.0), Point3::new(6.0, 0.9, 0.0))
        );
        let found: Vec<(u32, &str)> =
            scene.objects.iter().map(|object| (object.id.0, object.category.as_str())).collect();
        assert_eq!(found, [(1, "table"), (2, "sofa")]);
        assert_eq!(scene.objects[1].attributes.color, "red");
        assert_eq!(
            scene.objects[0].bounds,
            Aabb::new(Point3::new(1.0, 0.0, -1.5), Point3::new(2.0, 0.7, -1.0))
        );
        assert_eq!(
            scene.materials.iter().map(|material| material.texture).collect::<Vec<_>>(),
            [None, Some(0), None]
        );
        assert_eq!(scene.textures.len(), 1);
        let says = |words: &str| report.warnings.iter().any(|warning| warning.contains(words));
        assert!(says("z axis is taken for up") && says("wood.png"), "{report:?}");
    }

    #[test]
    fn a_missing_library_is_a_warning() {
        let folder = tempfile::tempdir().unwrap();
        tests::write(folder.path(), "house.obj", tests::obj());
        let mut report = ImportReport::default();
        let scene = import(&folder.path().join("house.obj"), &ImportOptions::default(), &mut report).unwrap();
        assert_eq!(scene.materials.len(), 3);
        assert!(report.warnings.iter().any(|warning| warning.contains("scan.mtl")), "{report:?}");
        assert!(
            report.warnings.iter().any(|warning| warning.contains("\"sofa_1\" is in no library")),
            "{report:?}"
        );
    }

    #[test]
    fn vertices_with_equal_position_and_uv_are_shared() {
        let text = b"v 0 0 0 1 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nvt 0 0\nvt 0.5 0.25\nf 1/1 2/1 3/1\nf 1/1 3/1 4/2\nf 1/2 3/1 4/2\n";
        let surfaces = parse(text, &mut ImportReport::default()).unwrap();
        assert_eq!(surfaces.mesh.positions.len(), 5, "position 1 is used with two texture coordinates");
        assert_eq!(surfaces.mesh.triangles, [[0, 1, 2], [0, 2, 3], [4, 2, 3]]);
        assert_eq!((surfaces.mesh.uvs[4].x, surfaces.mesh.uvs[4].y), (0.5, 0.75), "rows count from below");
        assert_eq!([surfaces.mesh.colors[0], surfaces.mesh.colors[1]], [[255, 0, 0], [255; 3]]);
    }

    #[test]
    fn groups_name_instances_of_unnamed_objects() {
        let corners = "v 0 0 0\nv 4 0 0\nv 4 0 4\nv 0 0 4\n";
        let text =
            format!("{corners}o House\ng chair_1\nf 1 2 3\ng Mesh7\nf 1 3 4\no bed_2\ng Mesh8\nf 1 2 4\n");
        let surfaces = parse(text.as_bytes(), &mut ImportReport::default()).unwrap();
        assert_eq!(surfaces.parts, ["chair_1", "House", "bed_2"]);
        assert_eq!(surfaces.part_of, [0, 1, 2]);
    }

    #[test]
    fn errors_name_the_line() {
        for (text, expected) in [
            ("v 0 0 0\nv 1 0\n", "line 2: 2 numbers, 3 are needed"),
            ("v 0 0 nan\n", "line 1: \"nan\""),
            ("v 0 0 1e12\n", "line 1: \"1e12\""),
            ("v 0 0 0\nf 1 1\n", "line 2: a face has 2 corners"),
            ("v 0 0 0\nf 1 1 2\n", "line 2: it refers to vertex 2, there are 1"),
            ("v 0 0 0\nf 1/1 1/1 1/1\n", "line 2: it refers to texture coordinate 1, there are 0"),
            ("v 0 0 0\nf 1 -2 1\n", "line 2: it refers to vertex -2"),
            ("v 0 0 0\n", "no faces"),
            ("", "no faces"),
        ] {
            let error = parse(text.as_bytes(), &mut ImportReport::default()).err().unwrap();
            assert!(error.contains(expected), "{text:?}: {error}");
        }
        let long = format!("v 0 0 0\nf {}\n", "1 ".repeat(5000));
        assert!(parse(long.as_bytes(), &mut ImportReport::default()).err().unwrap().contains("4097 corners"));
    }

    #[test]
    fn damaged_files_never_panic() {
        let text = tests::obj();
        let mut errors = 0;
        damaged(text.as_bytes(), 5, 3000, |bytes| {
            errors += usize::from(parse(bytes, &mut ImportReport::default()).is_err());
        });
        assert!(errors > 300, "{errors}");
        damaged(LIBRARY.as_bytes(), 6, 3000, |bytes| {
            let entries = mtl::parse(&String::from_utf8_lossy(bytes));
            entries.iter().for_each(|entry| drop(entry.material(Some(0))));
        });
    }

    #[test]
    fn a_backslash_joins_lines() {
        let found: Vec<(usize, String)> =
            lines(b"f 1 \\\r\n2 3\nv\\").map(|(number, line)| (number, line.into_owned())).collect();
        assert_eq!(found[0].0, 1);
        assert_eq!(split(&found[0].1).1.split_whitespace().collect::<Vec<_>>(), ["1", "2", "3"]);
        assert_eq!(found[1], (3, "v".to_owned()));
    }

    #[test]
    fn corners_count_from_either_end() {
        assert_eq!(corner("3", 3, 0).unwrap(), (2, None));
        assert_eq!(corner("1//7", 3, 0).unwrap(), (0, None));
        assert_eq!(corner("-1/-2/-3", 3, 2).unwrap(), (2, Some(0)));
        for wrong in ["0", "4", "-4", "1/3", "x", "", "1/x", "9223372036854775807", "-9223372036854775808"] {
            assert!(corner(wrong, 3, 2).is_err(), "{wrong}");
        }
    }

    #[test]
    fn numbers_must_be_usable() {
        assert_eq!(numbers::<3>("1 -2.5 3e1 9", 3, 1e6).unwrap(), ([1.0, -2.5, 30.0], 3));
        for wrong in ["1 2", "1 2 x", "1 2 nan", "1 2 inf", "1 2 1e30"] {
            assert!(numbers::<3>(wrong, 3, 1e6).is_err(), "{wrong}");
        }
    }
}
