use super::{FormatsError, pack::pack};
use crate::{
    cue::{CueSpec, View},
    mission::{EpisodeSpec, GoalSpec},
};
use avln_episode::Rules;
use avln_geom::{Point3, Pose, angle};
use avln_scene::categories::TARGET_CATEGORIES;
use serde_json::{Map, Value, json};

/// Numbers of [`TARGET_CATEGORIES`] in mpcat40, in the same order.
const MPCAT40: [u32; 21] = [3, 5, 6, 7, 8, 10, 11, 13, 14, 15, 18, 19, 20, 22, 23, 25, 26, 27, 33, 34, 38];

/// A file of an exported data set.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExportedFile {
    /// Where it belongs, relative to the folder of the data set.
    pub path: String,
    /// What it holds.
    pub bytes: Vec<u8>,
}

/// Writes a split as the authors' loader reads it: an index `SPLIT/SPLIT.json.gz` and `SPLIT/content/SCENE.json.gz` for
/// each scene. `scenes` are their names with their missions.
///
/// An instance that is described by two sentences has two records, since a record holds one. What their schema has and
/// ours does not know (sounds, pixel counts, detections) is left out; their loader fills it in.
///
/// # Errors
/// When a file cannot be packed.
pub fn write_authors(
    split: &str,
    scenes: &[(&str, &[EpisodeSpec])],
    rules: &Rules,
) -> Result<Vec<ExportedFile>, FormatsError> {
    let numbered = |numbers: &mut dyn Iterator<Item = u32>| -> Map<String, Value> {
        TARGET_CATEGORIES
            .iter()
            .zip(numbers)
            .map(|(name, number)| ((*name).to_owned(), number.into()))
            .collect()
    };
    let index = json!({
        "dataset": "omni_long_nav",
        "split": split,
        "episodes": [],
        "content_scenes_path": "{data_path}/content/{scene}.json.gz",
        "category_to_task_category_id": numbered(&mut (0..)),
        "category_to_mp3d_category_id": numbered(&mut MPCAT40.into_iter()),
    });
    let mut files = vec![file(format!("{split}/{split}.json.gz"), &index)?];
    for (scene, episodes) in scenes {
        files.push(file(format!("{split}/content/{scene}.json.gz"), &content(scene, episodes, rules))?);
    }
    Ok(files)
}

fn file(path: String, value: &Value) -> Result<ExportedFile, FormatsError> {
    match pack(value.to_string().as_bytes()) {
        Ok(bytes) => Ok(ExportedFile { path, bytes }),
        Err(error) => Err(FormatsError::Unwritable { file: path, cause: error.to_string() }),
    }
}

fn content(scene: &str, episodes: &[EpisodeSpec], rules: &Rules) -> Value {
    let mut records = Records { camera_m: rules.camera_height_m, all: Vec::new() };
    let scene_id = format!("{scene}/{scene}.glb");
    let numbered = numbers(scene, episodes).into_iter().zip(episodes);
    let episodes: Vec<Value> = numbered
        .map(|(number, episode)| self::episode(episode, number, &scene_id, &mut records, rules))
        .collect();
    json!({
        "dataset": "valid_instance_trajectory_dataset",
        "version": "0.1",
        "scene_name": scene,
        "scene_id": scene_id,
        "sampling": {"num_trajectories": episodes.len()},
        "episodes": episodes,
        "instances": records.finish(),
    })
}

/// The numbers of episodes: those that their ids end in, else their places, since their loader wants numbers.
fn numbers(scene: &str, episodes: &[EpisodeSpec]) -> Vec<u64> {
    let own = |episode: &EpisodeSpec| episode.id.strip_prefix(scene)?.strip_prefix('-')?.parse().ok();
    let all: Option<Vec<u64>> = episodes.iter().map(own).collect();
    all.unwrap_or_else(|| (0..episodes.len() as u64).collect())
}

fn episode(
    episode: &EpisodeSpec,
    number: u64,
    scene_id: &str,
    records: &mut Records,
    rules: &Rules,
) -> Value {
    let goals: Vec<Value> = episode.goals.iter().map(|goal| records.pair(goal)).collect();
    json!({
        "episode_id": number.to_string(),
        "scene_id": scene_id,
        "start_position": place(&episode.start.position),
        "start_rotation": rotation(&episode.start),
        "num_goals": goals.len(),
        "goals": goals,
        "ordered_total_geodesic_distance": episode.ordered.length_m,
        "unordered_total_geodesic_distance": episode.unordered.length_m,
        "object_category": episode.goals.first().map(|goal| goal.target.category.as_str()),
        "sound_source_schedule": ["round_robin", rules.sounding_window_steps],
    })
}

