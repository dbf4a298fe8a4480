//! Round trips and reports: files in the published layouts, imported into a procedural house, and exported.

use avln_dataset::{CueSpec, Description, EpisodeSpec, Instance, survey};
use avln_episode::Rules;
use avln_houses::HouseOptions;
use avln_interchange::{
    ForeignCue, ForeignFile, Format, Importer, Loss, MAX_GOALS, SceneMissions, Tables, authors_index,
    authors_scene, read,
};
use avln_world::{Body, SceneAssets};
use serde_json::{Value, json};
use std::sync::LazyLock;

struct House {
    assets: SceneAssets,
    instances: Vec<Instance>,
    rules: Rules,
}

static HOUSE: LazyLock<House> = LazyLock::new(|| {
    let options = HouseOptions { rooms: 6..=6, storeys: 1..=1, ..HouseOptions::default() };
    let assets = SceneAssets::prepare(avln_houses::house("house", 3, &options), &Body::default()).unwrap();
    let rules = Rules::paper();
    let instances = survey(&assets, &rules);
    House { assets, instances, rules }
});

const SCENE: &str = "mp3d/house/house.glb";

fn parse(value: &Value, format: Option<Format>) -> Result<(Option<Format>, ForeignFile), String> {
    read("val.json", value.to_string().as_bytes(), format).map_err(|error| error.to_string())
}

/// `count` instances with distinct, unique categories.
fn singles(count: usize) -> Vec<&'static Instance> {
    let singles: Vec<_> =
        HOUSE.instances.iter().filter(|instance| instance.distractors == 0).take(count).collect();
    assert_eq!(singles.len(), count, "{count} categories with a single instance");
    singles
}

fn start() -> [f32; 3] {
    let place = HOUSE.instances[0].target.region[0];
    [place.x, place.y, place.z]
}

fn import(foreign: &ForeignFile) -> (Vec<EpisodeSpec>, Vec<Loss>) {
    let mut importer = Importer::new(&HOUSE.assets, &HOUSE.rules, 1);
    let (mut episodes, mut losses) = (Vec::new(), foreign.losses.clone());
    for episode in &foreign.episodes {
        let imported = importer.import(episode);
        episodes.extend(imported.episode);
        losses.extend(imported.losses);
    }
    (episodes, losses)
}

fn episode(fields: Value) -> Value {
    let mut episode = json!({
        "episode_id": "7", "scene_id": SCENE, "start_position": start(), "start_rotation": [0.0, 0.0, 0.0, 1.0],
    });
    episode.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
    episode
}

fn point(point: &avln_episode::Point3<f32>) -> Value {
    json!([point.x, point.y, point.z])
}

/// A record in the authors' format.
fn record(instance: &Instance) -> Value {
    let target = &instance.target;
    let eye = [1.0, 1.25, 2.0];
    json!({
        "semantic_id": 4711, "category": target.category,
        "bbox_min": point(&target.bounds.min), "bbox_max": point(&target.bounds.max),
        "view_points": [{"agent_state": {"position": start(), "rotation": [0.0, 0.0, 0.0, 1.0]}, "semantic_pixels": 9}],
        "render_view_points": [
            {"agent_state": {"position": [1.0, 0.0, 2.0], "rotation": [0.0, 0.0, 0.0, 1.0]}, "position": eye},
            {"agent_state": {"position": [3.0, 0.0, 2.0], "rotation": [0.0, 1.0, 0.0, 0.0]}},
        ],
        "description": format!("A {} of the house.", target.category),
    })
}

fn authors(goals: Value, instances: Value) -> Value {
    json!({
        "dataset": "valid_instance_trajectory_dataset", "version": "0.1", "scene_name": "house",
        "episodes": [episode(json!({"goals": goals, "ordered_total_geodesic_distance": null, "offset": "13"}))],
        "instances": instances,
    })
}

