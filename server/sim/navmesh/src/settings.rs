//! Walking bodies, construction settings and construction errors.

/// An upright cylinder that walks. The default is Habitat's body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// Clearance to walls, metres, 0 to 2; rounded up to whole lattice cells, at least one.
    pub radius_m: f32,
    /// Required headroom, metres, 0.2 to 10.
    pub height_m: f32,
    /// Highest step, metres, 0 to 1.
    pub climb_m: f32,
    /// Steepest slope, degrees, 0 to 89.
    pub slope_deg: f32,
}

impl Default for Body {
    fn default() -> Self {
        Self { radius_m: 0.1, height_m: 1.5, climb_m: 0.2, slope_deg: 45.0 }
    }
}

/// Construction settings. The default is Habitat's (habitat-sim, `NavMeshSettings::setDefaults`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NavMeshSettings {
    /// Walking body.
    pub body: Body,
    /// Lattice cell width, metres, 0.01 to 1.
    pub cell_m: f32,
    /// Lattice cell height and step resolution, metres, 0.01 to 1.
    pub level_m: f32,
    /// Smallest floor part: side length of a square, cells, 0 to 200.
    pub region_min_cells: f32,
    /// Regions below this size are merged: side length of a square, cells, 0 to 200.
    pub region_merge_cells: f32,
    /// Greatest outline edge length, metres, 0 (unlimited) to 1000.
    pub edge_max_m: f32,
    /// Greatest deviation between outline and raster, cells, 0 to 10.
    pub edge_error_cells: f32,
    /// Height sample spacing, cells, 0 to 100; below 0.9 without samples.
    pub detail_cells: f32,
    /// Greatest height error between samples, levels, 0 to 100.
    pub detail_error_levels: f32,
    /// Reference for outlines and heights.
    pub finish: Finish,
}

/// A reference for outlines and heights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Finish {
    /// Recast and Detour as in Habitat: watershed regions, no margin around the scene, lattice heights (up to
    /// a level above the ground), clearance a level above body height.
    Habitat,
    /// The scene: surface heights, and outlines that preserve single-cell passages.
    Scene,
}

impl Default for NavMeshSettings {
    fn default() -> Self {
        Self {
            body: Body::default(),
            cell_m: 0.05,
            level_m: 0.2,
            region_min_cells: 20.0,
            region_merge_cells: 20.0,
            edge_max_m: 12.0,
            edge_error_cells: 1.3,
            detail_cells: 6.0,
            detail_error_levels: 1.0,
            finish: Finish::Habitat,
        }
    }
}

impl From<&Body> for NavMeshSettings {
    /// Returns the arena's settings: levels of 5 cm, scene heights.
    fn from(body: &Body) -> Self {
        // With Habitat's 20 cm levels a body could climb almost twice the permitted height.
        Self { body: *body, level_m: 0.05, edge_error_cells: 0.99, finish: Finish::Scene, ..Self::default() }
    }
}

impl NavMeshSettings {
    /// Checks all values against the documented ranges.
    pub(crate) fn check(&self) -> Result<(), NavMeshError> {
        let body = [
            ("radius_m", self.body.radius_m, 0.0, 2.0),
            ("height_m", self.body.height_m, 0.2, 10.0),
            ("climb_m", self.body.climb_m, 0.0, 1.0),
            ("slope_deg", self.body.slope_deg, 0.0, 89.0),
        ];
        let settings = [
            ("cell_m", self.cell_m, 0.01, 1.0),
            ("level_m", self.level_m, 0.01, 1.0),
            ("region_min_cells", self.region_min_cells, 0.0, 200.0),
            ("region_merge_cells", self.region_merge_cells, 0.0, 200.0),
            ("edge_max_m", self.edge_max_m, 0.0, 1000.0),
            ("edge_error_cells", self.edge_error_cells, 0.0, 10.0),
            ("detail_cells", self.detail_cells, 0.0, 100.0),
            ("detail_error_levels", self.detail_error_levels, 0.0, 100.0),
        ];
        check_ranges(&body).map_err(NavMeshError::Body)?;
        check_ranges(&settings).map_err(NavMeshError::Settings)
    }
}

fn check_ranges(values: &[(&str, f32, f32, f32)]) -> Result<(), String> {
    for (field, value, low, high) in values {
        // NaN is outside too.
        if !(low..=high).contains(&value) {
            return Err(format!("{field} is {value}; write {low} to {high}"));
        }
    }
    Ok(())
}

