//! Writer for the LH-AVLN authors' data set layout.

use crate::{InterchangeError, json::pack};
use avln_dataset::{CueSpec, CueView, EpisodeSpec, GoalSpec, PublicGoal, PublicMission};
use avln_episode::Rules;
use avln_geom::{Point3, Pose, angle};
use avln_scene::categories::TARGET_CATEGORIES;
use serde_json::{Map, Value, json};

/// mpcat40 indices for [`TARGET_CATEGORIES`].
const MPCAT40: [u32; 21] = [3, 5, 6, 7, 8, 10, 11, 13, 14, 15, 18, 19, 20, 22, 23, 25, 26, 27, 33, 34, 38];

/// Exported file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExportedFile {
    /// Path relative to the data set folder.
    pub path: String,
    /// Contents.
    pub bytes: Vec<u8>,
}

/// Missions in a scene, with or without ground truth.
#[derive(Clone, Debug, PartialEq)]
pub enum SceneMissions {
    /// Public part.
    Public(Vec<PublicMission>),
    /// With ground truth.
    Whole(Vec<EpisodeSpec>),
}

impl SceneMissions {
    /// Returns the mission count.
    pub fn count(&self) -> usize {
        match self {
            Self::Public(missions) => missions.len(),
            Self::Whole(episodes) => episodes.len(),
        }
    }
}

/// Returns the index file for a split, compressed; [`authors_scene`] returns the scene files.
pub fn authors_index(split: &str) -> Result<ExportedFile, InterchangeError> {
    let numbered = |number: fn(usize) -> u32| -> Map<String, Value> {
        let names = TARGET_CATEGORIES.iter().enumerate();
        names.map(|(index, name)| ((*name).to_owned(), number(index).into())).collect()
    };
    let index = json!({
        "dataset": "omni_long_nav",
        "split": split,
        "episodes": [],
        "content_scenes_path": "{data_path}/content/{scene}.json.gz",
        "category_to_task_category_id": numbered(|index| index as u32),
        "category_to_mp3d_category_id": numbered(|index| MPCAT40[index]),
    });
    file(format!("{split}/{split}.json.gz"), &index)
}

/// Returns the compressed file for a scene.
///
/// A record has a single sentence, so an instance with two sentences gets two records. Unknown fields (sounds, pixel counts,
/// detections) are omitted; the authors' loader fills them in. Without ground truth every goal has a separate record
/// with the cue and instance 0, which does not exist.
pub fn authors_scene(
    split: &str,
    scene: &str,
    missions: &SceneMissions,
    rules: &Rules,
) -> Result<ExportedFile, InterchangeError> {
    let (episodes, instances) = match missions {
        SceneMissions::Public(missions) => public_content(scene, missions, rules),
        SceneMissions::Whole(episodes) => whole_content(scene, episodes, rules),
    };
    let content = json!({
        "dataset": "valid_instance_trajectory_dataset",
        "version": "0.1",
        "scene_name": scene,
        "scene_id": scene_id(scene),
        "sampling": {"num_trajectories": episodes.len()},
        "episodes": episodes,
        "instances": instances,
    });
    file(format!("{split}/content/{scene}.json.gz"), &content)
}

fn scene_id(scene: &str) -> String {
    format!("{scene}/{scene}.glb")
}

fn file(path: String, value: &Value) -> Result<ExportedFile, InterchangeError> {
    let bytes =
        pack(value.to_string().as_bytes()).map_err(|error| InterchangeError::unwritable(&path, &error))?;
    Ok(ExportedFile { path, bytes })
}

type Content = (Vec<Value>, Map<String, Value>);

