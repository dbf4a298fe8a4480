//! Episodes in the layout of Habitat: ObjectNav and InstanceImageNav of HM3D, GOAT-Bench, MultiON.

use super::{
    Foreign, ForeignCue, ForeignEpisode, ForeignGoal, ForeignInstance, FormatsError, Loss, Shot,
    foreign::scene_name,
    json::Cursor,
    shared::{episodes, start, viewpoint},
};
use std::collections::BTreeMap;

/// Field of view of goal pictures where the file states none, degrees.
const HFOV_DEG: f64 = 42.0;

/// The goals of a file by their keys: lists of instances, or one instance.
type Goals<'a> = BTreeMap<&'a str, Cursor<'a>>;

fn goals<'a>(root: &Cursor<'a>, key: &str) -> Result<Goals<'a>, FormatsError> {
    match root.find(key) {
        Some(goals) => Ok(goals.entries()?.into_iter().collect()),
        None => Ok(Goals::new()),
    }
}

/// Reads every episode of a file; `goals_of` adds the goals of one.
fn read(
    root: &Cursor,
    mut goals_of: impl FnMut(&Cursor, &mut ForeignEpisode, &mut Foreign) -> Result<(), FormatsError>,
) -> Result<Foreign, FormatsError> {
    let mut foreign = Foreign::default();
    for cursor in episodes(root)? {
        let scene_path = cursor.get("scene_id")?.text()?.to_owned();
        let mut episode = ForeignEpisode {
            id: cursor.get("episode_id")?.id()?,
            scene: scene_name(&scene_path),
            scene_path,
            start: start(&cursor)?,
            goals: Vec::new(),
            stated_m: [None; 2],
        };
        goals_of(&cursor, &mut episode, &mut foreign)?;
        foreign.episodes.push(episode);
    }
    Ok(foreign)
}

/// The file name of a scene, with which keys of goals begin.
fn scene_file(path: &str) -> &str {
    path.rsplit(['/', '\\']).next().unwrap_or(path)
}

/// ObjectNav: any instance of the category will do.
pub(super) fn object_nav(root: &Cursor) -> Result<Foreign, FormatsError> {
    let by_category = goals(root, "goals_by_category")?;
    read(root, |cursor, episode, foreign| {
        let category = cursor.get("object_category")?.text()?;
        let key = format!("{}_{category}", scene_file(&episode.scene_path));
        let Some(list) = by_category.get(key.as_str()) else {
            foreign.losses.push(Loss::goal(episode, category, format!("the file has no goals {key}")));
            return Ok(());
        };
        let instances = list.list()?.iter().map(instance).collect::<Result<Vec<_>, _>>()?;
        if instances.len() > 1 {
            foreign.note("category goals with several instances: the nearest is the target");
        }
        episode.goals.push(ForeignGoal { name: category.to_owned(), instances, cue: ForeignCue::Category });
        Ok(())
    })
}

/// InstanceImageNav: one picture of one instance.
pub(super) fn image_nav(root: &Cursor) -> Result<Foreign, FormatsError> {
    let all = goals(root, "goals")?;
    read(root, |cursor, episode, foreign| {
        let id = cursor.get("goal_object_id")?.id()?;
        let index = cursor.find("goal_image_id").map(|index| index.whole()).transpose()?.unwrap_or(0);
        let suffix = format!("_{id}");
        let names = [scene_file(&episode.scene_path), &episode.scene];
        let stem = scene_file(&episode.scene_path).split('.').next().unwrap_or_default();
        let keyed = |name: &str| all.get(format!("{name}{suffix}").as_str());
        let goal = names.into_iter().chain([stem]).find_map(keyed);
        let Some(goal) = goal else {
            foreign.losses.push(Loss::goal(episode, &id, "the file has no goal of this object"));
            return Ok(());
        };
        push_image(episode, foreign, goal, &id, index)
    })
}

fn push_image(
    episode: &mut ForeignEpisode,
    foreign: &mut Foreign,
    goal: &Cursor,
    name: &str,
    index: i64,
) -> Result<(), FormatsError> {
    let images = goal.find("image_goals").map(|images| images.list()).transpose()?.unwrap_or_default();
    let image = usize::try_from(index).ok().and_then(|index| images.get(index));
    match image {
        Some(image) => {
            let (instances, cue) = (vec![instance(goal)?], ForeignCue::Image(shot(image)?));
            episode.goals.push(ForeignGoal { name: name.to_owned(), instances, cue });
        }
        None => foreign.losses.push(Loss::goal(episode, name, format!("it has no picture {index}"))),
    }
    Ok(())
}

