//! Readers for Habitat layouts: ObjectNav and InstanceImageNav for HM3D, GOAT-Bench, MultiON.

use crate::{
    ForeignCue, ForeignEpisode, ForeignFile, ForeignGoal, ForeignInstance, ForeignView, InterchangeError,
    Loss, json::Cursor,
};
use std::collections::BTreeMap;

/// Default field of view, degrees.
const HFOV_DEG: f64 = 42.0;

/// Goals by key: instance lists, or single instances.
type Goals<'a> = BTreeMap<&'a str, Cursor<'a>>;

fn goals<'a>(root: &Cursor<'a>, key: &str) -> Result<Goals<'a>, InterchangeError> {
    match root.find(key) {
        Some(goals) => Ok(goals.entries()?.into_iter().collect()),
        None => Ok(Goals::new()),
    }
}

/// Reads all episodes; `goals_of` adds goals to an episode.
fn read(
    root: &Cursor,
    mut goals_of: impl FnMut(&Cursor, &mut ForeignEpisode, &mut ForeignFile) -> Result<(), InterchangeError>,
) -> Result<ForeignFile, InterchangeError> {
    let mut foreign = ForeignFile::default();
    for cursor in root.episodes()? {
        let mut episode = cursor.episode()?;
        goals_of(&cursor, &mut episode, &mut foreign)?;
        foreign.episodes.push(episode);
    }
    Ok(foreign)
}

fn scene_file(path: &str) -> &str {
    path.rsplit(['/', '\\']).next().unwrap_or(path)
}

/// Reads ObjectNav: any instance in a category is a goal.
pub(crate) fn object_nav(root: &Cursor) -> Result<ForeignFile, InterchangeError> {
    let by_category = goals(root, "goals_by_category")?;
    read(root, |cursor, episode, foreign| {
        let category = cursor.get("object_category")?.text()?;
        let key = format!("{}_{category}", scene_file(&episode.scene_path));
        let Some(list) = by_category.get(key.as_str()) else {
            foreign.losses.push(Loss::goal(episode, category, format!("the file has no goals {key}")));
            return Ok(());
        };
        let goals = list.list()?;
        push_goal(episode, foreign, category.to_owned(), ForeignCue::Category, goals.iter())
    })
}

/// Reads InstanceImageNav: an instance picture per episode.
pub(crate) fn image_nav(root: &Cursor) -> Result<ForeignFile, InterchangeError> {
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
            foreign.losses.push(Loss::goal(episode, &id, "the file has no goal for this object"));
            return Ok(());
        };
        push_image(episode, foreign, goal, &id, index)
    })
}

/// Adds a goal that any of the instances completes.
fn push_goal<'a, 'b: 'a>(
    episode: &mut ForeignEpisode,
    foreign: &mut ForeignFile,
    name: String,
    cue: ForeignCue,
    goals: impl Iterator<Item = &'a Cursor<'b>>,
) -> Result<(), InterchangeError> {
    let instances = goals.map(instance).collect::<Result<Vec<_>, _>>()?;
    if instances.len() > 1 {
        foreign.note("category goals with several instances: the nearest is the target");
    }
    episode.goals.push(ForeignGoal { name, instances, cue });
    Ok(())
}

fn push_image(
    episode: &mut ForeignEpisode,
    foreign: &mut ForeignFile,
    goal: &Cursor,
    name: &str,
    index: i64,
) -> Result<(), InterchangeError> {
    let images = goal.find("image_goals").map(|images| images.list()).transpose()?.unwrap_or_default();
    let Some(image) = usize::try_from(index).ok().and_then(|index| images.get(index)) else {
        foreign.losses.push(Loss::goal(episode, name, format!("no picture {index}")));
        return Ok(());
    };
    let cue = ForeignCue::Image(view(image)?);
    episode.goals.push(ForeignGoal { name: name.to_owned(), instances: vec![instance(goal)?], cue });
    Ok(())
}

