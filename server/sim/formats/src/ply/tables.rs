//! Vertices and faces, whatever the order of their columns.

use super::body::Body;
use super::header::{Element, Format, Header, Property};
use crate::Report;
use crate::files::Checked;
use avln_geom::{Point2, Point3};
use avln_scene::limits::{MAX_TRIANGLES, MAX_VERTICES};

const MAX_POLYGON: usize = 4096;
/// Coordinates beyond this are damage, in any unit.
const MAX_COORDINATE: f64 = 1.0e9;
/// Columns of a vertex that are used, under all their names; the place in this list is the place in a row.
const VERTEX_COLUMNS: [&[&str]; 9] = [
    &["x"],
    &["y"],
    &["z"],
    &["red", "diffuse_red", "r"],
    &["green", "diffuse_green", "g"],
    &["blue", "diffuse_blue", "b"],
    &["u", "s", "texture_u"],
    &["v", "t", "texture_v"],
    &["object_id", "objectId"],
];
const RED: usize = 3;
const U: usize = 6;
const OBJECT: usize = 8;

/// What the file holds; the lists of vertices are equally long, so are those of faces.
#[derive(Default)]
pub(super) struct Tables {
    pub(super) positions: Vec<Point3<f32>>,
    pub(super) uvs: Vec<Point2<f32>>,
    pub(super) colors: Vec<[u8; 3]>,
    pub(super) has_uvs: bool,
    pub(super) is_coloured: bool,
    pub(super) vertex_objects: Option<Vec<i64>>,
    pub(super) face_objects: Option<Vec<i64>>,
    pub(super) face_segments: Option<Vec<i64>>,
    corners: Vec<u32>,
    /// Where each face's corners end in `corners`.
    ends: Vec<u32>,
}

/// What a column of a face is for.
#[derive(Clone, Copy, PartialEq)]
enum FaceColumn {
    Corners,
    Object,
    Segment,
    Other,
}

impl Tables {
    /// Reads all tables in the order of the header.
    pub(super) fn read(bytes: &[u8], header: &Header, report: &mut Report) -> Checked<Self> {
        let mut tables = Self::default();
        let mut body = Body::new(bytes, header.body, header.lines, header.format);
        for element in &header.elements {
            check_fits(element, header.format, &body)?;
            match element.name.as_str() {
                "vertex" if tables.positions.is_empty() => tables.read_vertices(element, &mut body)?,
                "face" if tables.ends.is_empty() => tables.read_faces(element, &mut body, report)?,
                _ => skip_rows(element, &mut body)?,
            }
        }
        let count = tables.positions.len();
        match tables.corners.iter().position(|&corner| corner as usize >= count) {
            Some(at) => Err(format!(
                "face {} refers to vertex {}, there are {count}; export the file again",
                tables.ends.partition_point(|&end| end as usize <= at),
                tables.corners[at]
            )),
            None => Ok(tables),
        }
    }