/// The instance records of a scene, as goals name them.
struct Records {
    camera_m: f32,
    all: Vec<Record>,
}

struct Record {
    key: String,
    fields: Map<String, Value>,
    description: Option<String>,
    pictures: Vec<View>,
}

impl Records {
    /// Key and modality of a goal, whose record is added where it is new.
    fn pair(&mut self, goal: &GoalSpec) -> Value {
        let sentence = match &goal.cue {
            CueSpec::Description(sentence) => Some(&sentence.text),
            CueSpec::Category | CueSpec::Image(_) => None,
        };
        let record = self.record(goal, sentence);
        let modality = match &goal.cue {
            CueSpec::Category => "object".to_owned(),
            CueSpec::Description(sentence) => {
                record.description = Some(sentence.text.clone());
                "description".to_owned()
            }
            CueSpec::Image(view) => format!("image_{}", record.picture(view)),
        };
        json!([record.key, modality])
    }

    /// The first record of the instance that has no other sentence.
    fn record(&mut self, goal: &GoalSpec, sentence: Option<&String>) -> &mut Record {
        let mut number = 1;
        loop {
            let base = format!("{}_{}", goal.target.category, goal.target.instance);
            let key = if number == 1 { base } else { format!("{base}_sentence{number}") };
            let Some(index) = self.all.iter().position(|record| record.key == key) else {
                let fields = fields(goal);
                self.all.push(Record { key, fields, description: None, pictures: Vec::new() });
                let last = self.all.len() - 1;
                return &mut self.all[last];
            };
            let known = &self.all[index].description;
            if sentence.is_none() || known.is_none() || known.as_ref() == sentence {
                return &mut self.all[index];
            }
            number += 1;
        }
    }

    fn finish(self) -> Map<String, Value> {
        let camera_m = self.camera_m;
        self.all.into_iter().map(|record| (record.key.clone(), record.finish(camera_m))).collect()
    }
}

impl Record {
    fn picture(&mut self, view: &View) -> usize {
        let known = self.pictures.iter().position(|picture| picture == view);
        known.unwrap_or_else(|| {
            self.pictures.push(*view);
            self.pictures.len() - 1
        })
    }

    fn finish(mut self, camera_m: f32) -> Value {
        let pictures: Vec<Value> = self.pictures.iter().map(|view| picture(view, camera_m)).collect();
        let has_text = self.description.is_some();
        self.fields.insert("num_render_view_points".to_owned(), pictures.len().into());
        self.fields.insert("num_image_views".to_owned(), pictures.len().into());
        self.fields.insert(
            "modalities".to_owned(),
            json!({"audio": true, "object": true, "image": !pictures.is_empty(), "text_description": has_text}),
        );
        self.fields.insert("render_view_points".to_owned(), pictures.into());
        if let Some(description) = self.description {
            self.fields.insert("description".to_owned(), description.into());
        }
        Value::Object(self.fields)
    }
}

fn fields(goal: &GoalSpec) -> Map<String, Value> {
    let target = &goal.target;
    let (bounds, size) = (&target.bounds, target.bounds.size());
    let view = |pose: &Pose| json!({"agent_state": state(pose)});
    let fields = json!({
        "semantic_id": target.instance,
        "category": target.category,
        "center": place(&bounds.center()),
        "bbox_size": [size.x, size.y, size.z],
        "bbox_min": place(&bounds.min),
        "bbox_max": place(&bounds.max),
        "horizontal_radius": 0.5 * (size.x * size.x + size.z * size.z).sqrt(),
        "nav_position": target.viewpoints.first().map(|pose| place(&pose.position)),
        "view_points": target.viewpoints.iter().map(view).collect::<Vec<_>>(),
        "num_view_points": target.viewpoints.len(),
    });
    match fields {
        Value::Object(fields) => fields,
        _ => Map::new(),
    }
}

fn picture(view: &View, camera_m: f32) -> Value {
    let mut eye = view.pose.position;
    eye.y += camera_m;
    json!({
        "agent_state": state(&view.pose),
        "position": place(&eye),
        "hfov": view.hfov_rad.to_degrees(),
    })
}

fn state(pose: &Pose) -> Value {
    json!({"position": place(&pose.position), "rotation": rotation(pose)})
}

fn place(point: &Point3<f32>) -> Value {
    json!([point.x, point.y, point.z])
}

/// x, y, z, w.
fn rotation(pose: &Pose) -> Value {
    let (sin, cos) = angle::sin_cos(0.5 * pose.heading_rad);
    json!([0.0, sin, 0.0, cos])
}
