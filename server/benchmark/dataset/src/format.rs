//! A data set on disk: lines of JSON, one file pair a scene; what an agent may know apart from what it may not.
//!
//! ```text
//! DIR/dataset.json                  Manifest: version, recipe, splits with digests
//! DIR/SPLIT/scenes.jsonl            SceneLine: where a scene comes from, and digests of its two files
//! DIR/SPLIT/missions/SCENE.jsonl    public: starts and goal cues
//! DIR/SPLIT/sealed/SCENE.jsonl      hidden: targets, success regions, views of pictures, reference tours
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
