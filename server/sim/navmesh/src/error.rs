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
