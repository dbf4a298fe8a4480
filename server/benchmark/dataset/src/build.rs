//! Data sets by recipe: which scenes, how many missions in each, and what makes a mission worth playing.

mod recipe;
mod scene;

pub use recipe::{MissionRules, Recipe, SceneChoice, SplitRecipe};
pub use scene::{BuiltScene, Job, build_scene};
