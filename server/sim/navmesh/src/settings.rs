/// Construction settings of a navmesh. The default is Habitat's (habitat-sim,
/// `NavMeshSettings::setDefaults`): cells of 5 cm by 20 cm, regions of at least 20 x 20 cells, outlines
/// within 1.3 cells of the raster, walls cut at 12 m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NavMeshSettings {
    /// Walking body.
    pub body: Body,
    /// Width of a lattice cell, metres, 0.01 to 1.
    pub cell_m: f32,
    /// Height of a lattice cell, metres, 0.01 to 1. Heights and steps are known to this only.
    pub level_m: f32,
    /// Side, in cells, of the square that the smallest part of floor must cover, 0 to 200.
    pub region_min_cells: f32,
    /// Merge threshold of regions: side of a square in cells, 0 to 200.
    pub region_merge_cells: f32,
    /// Length at which the outline of a wall is cut, metres, 0 (never) to 1000.
    pub edge_max_m: f32,
    /// Largest deviation of an outline from the raster, cells, 0 to 10.
    pub edge_error_cells: f32,
    /// Spacing of height samples, cells, 0 (none) to 100; values below 0.9 disable them.
    pub detail_cells: f32,
    /// Largest height error between samples, levels, 0 to 100.
    pub detail_error_levels: f32,
    /// Reference for outlines and heights.
    pub finish: Finish,
}

/// Reference for outlines and heights of a navmesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Finish {
    /// Recast and Detour as in Habitat: watershed regions, no margin around the scene, lattice heights (up to
    /// a level above the ground), clearance of a level above body height.
    Habitat,
    /// The scene: outlines that preserve passages of a single cell, heights of the supporting surfaces.
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
    /// The arena's own: levels of 5 cm, so that a step is climbed up to the body's measure and no higher, and the heights
    /// of the scene.
    fn from(body: &Body) -> Self {
        let (level_m, edge_error_cells, finish) = (0.05, 0.99, Finish::Scene);
        Self { body: *body, level_m, edge_error_cells, finish, ..Self::default() }
    }
}

impl NavMeshSettings {
    /// Refuses values outside of the ranges that the fields name.
    pub(crate) fn check(&self) -> Result<(), NavMeshError> {
        self.body.check()?;
        let checks = [
            ("cell_m", self.cell_m, 0.01, 1.0),
            ("level_m", self.level_m, 0.01, 1.0),
            ("region_min_cells", self.region_min_cells, 0.0, 200.0),
            ("region_merge_cells", self.region_merge_cells, 0.0, 200.0),
            ("edge_max_m", self.edge_max_m, 0.0, 1000.0),
            ("edge_error_cells", self.edge_error_cells, 0.0, 10.0),
            ("detail_cells", self.detail_cells, 0.0, 100.0),
            ("detail_error_levels", self.detail_error_levels, 0.0, 100.0),
        ];
        for (field, value, low, high) in checks {
            if !(low..=high).contains(&value) {
                return Err(NavMeshError::Settings { field, value, low, high });
            }
        }
        Ok(())
    }
}

/// Settings in whole cells, rounded by `finish`.
pub(crate) struct Cells {
    pub(crate) radius: u16,
    pub(crate) height: u16,
    /// Required free levels above a floor: in Habitat's Recast the height plus 1.
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

/// The upright cylinder that walks. The default is Habitat's: radius 0.1 m, height 1.5 m, climb 0.2 m, slope 45 degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// Distance from the centre to walls, metres, 0 to 2; rounded up to whole lattice cells of 5 cm, at least
    /// one.
    pub radius_m: f32,
    /// Headroom that is needed, metres, 0.2 to 10.
    pub height_m: f32,
    /// The highest step that is walked, metres, 0 to 1.
    pub climb_m: f32,
    /// The steepest slope that is walked, degrees, 0 to 89.
    pub slope_deg: f32,
}

impl Default for Body {
    fn default() -> Self {
        Self { radius_m: 0.1, height_m: 1.5, climb_m: 0.2, slope_deg: 45.0 }
    }
}

