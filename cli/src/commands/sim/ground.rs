use avln_arena::{Failure, FailureKind};
use avln_formats::open;
use avln_navmesh::{Body, NavMesh, NavMeshSettings};
use clap::Args;
use std::path::PathBuf;

/// The navmesh to walk on: built from a scene with Habitat's settings, or read from Habitat's file.
#[derive(Debug, Args)]
pub struct Ground {
    /// A scene in any layout that can be opened: a file or a folder
    #[arg(long, value_name = "PATH", required_unless_present = "navmesh")]
    scene: Option<PathBuf>,
    /// A Habitat .navmesh to use instead of building one
    #[arg(long, value_name = "FILE.navmesh")]
    navmesh: Option<PathBuf>,
    /// How far the body's middle stays from walls, metres
    #[arg(long, value_name = "METRES", default_value_t = 0.1)]
    agent_radius: f32,
    /// Headroom that the body needs, metres
    #[arg(long, value_name = "METRES", default_value_t = 1.5)]
    agent_height: f32,
    /// The highest step that is walked, metres
    #[arg(long, value_name = "METRES", default_value_t = 0.2)]
    max_climb: f32,
    /// The steepest slope that is walked, degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 45.0)]
    max_slope: f32,
    /// Width of the cells that floors are found with, metres
    #[arg(long, value_name = "METRES", default_value_t = 0.05)]
    cell_size: f32,
    /// Height of these cells, metres
    #[arg(long, value_name = "METRES", default_value_t = 0.2)]
    cell_height: f32,
}

impl Ground {
    /// Reads or builds the navmesh.
    pub(super) fn mesh(&self) -> Result<NavMesh, Failure> {
        let failed = |error: &dyn std::fmt::Display| Failure::new(FailureKind::Scene, error);
        if let Some(file) = &self.navmesh {
            let named = |error: &dyn std::fmt::Display| failed(&format!("{}: {error}", file.display()));
            let bytes = std::fs::read(file).map_err(|error| named(&error))?;
            return NavMesh::from_detour(&bytes).map_err(|error| named(&error));
        }
        let path = self.scene.clone().unwrap_or_default();
        let scene = open::open(&path).map_err(|error| failed(&error))?;
        NavMesh::build_with(&scene, &self.settings()).map_err(|error| failed(&error))
    }

    fn settings(&self) -> NavMeshSettings {
        let body = Body {
            radius_m: self.agent_radius,
            height_m: self.agent_height,
            climb_m: self.max_climb,
            slope_deg: self.max_slope,
        };
        NavMeshSettings { body, cell_m: self.cell_size, level_m: self.cell_height, ..Default::default() }
    }
}