/// GOAT-Bench: a sequence of tasks `[category, modality, object id, picture]`.
pub(super) fn goat(root: &Cursor) -> Result<Foreign, FormatsError> {
    let all = goals(root, "goals")?;
    read(root, |cursor, episode, foreign| {
        for task in cursor.get("tasks")?.list()? {
            let parts = task.list()?;
            let [category, modality, rest @ ..] = &parts[..] else {
                return Err(
                    task.error(format!("expected category and modality, found {} entries", parts.len()))
                );
            };
            let (category, modality) = (category.text()?, modality.text()?.to_lowercase());
            let id = rest.first().and_then(|id| id.id().ok());
            let index = rest.get(1).and_then(|index| index.whole().ok()).unwrap_or(0);
            let key = format!("{}_{category}", scene_file(&episode.scene_path));
            let list = all.get(key.as_str()).map(|list| list.list()).transpose()?.unwrap_or_default();
            goat_task(episode, foreign, (category, &modality, id, index), &list)?;
        }
        Ok(())
    })
}

fn goat_task(
    episode: &mut ForeignEpisode,
    foreign: &mut Foreign,
    (category, modality, id, index): (&str, &str, Option<String>, i64),
    list: &[Cursor],
) -> Result<(), FormatsError> {
    let wanted = |goal: &&Cursor| {
        let own = goal.find("object_id").and_then(|own| own.id().ok());
        id.is_none() || own.as_deref().map(number_of) == id.as_deref().map(number_of)
    };
    let chosen: Vec<&Cursor> = list.iter().filter(wanted).collect();
    let name = id.clone().unwrap_or_else(|| category.to_owned());
    let Some(first) = chosen.first() else {
        foreign.losses.push(Loss::goal(episode, &name, "the file has no goal of this object"));
        return Ok(());
    };
    let cue = match modality {
        "image" => return push_image(episode, foreign, first, &name, index),
        "description" => {
            let sentence =
                first.find("lang_desc").and_then(|text| text.text().ok()).filter(|text| !text.is_empty());
            let Some(sentence) = sentence else {
                foreign.losses.push(Loss::goal(episode, &name, "it has no description"));
                return Ok(());
            };
            ForeignCue::Description(sentence.to_owned())
        }
        _ => ForeignCue::Category,
    };
    let instances = chosen.into_iter().map(instance).collect::<Result<Vec<_>, _>>()?;
    if instances.len() > 1 {
        foreign.note("category goals with several instances: the nearest is the target");
    }
    episode.goals.push(ForeignGoal { name, instances, cue });
    Ok(())
}

/// The number in an id: `chair_41` and `41` are the same object.
fn number_of(id: &str) -> &str {
    id.rsplit('_').next().unwrap_or(id)
}

/// MultiON: a list of goals with a place and a category; most are objects that the task adds to the scene.
pub(super) fn multi_on(root: &Cursor) -> Result<Foreign, FormatsError> {
    read(root, |cursor, episode, _| {
        for goal in cursor.get("goals")?.list()? {
            let instance = instance(&goal)?;
            let name = instance.category.clone();
            episode.goals.push(ForeignGoal { name, instances: vec![instance], cue: ForeignCue::Category });
        }
        Ok(())
    })
}

fn instance(goal: &Cursor) -> Result<ForeignInstance, FormatsError> {
    let id = goal.find("object_id").and_then(|id| id.id().ok());
    let category = goal.find("object_category").or_else(|| goal.find("object_name"));
    let center = match goal.find("position") {
        // GOAT-Bench leaves it empty where it does not know.
        Some(position) if position.is_list() && position.list()?.is_empty() => None,
        Some(position) => Some(position.point()?),
        None => None,
    };
    let mut viewpoints = Vec::new();
    for view in goal.find("view_points").map(|list| list.list()).transpose()?.unwrap_or_default() {
        viewpoints.push(viewpoint(&view)?);
    }
    Ok(ForeignInstance {
        id: id.and_then(|id| number_of(&id).parse().ok()),
        category: category.ok_or_else(|| goal.error("`object_category` is missing"))?.text()?.to_owned(),
        center,
        bounds: None,
        viewpoints,
    })
}

fn shot(image: &Cursor) -> Result<Shot, FormatsError> {
    let rotation = image.get("rotation")?.rotation()?;
    let hfov_deg = image.find("hfov").map(|hfov| hfov.number()).transpose()?.unwrap_or(HFOV_DEG);
    if !(1.0..=179.0).contains(&hfov_deg) {
        return Err(image.error(format!("hfov {hfov_deg}, expected 1 to 179 degrees")));
    }
    Ok(Shot {
        eye: image.get("position")?.point()?,
        heading_rad: rotation.heading_rad,
        pitch_rad: rotation.pitch_rad,
        hfov_rad: hfov_deg.to_radians() as f32,
    })
}