#[test]
fn authors_episodes_keep_start_cues_and_order() {
    let chosen = singles(3);
    let instances = json!({"a_1": record(chosen[0]), "b_2": record(chosen[1]), "c_3": record(chosen[2])});
    let goals =
        json!([["a_1", "Image_1"], {"instance_key": "b_2", "modality": "description"}, ["c_3", "object"]]);
    let (format, foreign) = parse(&authors(goals, instances), None).unwrap();
    assert_eq!(format, Some(Format::Authors));
    assert_eq!(foreign.notes["pictures taken from render_view_points"], 1);
    let (episodes, losses) = import(&foreign);
    assert_eq!((episodes.len(), losses), (1, vec![]));
    let episode = &episodes[0];
    assert_eq!((episode.id.as_str(), episode.scene.as_str()), ("house-7", "house"));
    assert!((episode.start.position - avln_episode::Point3::from(start())).norm() < 0.05);
    for (goal, instance) in episode.goals.iter().zip(&chosen) {
        assert_eq!(goal.target.instance, instance.target.instance);
        assert_eq!(goal.target.region, instance.target.region);
        assert_eq!(goal.target.viewpoints.len(), 1, "the file's own viewpoint");
    }
    assert!(episode.ordered.length_m >= episode.unordered.length_m - 1e-6);
    let CueSpec::Image(view) = &episode.goals[0].cue else { panic!("{:?}", episode.goals[0].cue) };
    // Base 0 and a camera at 1.25 m: our 1 m camera needs a base at 0.25 m. A half turn faces +Z.
    assert!((view.pose.position.y - 0.25).abs() < 1e-5 && view.pose.position.x == 3.0, "{view:?}");
    assert!((view.pose.heading_rad.abs() - std::f32::consts::PI).abs() < 1e-3, "{view:?}");
}

#[test]
fn older_list_of_views_is_preferred() {
    let mut record = record(singles(1)[0]);
    record["image"] = json!({"render_views": [{
        "position": [5.0, 1.5, 5.0], "rotation": [0.0, 0.0, 0.0, 1.0], "hfov": 79.0, "agent_base_position": [5.0, 0.25, 5.0],
    }]});
    // Nested by category, as in exported instances.
    let file = authors(json!([["a_1", "image"]]), json!({"a": {"a_1": record}}));
    let (_, foreign) = parse(&file, None).unwrap();
    assert_eq!(foreign.notes["pictures taken from image.render_views"], 1);
    let ForeignCue::Image(shot) = foreign.episodes[0].goals[0].cue else { panic!() };
    assert!((shot.eye.y - 1.5).abs() < 1e-6 && (shot.hfov_rad.to_degrees() - 79.0).abs() < 1e-3);
}

#[test]
fn goals_that_cannot_be_imported_are_reported() {
    let mut elsewhere = record(singles(1)[0]);
    (elsewhere["bbox_min"], elsewhere["bbox_max"]) = (json!([90, 0, 90]), json!([91, 1, 91]));
    let mut mute = record(singles(2)[1]);
    mute.as_object_mut().unwrap().remove("description");
    let goals =
        json!([["gone_9", "object"], ["far_1", "object"], ["mute_2", "description"], ["mute_2", "object"]]);
    let (_, foreign) = parse(&authors(goals, json!({"far_1": elsewhere, "mute_2": mute})), None).unwrap();
    let (episodes, losses) = import(&foreign);
    assert_eq!(episodes[0].goals.len(), 1);
    let message: Vec<String> = losses.iter().map(Loss::to_string).collect();
    assert_eq!(message.len(), 3, "{message:?}");
    assert!(message[0].starts_with("house/7, goal gone_9: the file has no record"), "{message:?}");
    assert!(message[1].contains("mute_2") && message[1].contains("description"), "{message:?}");
    assert!(message[2].contains("far_1") && message[2].contains("in this box"), "{message:?}");
}

#[test]
fn index_without_episodes_is_accepted() {
    let index = json!({"dataset": "omni_long_nav", "split": "val", "episodes": [],
        "content_scenes_path": "{data_path}/content/{scene}.json.gz"});
    assert_eq!(parse(&index, None).unwrap(), (Some(Format::Authors), ForeignFile::default()));
}

#[test]
fn object_goal_targets_the_nearest_instance() {
    let wanted = singles(1)[0];
    let (target, category) = (&wanted.target, wanted.target.category.as_str());
    let goal = |id: u32, place: Value| {
        json!({"position": place, "object_id": id, "object_name": format!("{category}_{id}"),
            "object_category": category, "view_points": [{"agent_state": {"position": start(), "rotation": [0, 0, 0, 1]}, "iou": 0.1}]})
    };
    let here = goal(target.instance, point(&target.bounds.center()));
    let mut by_category = serde_json::Map::new();
    by_category.insert(format!("house.glb_{category}"), json!([goal(999, json!([80.0, 0.0, 80.0])), here]));
    let file = json!({"goals_by_category": by_category, "category_to_task_category_id": {},
        "episodes": [episode(json!({"object_category": category, "goals": [], "info": {"geodesic_distance": 3.0}}))]});
    let (format, foreign) = parse(&file, None).unwrap();
    assert_eq!((format, foreign.episodes[0].goals[0].instances.len()), (Some(Format::ObjectNav), 2));
    let (episodes, losses) = import(&foreign);
    assert_eq!((episodes[0].goals[0].target.instance, losses), (target.instance, vec![]));
}

