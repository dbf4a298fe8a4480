//! Vertices, faces and what they belong to.

use super::lines::{corner, lines, numbers, split};
use crate::Report;
use crate::files::Checked;
use crate::glb::category_of_name;
use avln_geom::{Point2, Point3};
use avln_scene::limits::{MAX_ENTRIES, MAX_TRIANGLES, MAX_VERTICES};
use avln_scene::{InstanceId, Mesh, polygon};
use std::collections::BTreeMap;

/// Coordinates beyond this are damage, in any unit.
const MAX_COORDINATE: f32 = 1.0e9;
const MAX_UV: f32 = 1.0e5;
const MAX_POLYGON: usize = 4096;
const MAX_LIBRARIES: usize = 64;
const NONE: u32 = u32::MAX;
/// Keywords that hold nothing which is used here.
const PASSED_OVER: [&str; 10] = ["vn", "s", "l", "p", "vp", "usemap", "lod", "mg", "bevel", "maplib"];
/// Keywords of curved surfaces.
const CURVED: [&str; 5] = ["curv", "curv2", "surf", "cstype", "bmat"];

/// What an `.obj` file holds, in its own frame.
#[derive(Default)]
pub(super) struct Surfaces {
    pub(super) mesh: Mesh,
    /// Names of materials in the order of their numbers; the empty name is none.
    pub(super) materials: Vec<String>,
    /// Names of objects and groups.
    pub(super) parts: Vec<String>,
    /// Index into `parts` of each triangle.
    pub(super) part_of: Vec<u32>,
    /// Names of material libraries.
    pub(super) libraries: Vec<String>,
}

/// Reads a file line by line.
pub(super) fn parse(bytes: &[u8], report: &mut Report) -> Checked<Surfaces> {
    let mut parser = Parser::default();
    for (number, line) in lines(bytes) {
        parser
            .line(split(&line), report)
            .map_err(|reason| format!("line {number}: {reason}; export the file again"))?;
    }
    if parser.found.mesh.triangles.is_empty() {
        return Err("it holds no faces; take the file with surfaces".to_owned());
    }
    Ok(parser.found)
}

#[derive(Default)]
struct Parser {
    found: Surfaces,
    positions: Vec<Point3<f32>>,
    colors: Vec<[u8; 3]>,
    uvs: Vec<Point2<f32>>,
    /// For each position the last mesh vertex made of it, and for each mesh vertex its texture coordinate and the one before.
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

impl Parser {
    fn line(&mut self, (keyword, rest): (&str, &str), report: &mut Report) -> Checked<()> {
        match keyword {
            "v" => self.position(rest)?,
            "vt" => self.uv(rest)?,
            "f" | "fo" => self.face(rest)?,
            "o" => (self.object, self.group, self.part) = (rest.to_owned(), String::new(), None),
            "g" => (self.group, self.part) = (rest.to_owned(), None),
            "usemtl" => self.material = self.material_number(rest)?,
            "mtllib" => self.add_libraries(rest),
            "" => {}
            known if PASSED_OVER.contains(&known) => {}
            curved if CURVED.contains(&curved) => {
                report.warn("its curved surfaces are left out; convert them to polygons");
            }
            other => {
                let start: String = other.chars().take(20).collect();
                report.warn(format!("lines that begin with {start:?} are not understood and left out"));
            }
        }
        Ok(())
    }

    fn position(&mut self, text: &str) -> Checked<()> {
        let (numbers, count) = numbers::<7>(text, 3, MAX_COORDINATE)?;
        if self.positions.len() >= MAX_VERTICES {
            return Err(format!("it has more than {MAX_VERTICES} vertices"));
        }
        self.positions.push(Point3::new(numbers[0], numbers[1], numbers[2]));
        let code = |share: f32| (share.clamp(0.0, 1.0) * 255.0).round() as u8;
        // Six numbers are a position and a colour, seven a weight between them.
        let first_color = count - 3;
        let color = std::array::from_fn(|channel| code(numbers[first_color + channel]));
        self.colors.push(if count >= 6 { color } else { [255; 3] });
        self.last_vertex.push(NONE);
        Ok(())
    }

    /// Texture coordinates count from the bottom row.
    fn uv(&mut self, text: &str) -> Checked<()> {
        let ([u, v], _) = numbers::<2>(text, 1, f32::INFINITY)?;
        if self.uvs.len() >= MAX_VERTICES {
            return Err(format!("it has more than {MAX_VERTICES} texture coordinates"));
        }
        let sane = |value: f32| if value.abs() <= MAX_UV { value } else { 0.0 };
        self.uvs.push(Point2::new(sane(u), 1.0 - sane(v)));
        Ok(())
    }

    fn face(&mut self, text: &str) -> Checked<()> {
        let corners: Checked<Vec<u32>> =
            text.split_whitespace().take(MAX_POLYGON + 1).map(|word| self.corner(word)).collect();
        let corners = corners?;
        if !(3..=MAX_POLYGON).contains(&corners.len()) {
            return Err(format!("a face has {} corners, 3 to {MAX_POLYGON} are read", corners.len()));
        }
        let part = self.part()?;
        let mesh = &mut self.found.mesh;
        polygon::triangulate(&mesh.positions, &corners, &mut mesh.triangles);
        let total = mesh.triangles.len();
        if total > MAX_TRIANGLES {
            return Err(format!("it has more than {MAX_TRIANGLES} triangles"));
        }
        if self.found.materials.is_empty() {
            self.material = self.material_number("")?;
        }
        self.found.mesh.material_of.resize(total, self.material);
        self.found.mesh.instance_of.resize(total, InstanceId::NONE);
        self.found.part_of.resize(total, part);
        Ok(())
    }

    /// The mesh vertex of a corner, made at its first use.
    fn corner(&mut self, word: &str) -> Checked<u32> {
        let (position, uv) = corner(word, self.positions.len(), self.uvs.len())?;
        let uv = uv.unwrap_or(NONE);
        let mut vertex = self.last_vertex[position as usize];
        while vertex != NONE && self.vertex_uv[vertex as usize] != uv {
            vertex = self.vertex_before[vertex as usize];
        }
        if vertex != NONE {
            return Ok(vertex);
        }
        let mesh = &mut self.found.mesh;
        if mesh.positions.len() >= MAX_VERTICES {
            return Err(format!("it has more than {MAX_VERTICES} vertices"));
        }
        let made = mesh.positions.len() as u32;
        mesh.positions.push(self.positions[position as usize]);
        mesh.colors.push(self.colors[position as usize]);
        mesh.uvs.push(self.uvs.get(uv as usize).copied().unwrap_or_else(Point2::origin));
        self.vertex_uv.push(uv);
        self.vertex_before.push(std::mem::replace(&mut self.last_vertex[position as usize], made));
        Ok(made)
    }

    /// The number of the part that faces belong to now: the group where its name says a category, else the object, else
    /// the group.
    fn part(&mut self) -> Checked<u32> {
        if let Some(part) = self.part {
            return Ok(part);
        }
        let says_more = self.object.is_empty() || category_of_name(&self.group).is_some();
        let name = if says_more { &self.group } else { &self.object };
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

    /// Library names are separated by blanks; a single one may hold some.
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