/// Reads GOAT-Bench: task lists `[category, modality, object id, picture]`.
pub(crate) fn goat(root: &Cursor) -> Result<ForeignFile, InterchangeError> {
    let all = goals(root, "goals")?;
    read(root, |cursor, episode, foreign| {
        for task in cursor.get("tasks")?.list()? {
            let parts = task.list()?;
            let [category, modality, rest @ ..] = &parts[..] else {
                return Err(
                    task.error(format!("expected category and modality, found {} entries", parts.len()))
                );
            };
            let task = GoatTask {
                category: category.text()?,
                modality: modality.text()?.to_lowercase(),
                object: rest.first().and_then(|id| id.id().ok()),
                picture: rest.get(1).and_then(|index| index.whole().ok()).unwrap_or(0),
            };
            let key = format!("{}_{}", scene_file(&episode.scene_path), task.category);
            let list = all.get(key.as_str()).map(|list| list.list()).transpose()?.unwrap_or_default();
            goat_task(episode, foreign, task, &list)?;
        }
        Ok(())
    })
}

struct GoatTask<'a> {
    category: &'a str,
    modality: String,
    object: Option<String>,
    picture: i64,
}

fn goat_task(
    episode: &mut ForeignEpisode,
    foreign: &mut ForeignFile,
    task: GoatTask,
    list: &[Cursor],
) -> Result<(), InterchangeError> {
    let is_wanted = |goal: &&Cursor| {
        let Some(wanted) = &task.object else { return true };
        let own = goal.find("object_id").and_then(|own| own.id().ok());
        own.as_deref().map(number_of) == Some(number_of(wanted))
    };
    let chosen: Vec<&Cursor> = list.iter().filter(is_wanted).collect();
    let name = task.object.clone().unwrap_or_else(|| task.category.to_owned());
    let Some(first) = chosen.first() else {
        foreign.losses.push(Loss::goal(episode, &name, "the file has no goal for this object"));
        return Ok(());
    };
    let cue = match task.modality.as_str() {
        "image" => return push_image(episode, foreign, first, &name, task.picture),
        "description" => {
            let sentence =
                first.find("lang_desc").and_then(|text| text.text().ok()).filter(|text| !text.is_empty());
            let Some(sentence) = sentence else {
                foreign.losses.push(Loss::goal(episode, &name, "the goal has no description"));
                return Ok(());
            };
            ForeignCue::Description(sentence.to_owned())
        }
        _ => ForeignCue::Category,
    };
    push_goal(episode, foreign, name, cue, chosen.into_iter())
}

/// Number in an id: `chair_41` and `41` are the same object.
fn number_of(id: &str) -> &str {
    id.rsplit('_').next().unwrap_or(id)
}

/// Reads MultiON: goals with a position and a category. Most are objects added to the scene by the task.
pub(crate) fn multi_on(root: &Cursor) -> Result<ForeignFile, InterchangeError> {
    read(root, |cursor, episode, _| {
        for goal in cursor.get("goals")?.list()? {
            let instance = instance(&goal)?;
            let name = instance.category.clone();
            episode.goals.push(ForeignGoal { name, instances: vec![instance], cue: ForeignCue::Category });
        }
        Ok(())
    })
}

fn instance(goal: &Cursor) -> Result<ForeignInstance, InterchangeError> {
    let id = goal.find("object_id").and_then(|id| id.id().ok());
    let category = goal.find("object_category").or_else(|| goal.find("object_name"));
    let center = match goal.find("position") {
        // GOAT-Bench has empty lists for unknown positions.
        Some(position) if position.is_list() && position.list()?.is_empty() => None,
        Some(position) => Some(position.point()?),
        None => None,
    };
    Ok(ForeignInstance {
        id: id.and_then(|id| number_of(&id).parse().ok()),
        category: category.ok_or_else(|| goal.error("`object_category` is missing"))?.text()?.to_owned(),
        center,
        bounds: None,
        viewpoints: goal.viewpoints()?,
    })
}

fn view(image: &Cursor) -> Result<ForeignView, InterchangeError> {
    let rotation = image.get("rotation")?.rotation()?;
    Ok(ForeignView {
        eye: image.get("position")?.point()?,
        heading_rad: rotation.heading_rad,
        pitch_rad: rotation.pitch_rad,
        hfov_rad: image.hfov_rad(HFOV_DEG)?,
    })
}