#[test]
fn pitched_image_goals_are_reported() {
    let target = &singles(1)[0].target;
    let image = |rotation: Value| json!({"position": [1.0, 1.31, 1.0], "rotation": rotation, "hfov": 42, "image_dimensions": [512, 512]});
    let goal = json!({"position": point(&target.bounds.center()), "object_id": target.instance,
        "object_category": target.category, "view_points": [],
        "image_goals": [image(json!([0, 0, 0, 1])), image(json!([-0.5, 0, 0, 0.8660254]))]});
    let mut goals = serde_json::Map::new();
    goals.insert(format!("house_{}", target.instance), goal);
    let with = |image: i64| {
        let fields =
            json!({"goal_object_id": target.instance.to_string(), "goal_image_id": image, "goals": []});
        parse(&json!({"goals": goals, "episodes": [episode(fields)]}), None).unwrap()
    };
    assert_eq!(with(0).0, Some(Format::InstanceImageNav));
    assert_eq!(import(&with(0).1).0.len(), 1);
    let (episodes, losses) = import(&with(1).1);
    assert!(episodes.is_empty() && losses[0].reason.contains("a pitch of -60 degrees"), "{losses:?}");
    assert!(with(9).1.losses[0].reason.contains("no picture 9"));
}

#[test]
fn sequences_end_at_the_goal_limit() {
    let chosen = singles(MAX_GOALS);
    let mut goals = serde_json::Map::new();
    let mut tasks = Vec::new();
    for instance in &chosen {
        let (target, category) = (&instance.target, &instance.target.category);
        let goal = json!({"position": point(&target.bounds.center()), "object_id": format!("{category}_{}", target.instance),
            "object_category": category, "view_points": [], "lang_desc": "the one by the door", "image_goals": []});
        goals.insert(format!("house.glb_{category}"), json!([goal]));
        tasks.push(json!([category, "description", format!("{category}_{}", target.instance), null]));
    }
    // The first goal as a category, and a goal beyond the limit.
    tasks.insert(1, json!([chosen[0].target.category, "object", null]));
    tasks.push(json!([chosen[0].target.category, "object", null]));
    let (format, foreign) =
        parse(&json!({"goals": goals, "episodes": [episode(json!({"tasks": tasks}))]}), None).unwrap();
    assert_eq!((format, foreign.episodes[0].goals.len()), (Some(Format::Goat), MAX_GOALS + 2));
    let (episodes, losses) = import(&foreign);
    assert_eq!(episodes[0].goals.len(), MAX_GOALS);
    assert!(losses[0].reason.contains("already") && losses[1].reason.contains("at most 4"), "{losses:?}");
    assert_eq!(losses.len(), 2);
}

#[test]
fn objects_added_by_a_task_are_reported() {
    let goal = json!({"object_category": "cylinder_red", "object_id": 3, "position": [1.0, 0.5, 1.0]});
    let (format, foreign) = parse(&json!({"episodes": [episode(json!({"goals": [goal]}))]}), None).unwrap();
    assert_eq!(format, Some(Format::MultiOn));
    let (episodes, losses) = import(&foreign);
    assert!(episodes.is_empty());
    assert!(
        losses[0].reason.contains("no cylinder_red at this position") && losses[1].goal.is_empty(),
        "{losses:?}"
    );
}

#[test]
fn malformed_files_are_rejected_with_their_place() {
    let message = |value: Value| parse(&value, Some(Format::Authors)).unwrap_err();
    let twice = episode(json!({"goals": []}));
    assert!(message(json!({"episodes": [twice, twice]})).contains("episodes[1]: episode_id 7 occurs twice"));
    let turned = episode(json!({"goals": [], "start_rotation": [0, 0, 0, 3]}));
    assert!(message(json!({"episodes": [turned]})).contains("episodes[0].start_rotation: quaternion"));
    let short = episode(json!({"goals": [["a_1"]]}));
    assert!(message(json!({"episodes": [short]})).contains("episodes[0].goals[0]: expected an instance key"));
    assert!(message(json!({"episodes": 4})).contains("episodes: expected a list, found the number 4"));
    assert!(message(json!({"goals": []})).contains("`episodes` is missing"));
    let unknown = parse(&json!({"episodes": [{"episode_id": 1}], "version": 2}), None).unwrap_err();
    assert!(unknown.contains("episodes, version") && unknown.contains("multion"), "{unknown}");
}

#[test]
fn damaged_files_never_panic() {
    let chosen = singles(1);
    let good =
        authors(json!([["a_1", "image_0"]]), json!({"a_1": record(chosen[0])})).to_string().into_bytes();
    let (mut rng, mut importer) = (avln_geom::Rng::new(5), Importer::new(&HOUSE.assets, &HOUSE.rules, 1));
    for _ in 0..300 {
        let mut bytes = good.clone();
        for _ in 0..3 {
            let at = rng.below(bytes.len());
            bytes[at] = b"0[]{}\",:x-9"[rng.below(11)];
        }
        bytes.truncate(bytes.len() - rng.below(2) * rng.below(bytes.len()));
        if let Ok((_, foreign)) = read("val.json", &bytes, Some(Format::Authors)) {
            foreign.episodes.iter().for_each(|episode| drop(importer.import(episode)));
        }
    }
}