impl Body {
    /// Refuses measures outside of the ranges that the fields name.
    pub(crate) fn check(&self) -> Result<(), NavMeshError> {
        let checks = [
            ("radius_m", self.radius_m, 0.0, 2.0),
            ("height_m", self.height_m, 0.2, 10.0),
            ("climb_m", self.climb_m, 0.0, 1.0),
            ("slope_deg", self.slope_deg, 0.0, 89.0),
        ];
        for (field, value, low, high) in checks {
            if !(low..=high).contains(&value) {
                return Err(NavMeshError::Body { field, value, low, high });
            }
        }
        Ok(())
    }
}

/// Errors during the construction of a navmesh.
#[derive(Debug, thiserror::Error)]
pub enum NavMeshError {
    /// A measure of the body is out of range.
    #[error("the body's {field} is {value}; a navmesh can be built for {low} to {high}")]
    Body {
        /// The field of [`Body`](crate::Body).
        field: &'static str,
        /// The value.
        value: f32,
        /// The smallest value allowed.
        low: f32,
        /// The largest value allowed.
        high: f32,
    },
    /// A setting is out of range.
    #[error("the navmesh setting {field} is {value}; it can be {low} to {high}")]
    Settings {
        /// The field of [`NavMeshSettings`](crate::NavMeshSettings).
        field: &'static str,
        /// The value.
        value: f32,
        /// The smallest value allowed.
        low: f32,
        /// The largest value allowed.
        high: f32,
    },
    /// The scene has no triangles.
    #[error("scene `{scene}` has no triangles, so nobody can stand in it; check that its mesh was imported")]
    Empty {
        /// Name of the scene.
        scene: String,
    },
    /// The scene's mesh is not a mesh.
    #[error("the mesh of scene `{scene}` is broken: {what}; repair or re-export the file")]
    Malformed {
        /// Name of the scene.
        scene: String,
        /// The part, with value and limit.
        what: String,
    },
    /// The scene is larger than the lattice can be.
    #[error(
        "scene `{scene}` measures {width_m:.1} x {height_m:.1} x {depth_m:.1} m; a navmesh covers at most {limit}: \
         check the unit (metres) and remove far-away stray geometry"
    )]
    TooLarge {
        /// Name of the scene.
        scene: String,
        /// Extent in x.
        width_m: f32,
        /// Extent in y.
        height_m: f32,
        /// Extent in z.
        depth_m: f32,
        /// Accepted range.
        limit: String,
    },
    /// No surface is large, level and free enough.
    #[error(
        "scene `{scene}` has no floor for a body of radius {radius_m} m and height {height_m} m: no upward surface of \
         1 square metre with that headroom; check that Y is up, the unit is metres and floors face upwards"
    )]
    NoFloor {
        /// Name of the scene.
        scene: String,
        /// Radius of the body.
        radius_m: f32,
        /// Height of the body.
        height_m: f32,
    },
    /// The polygon builder gave up.
    #[error("cannot turn scene `{scene}` into walkable polygons: {stage} failed: {reason}")]
    Voxels {
        /// Name of the scene.
        scene: String,
        /// Step of the pipeline.
        stage: &'static str,
        /// Reason given by the library.
        reason: String,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn habitats_defaults_are_its_documented_cells() {
        let cells = Cells::new(&NavMeshSettings::default());
        assert_eq!((cells.radius, cells.height, cells.clearance, cells.climb), (2, 8, 9, 1));
        assert_eq!((cells.min_area, cells.merge_area, cells.edge_max), (400, 400, 240));
    }

    #[test]
    fn the_arenas_own_are_finer_in_height() {
        let cells = Cells::new(&NavMeshSettings::from(&Body::default()));
        assert_eq!((cells.radius, cells.height, cells.clearance, cells.climb), (2, 30, 30, 4));
        let thin = Body { radius_m: 0.0, ..Body::default() };
        assert_eq!(Cells::new(&NavMeshSettings::from(&thin)).radius, 1);
    }

    #[test]
    fn values_out_of_range_are_named() {
        let bad = NavMeshSettings { cell_m: f32::NAN, ..Default::default() };
        assert!(bad.check().is_err_and(|error| error.to_string().contains("cell_m is NaN")));
        assert!(NavMeshSettings::default().check().is_ok());
    }
}