fn whole_content(scene: &str, episodes: &[EpisodeSpec], rules: &Rules) -> Content {
    let mut records = Records { camera_m: rules.camera_height_m, all: Vec::new() };
    let numbers = numbers(scene, episodes.iter().map(|episode| episode.id.as_str()));
    let episode = |(number, episode): (u64, &EpisodeSpec)| {
        let goals = episode.goals.iter().map(|goal| records.pair(goal)).collect();
        let mut fields = self::episode(number, scene, &episode.start, goals, rules);
        fields.extend(lengths(episode));
        Value::Object(fields)
    };
    let episodes = numbers.into_iter().zip(episodes).map(episode).collect();
    (episodes, records.finish())
}

fn public_content(scene: &str, missions: &[PublicMission], rules: &Rules) -> Content {
    let mut records = Map::new();
    let numbers = numbers(scene, missions.iter().map(|mission| mission.id.as_str()));
    let episode = |(number, mission): (u64, &PublicMission)| {
        let mut pair = |(index, goal): (usize, &PublicGoal)| {
            let key = format!("mission{number}_goal{index}");
            let (modality, record) = public_record(goal);
            records.insert(key.clone(), record);
            json!([key, modality])
        };
        let goals = mission.goals.iter().enumerate().map(&mut pair).collect();
        Value::Object(self::episode(number, scene, &mission.start, goals, rules))
    };
    let episodes = numbers.into_iter().zip(missions).map(episode).collect();
    (episodes, records)
}

fn public_record(goal: &PublicGoal) -> (&'static str, Value) {
    match goal {
        PublicGoal::Category(label) => ("object", json!({"semantic_id": 0, "category": label})),
        PublicGoal::Description(sentence) => {
            ("description", json!({"semantic_id": 0, "description": sentence}))
        }
        PublicGoal::Image => ("image_0", json!({"semantic_id": 0})),
    }
}

/// Episode numbers from id ends, or indices.
fn numbers<'a>(scene: &str, ids: impl Iterator<Item = &'a str> + Clone) -> Vec<u64> {
    // The authors' loader requires numbers. Our ids end with one, but imported and renamed missions may not: then all are
    // numbered, so that no number occurs twice.
    let own = |id: &str| id.strip_prefix(scene)?.strip_prefix('-')?.parse().ok();
    let all: Option<Vec<u64>> = ids.clone().map(own).collect();
    all.unwrap_or_else(|| (0..ids.count() as u64).collect())
}

fn episode(number: u64, scene: &str, start: &Pose, goals: Vec<Value>, rules: &Rules) -> Map<String, Value> {
    object(json!({
        "episode_id": number.to_string(),
        "scene_id": scene_id(scene),
        "start_position": place(&start.position),
        "start_rotation": rotation(start),
        "num_goals": goals.len(),
        "goals": goals,
        "sound_source_schedule": ["round_robin", rules.sounding_window_steps],
    }))
}

/// Episode fields that depend on ground truth.
fn lengths(episode: &EpisodeSpec) -> Map<String, Value> {
    object(json!({
        "ordered_total_geodesic_distance": episode.ordered.length_m,
        "unordered_total_geodesic_distance": episode.unordered.length_m,
        "object_category": episode.goals.first().map(|goal| goal.target.category.as_str()),
    }))
}

fn object(value: Value) -> Map<String, Value> {
    match value {
        Value::Object(fields) => fields,
        _ => Map::new(),
    }
}

struct Records {
    camera_m: f32,
    all: Vec<Record>,
}

struct Record {
    key: String,
    fields: Map<String, Value>,
    description: Option<String>,
    pictures: Vec<CueView>,
}

impl Records {
    /// Returns key and modality for a goal, and adds a missing record.
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

    /// Returns the instance's first record without another sentence.
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
    fn picture(&mut self, view: &CueView) -> usize {
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
    object(json!({
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
    }))
}

fn picture(view: &CueView, camera_m: f32) -> Value {
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

/// Quaternion `[x, y, z, w]`.
fn rotation(pose: &Pose) -> Value {
    let (sin, cos) = angle::sin_cos(0.5 * pose.heading_rad);
    json!([0.0, sin, 0.0, cos])
}