#[test]
fn export_and_import_round_trip() {
    let chosen = singles(3);
    let instances = json!({"a_1": record(chosen[0]), "b_2": record(chosen[1]), "c_3": record(chosen[2])});
    let goals = json!([["a_1", "image_0"], ["b_2", "description"], ["c_3", "object"]]);
    let (first, _) = import(&parse(&authors(goals, instances), None).unwrap().1);
    // An instance with a second sentence needs a second record.
    let mut second = first[0].clone();
    second.id = "house-8".to_owned();
    second.goals[1].cue =
        CueSpec::Description(Description { text: "Another sentence.".to_owned(), claims: None });
    let ours = vec![first[0].clone(), second];
    let whole = SceneMissions::Whole(ours.clone());
    let files =
        [authors_index("val"), authors_scene("val", "house", &whole, &HOUSE.rules)].map(Result::unwrap);
    let paths: Vec<&str> = files.iter().map(|file| file.path.as_str()).collect();
    assert_eq!(paths, ["val/val.json.gz", "val/content/house.json.gz"]);
    assert_eq!(
        read("index", &files[0].bytes, None).unwrap(),
        (Some(Format::Authors), ForeignFile::default())
    );
    let (format, foreign) = read("house", &files[1].bytes, None).unwrap();
    assert_eq!((format, foreign.losses.len()), (Some(Format::Authors), 0));
    let (back, losses) = import(&foreign);
    assert_eq!(losses, vec![]);
    for (back, ours) in back.iter().zip(&ours) {
        assert_eq!((&back.id, back.goals.len()), (&ours.id, ours.goals.len()));
        assert!((back.start.position - ours.start.position).norm() < 1e-3);
        assert!((back.ordered.length_m - ours.ordered.length_m).abs() < 1e-3);
        for (back, ours) in back.goals.iter().zip(&ours.goals) {
            assert_eq!(back.target.instance, ours.target.instance);
            match (&back.cue, &ours.cue) {
                (CueSpec::Image(back), CueSpec::Image(ours)) => {
                    assert!((back.pose.position - ours.pose.position).norm() < 1e-4);
                    assert!((back.hfov_rad - ours.hfov_rad).abs() < 1e-4);
                }
                (back, ours) => assert_eq!(back, ours),
            }
        }
    }
    assert_eq!(back.len(), 2);
}

#[test]
fn public_export_has_no_ground_truth() {
    let chosen = singles(3);
    let instances = json!({"a_1": record(chosen[0]), "b_2": record(chosen[1]), "c_3": record(chosen[2])});
    let goals = json!([["a_1", "image_0"], ["b_2", "description"], ["c_3", "object"]]);
    let (ours, _) = import(&parse(&authors(goals, instances), None).unwrap().1);
    let public = SceneMissions::Public(ours.iter().map(EpisodeSpec::public).collect());
    let file = authors_scene("val", "house", &public, &HOUSE.rules).unwrap();
    let (_, foreign) = read("house", &file.bytes, None).unwrap();
    let [episode] = &foreign.episodes[..] else { panic!("one mission") };
    assert_eq!(episode.stated_m, [None, None]);
    assert!((episode.start.position - ours[0].start.position).norm() < 1e-6);
    // The picture is rendered at play time: the file states that it exists, not its camera.
    assert!(foreign.losses.len() == 1 && foreign.losses[0].reason.contains("image_0"), "{foreign:?}");
    let cues: Vec<&ForeignCue> = episode.goals.iter().map(|goal| &goal.cue).collect();
    let CueSpec::Description(sentence) = &ours[0].goals[1].cue else { panic!("a sentence") };
    assert_eq!(cues, [&ForeignCue::Description(sentence.text.clone()), &ForeignCue::Category]);
    let instance = &episode.goals[0].instances[0];
    assert_eq!(
        (instance.id, instance.center, instance.bounds, instance.viewpoints.len()),
        (Some(0), None, None, 0)
    );
    assert_ne!(instance.category, ours[0].goals[1].target.category);
    let mut tables = Tables::new("val");
    tables.add("house", &public).unwrap();
    let paths: Vec<String> = tables.finish().unwrap().into_iter().map(|file| file.path).collect();
    assert_eq!(paths, ["val/goals.parquet", "val/missions.parquet"]);
}