/// Settings in whole cells, rounded by `finish`.
pub(crate) struct Cells {
    pub(crate) radius: u16,
    pub(crate) height: u16,
    /// Required free levels above a floor.
    pub(crate) clearance: u16,
    pub(crate) climb: u16,
    pub(crate) min_area: u16,
    pub(crate) merge_area: u16,
    pub(crate) edge_max: u16,
}

impl Cells {
    pub(crate) fn new(settings: &NavMeshSettings) -> Self {
        let (body, cell_m, level_m) = (&settings.body, settings.cell_m, settings.level_m);
        let (radius, climb) = (body.radius_m / cell_m, body.climb_m / level_m);
        let height = (body.height_m / level_m).ceil() as u16;
        let (radius, climb, clearance) = match settings.finish {
            // Habitat's Recast requires a level more than the body height.
            Finish::Habitat => (radius.ceil(), climb.floor(), height + 1),
            // 0.2 m are four levels of 0.05 m despite f32 rounding. A radius of at least one cell leaves no
            // crack between unconnected adjacent cells.
            Finish::Scene => ((radius - 1e-3).ceil().max(1.0), (climb + 1e-3).floor(), height),
        };
        let square = |side: f32| (side * side) as u16;
        Self {
            radius: radius as u16,
            height,
            clearance,
            climb: climb as u16,
            min_area: square(settings.region_min_cells),
            merge_area: square(settings.region_merge_cells),
            edge_max: (settings.edge_max_m / cell_m) as u16,
        }
    }
}

/// A failed navmesh construction.
#[derive(Debug, thiserror::Error)]
pub enum NavMeshError {
    /// An invalid body measure.
    #[error("the body's {0}")]
    Body(String),
    /// An invalid setting.
    #[error("the navmesh setting {0}")]
    Settings(String),
    /// A scene without triangles.
    #[error("scene `{scene}` has no triangles, and so no floor; check that its mesh was imported")]
    Empty {
        /// Scene name.
        scene: String,
    },
    /// An invalid scene mesh.
    #[error("the mesh of scene `{scene}` is invalid: {defect}; repair or re-export the file")]
    Malformed {
        /// Scene name.
        scene: String,
        /// The item, with value and limit.
        defect: String,
    },
    /// A scene beyond the lattice size.
    #[error(
        "scene `{scene}` measures {:.1} x {:.1} x {:.1} m; a navmesh covers at most {limit}: \
         check the unit (metres) and remove stray distant geometry",
        .size_m[0], .size_m[1], .size_m[2]
    )]
    TooLarge {
        /// Scene name.
        scene: String,
        /// Extent in x, y, z, metres.
        size_m: [f32; 3],
        /// Accepted size.
        limit: String,
    },
    /// No surface is large, level and free enough.
    #[error(
        "scene `{scene}` has no floor for a body of radius {} m and height {} m: no upward surface of \
         1 square metre with that headroom; check that Y is up, the unit is metres and floors face upwards",
        .body.radius_m, .body.height_m
    )]
    NoFloor {
        /// Scene name.
        scene: String,
        /// Walking body.
        body: Body,
    },
    /// A failed step in the polygon library.
    #[error("cannot turn scene `{scene}` into walkable polygons: {stage} failed: {reason}")]
    Voxels {
        /// Scene name.
        scene: String,
        /// Pipeline step.
        stage: &'static str,
        /// The library's reason.
        reason: String,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn default_settings_are_habitats_cells() {
        let cells = Cells::new(&NavMeshSettings::default());
        assert_eq!((cells.radius, cells.height, cells.clearance, cells.climb), (2, 8, 9, 1));
        assert_eq!((cells.min_area, cells.merge_area, cells.edge_max), (400, 400, 240));
    }

    #[test]
    fn arena_settings_have_finer_levels() {
        let cells = Cells::new(&NavMeshSettings::from(&Body::default()));
        assert_eq!((cells.radius, cells.height, cells.clearance, cells.climb), (2, 30, 30, 4));
        let thin = Body { radius_m: 0.0, ..Body::default() };
        assert_eq!(Cells::new(&NavMeshSettings::from(&thin)).radius, 1);
    }

    #[test]
    fn out_of_range_values_are_named() {
        let bad = NavMeshSettings { cell_m: f32::NAN, ..Default::default() };
        assert!(bad.check().is_err_and(|error| error.to_string().contains("cell_m is NaN")));
        assert!(NavMeshSettings::default().check().is_ok());
    }
}
