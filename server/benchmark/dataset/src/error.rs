//! Errors of data sets and their files.

use avln_scene::SceneError;
use avln_world::PrepareError;

/// Data set error.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// Unreadable scene.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// Scene without walkable floor.
    #[error("scene {scene}: {source}")]
    Prepare {
        /// Scene name.
        scene: String,
        /// Cause.
        source: PrepareError,
    },
    /// Scene without missions.
    #[error(
        "scene {scene} has no mission: {instances} out of {objects} labelled instances are potential targets, and no two \
         are far enough from a start and from each other; use a larger scene or more labels"
    )]
    NoMission {
        /// Scene name.
        scene: String,
        /// Potential targets.
        instances: usize,
        /// Labelled instances.
        objects: usize,
    },
    /// Changed scene.
    #[error(
        "scene {scene} has digest {found}, the split expects {expected}; restore the file or rebuild the split"
    )]
    Changed {
        /// Scene name.
        scene: String,
        /// Current digest.
        found: String,
        /// Recorded digest.
        expected: String,
    },
    /// Failed verifier.
    #[error("the verifier failed: {0}")]
    Verifier(String),
    /// Invalid recipe: field, value and allowed range.
    #[error("invalid recipe: {0}")]
    Recipe(String),
    /// Invalid data set file.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// Invalid split file.
    #[error("invalid split file: {0}")]
    Malformed(String),
}

/// Error in a data set file.
#[derive(Debug, PartialEq, thiserror::Error)]
#[error("{file}{}: {cause}", line.map(|line| format!(", line {line}")).unwrap_or_default())]
pub struct FormatError {
    /// File name.
    pub file: String,
    /// Line number from 1; `None` for the whole file.
    pub line: Option<usize>,
    /// Cause.
    pub cause: String,
}
