//! Data set files: JSON lines, with a public and a sealed file per scene.
//!
//! ```text
//! DIR/dataset.json                  Manifest: version, recipe, splits with digests
//! DIR/SPLIT/scenes.jsonl            SceneLine: scene source, and digests for both files
//! DIR/SPLIT/missions/SCENE.jsonl    public: starts and goal cues
//! DIR/SPLIT/sealed/SCENE.jsonl      hidden: targets, success regions, picture views, reference tours
//! ```

mod lines;
mod read;
mod write;

pub use lines::{
    DATASET_VERSION, FormatCause, FormatError, Manifest, PublicGoal, PublicMission, SceneFacts, SceneLine,
    SplitLine,
};
pub use read::{File, read_manifest, read_missions, read_scene, read_scenes};
pub use write::{WrittenScene, digest_of, manifest_bytes, scenes_bytes, write_scene};