    /// The corners of each face.
    pub(super) fn faces(&self) -> impl Iterator<Item = &[u32]> {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(start, &end)| &self.corners[start as usize..end as usize])
    }

    fn read_vertices(&mut self, element: &Element, body: &mut Body<'_>) -> Checked<()> {
        let columns: Vec<Option<usize>> = element.properties.iter().map(vertex_column).collect();
        let has = |column: usize| columns.contains(&Some(column));
        if !(has(0) && has(1) && has(2)) {
            return Err("its vertices have no x, y and z; export the file again".to_owned());
        }
        (self.is_coloured, self.has_uvs) = ((RED..RED + 3).all(has), has(U) && has(U + 1));
        let full_scale = |column: usize| {
            let found = columns.iter().position(|&found| found == Some(column));
            found.map_or(1.0, |index| element.properties[index].kind.full_scale())
        };
        let color_scale: [f64; 3] = std::array::from_fn(|channel| 255.0 / full_scale(RED + channel));
        let mut objects = has(OBJECT).then(Vec::new);
        for row in 0..element.count {
            let place = body.place();
            let values = vertex_row(element, &columns, body)?;
            self.positions.push(position(&values).ok_or_else(|| {
                format!("{place}: vertex {row} has no usable position; repair the mesh in a 3D editor")
            })?);
            let share = |value: f64| if value.abs() <= 1.0e5 { value as f32 } else { 0.0 };
            self.uvs.push(Point2::new(
                share(values[U]),
                if self.has_uvs { 1.0 - share(values[U + 1]) } else { 0.0 },
            ));
            let color = |channel: usize| (values[RED + channel] * color_scale[channel]).round() as u8;
            self.colors.push(if self.is_coloured { std::array::from_fn(color) } else { [255; 3] });
            if let Some(objects) = &mut objects {
                objects.push(values[OBJECT] as i64);
            }
        }
        self.vertex_objects = objects;
        Ok(())
    }

    fn read_faces(&mut self, element: &Element, body: &mut Body<'_>, report: &mut Report) -> Checked<()> {
        let columns: Vec<FaceColumn> = element.properties.iter().map(face_column).collect();
        if !columns.contains(&FaceColumn::Corners) {
            return Err("its faces have no list vertex_indices; export the file again".to_owned());
        }
        let labels = |column: FaceColumn| columns.contains(&column).then(Vec::new);
        let (mut objects, mut segments) = (labels(FaceColumn::Object), labels(FaceColumn::Segment));
        let (mut triangles, mut degenerate) = (0, 0);
        for row in 0..element.count {
            let first = self.corners.len();
            for (property, &column) in element.properties.iter().zip(&columns) {
                match (column, property.length) {
                    (FaceColumn::Corners, Some(_)) => self.read_corners(property, row, body)?,
                    (FaceColumn::Object, None) => push(&mut objects, body.number(property.kind)?),
                    (FaceColumn::Segment, None) => push(&mut segments, body.number(property.kind)?),
                    _ => skip_property(property, body)?,
                }
            }
            let corners = self.corners.len() - first;
            triangles += corners.saturating_sub(2);
            degenerate += usize::from(corners < 3);
            if triangles > MAX_TRIANGLES {
                return Err(format!(
                    "it has more than {MAX_TRIANGLES} triangles; decimate it in a 3D editor"
                ));
            }
            self.ends.push(self.corners.len() as u32);
        }
        if degenerate > 0 {
            report.warn(format!("{degenerate} faces have fewer than three corners and are left out"));
        }
        (self.face_objects, self.face_segments) = (objects, segments);
        Ok(())
    }

    fn read_corners(&mut self, property: &Property, row: usize, body: &mut Body<'_>) -> Checked<()> {
        let place = body.place();
        let length = body.length(property.length.unwrap_or(property.kind))?;
        if length > MAX_POLYGON {
            return Err(format!("{place}: face {row} has {length} corners, at most {MAX_POLYGON} are read"));
        }
        for _ in 0..length {
            let corner = body.number(property.kind)?;
            if !(0.0..f64::from(u32::MAX)).contains(&corner) || corner.fract() != 0.0 {
                return Err(format!("{place}: face {row} refers to vertex {corner}; export the file again"));
            }
            self.corners.push(corner as u32);
        }
        Ok(())
    }
}

/// Refuses a table that cannot lie in the rest of the file, before anything is reserved for it.
fn check_fits(element: &Element, format: Format, body: &Body<'_>) -> Checked<()> {
    let least = element.count.checked_mul(element.least_row_bytes(format));
    // The last number of a text needs no blank behind it.
    if least.is_none_or(|least| least > body.bytes_left() + 1) {
        return Err(format!(
            "{}: {} rows of {:?} are announced and {} bytes left; copy the file again",
            body.place(),
            element.count,
            element.name,
            body.bytes_left()
        ));
    }
    if element.name == "vertex" && element.count > MAX_VERTICES {
        return Err(format!("it has more than {MAX_VERTICES} vertices; decimate it in a 3D editor"));
    }
    Ok(())
}

fn skip_rows(element: &Element, body: &mut Body<'_>) -> Checked<()> {
    if element.properties.is_empty() {
        return Ok(());
    }
    (0..element.count)
        .try_for_each(|_| element.properties.iter().try_for_each(|property| skip_property(property, body)))
}

fn skip_property(property: &Property, body: &mut Body<'_>) -> Checked<()> {
    let count = property.length.map_or(Ok(1), |kind| body.length(kind))?;
    body.skip(property.kind, count)
}

fn vertex_column(property: &Property) -> Option<usize> {
    let column = VERTEX_COLUMNS.iter().position(|names| names.contains(&property.name.as_str()));
    column.filter(|_| property.length.is_none())
}

fn face_column(property: &Property) -> FaceColumn {
    match (property.name.as_str(), property.length) {
        ("vertex_indices" | "vertex_index", Some(_)) => FaceColumn::Corners,
        ("object_id" | "objectId", None) => FaceColumn::Object,
        ("face_material", None) => FaceColumn::Segment,
        _ => FaceColumn::Other,
    }
}

fn vertex_row(element: &Element, columns: &[Option<usize>], body: &mut Body<'_>) -> Checked<[f64; 9]> {
    let mut values = [0.0; VERTEX_COLUMNS.len()];
    for (property, column) in element.properties.iter().zip(columns) {
        match column {
            Some(column) => values[*column] = body.number(property.kind)?,
            None => skip_property(property, body)?,
        }
    }
    Ok(values)
}

fn position(values: &[f64; 9]) -> Option<Point3<f32>> {
    let position = [values[0], values[1], values[2]];
    let usable = position.iter().all(|value| value.abs() <= MAX_COORDINATE);
    usable.then(|| Point3::from(position.map(|value| value as f32)))
}

fn push(labels: &mut Option<Vec<i64>>, value: f64) {
    if let Some(labels) = labels {
        labels.push(value as i64);
    }
}
