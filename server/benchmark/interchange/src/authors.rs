//! Reader for the LH-AVLN authors' layout: an index, and a file per scene with episodes and instances.

use crate::{
    ForeignCue, ForeignFile, ForeignGoal, ForeignInstance, ForeignView, InterchangeError, Loss, json::Cursor,
};
use avln_geom::{Aabb, Point3, Vector3};
use std::collections::BTreeMap;

/// Default field of view, the task camera's, degrees.
const HFOV_DEG: f64 = 90.0;
/// Camera height above a stated base, metres.
const CAMERA_HEIGHT_M: f32 = 1.25;

type Instances<'a> = BTreeMap<&'a str, Cursor<'a>>;

/// Reads a scene file, or a self-contained split file.
pub(crate) fn read(root: &Cursor) -> Result<ForeignFile, InterchangeError> {
    let mut foreign = ForeignFile::default();
    let instances = instances(root)?;
    for cursor in root.episodes()? {
        episode(&cursor, &instances, &mut foreign)?;
    }
    foreign.episodes.sort_by_key(|episode| (episode.scene.clone(), episode.id.parse::<i64>().ok()));
    Ok(foreign)
}

/// Instance records by key. An entry without `semantic_id` is a category with nested records.
fn instances<'a>(root: &Cursor<'a>) -> Result<Instances<'a>, InterchangeError> {
    let mut found = Instances::new();
    let Some(all) = root.find("instances") else { return Ok(found) };
    for (key, record) in all.entries()? {
        if record.find("semantic_id").is_some() {
            found.insert(key, record);
        } else {
            found.extend(record.entries()?);
        }
    }
    Ok(found)
}

fn episode(
    cursor: &Cursor,
    instances: &Instances,
    foreign: &mut ForeignFile,
) -> Result<(), InterchangeError> {
    cursor.get("episode_id")?.whole()?;
    let total = |key| cursor.find(key).map(|length| length.number()).transpose();
    let mut episode = cursor.episode()?;
    episode.stated_m =
        [total("ordered_total_geodesic_distance")?, total("unordered_total_geodesic_distance")?];
    let goals = match cursor.find("tasks") {
        Some(tasks) => tasks,
        None => cursor.get("goals")?,
    };
    for goal in goals.list()? {
        let (key, modality) = pair(&goal)?;
        match self::goal(key, &modality, instances, foreign)? {
            Ok(goal) => episode.goals.push(goal),
            Err(reason) => foreign.losses.push(Loss::goal(&episode, key, reason)),
        }
    }
    foreign.episodes.push(episode);
    Ok(())
}

/// Key and modality from a pair or an object.
fn pair<'a>(goal: &Cursor<'a>) -> Result<(&'a str, String), InterchangeError> {
    if goal.is_object() {
        let key = goal.find("instance_key").or_else(|| goal.find("goal"));
        let key = key.ok_or_else(|| goal.error("`instance_key` and `goal` are missing"))?.text()?;
        return Ok((key, goal.get("modality")?.text()?.to_lowercase()));
    }
    match &goal.list()?[..] {
        [key, modality] => Ok((key.text()?, modality.text()?.to_lowercase())),
        other => {
            Err(goal.error(format!("expected an instance key and a modality, found {} entries", other.len())))
        }
    }
}

fn goal(
    key: &str,
    modality: &str,
    instances: &Instances,
    foreign: &mut ForeignFile,
) -> Result<Result<ForeignGoal, String>, InterchangeError> {
    let Some(record) = instances.get(key) else {
        return Ok(Err("the file has no record of this instance".to_owned()));
    };
    let Some(cue) = cue(modality, record, foreign)? else {
        return Ok(Err(format!("the record of this instance has no cue of the modality {modality:?}")));
    };
    Ok(Ok(ForeignGoal { name: key.to_owned(), instances: vec![instance(key, record)?], cue }))
}

fn instance(key: &str, record: &Cursor) -> Result<ForeignInstance, InterchangeError> {
    let numbered = key.rsplit('_').next().and_then(|number| number.parse().ok());
    let id = match record.find("semantic_id") {
        Some(id) => u32::try_from(id.whole()?).ok(),
        None => numbered,
    };
    let center = record.find("center").map(|center| center.point()).transpose()?;
    let size = record.find("bbox_size").map(|size| size.point()).transpose()?;
    let around = |(center, size): (Point3<f32>, Point3<f32>)| {
        let half = Vector3::new(size.x, size.y, size.z) * 0.5;
        Aabb::new(center - half, center + half)
    };
    let bounds = record.bounds("bbox_min", "bbox_max")?.or(center.zip(size).map(around));
    let viewpoints = record.viewpoints()?;
    let category = match record.find("category") {
        Some(category) => category.text()?.to_owned(),
        None => key.rsplit_once('_').map_or(key, |(category, _)| category).to_owned(),
    };
    Ok(ForeignInstance { id, category, center, bounds, viewpoints })
}

fn cue(
    modality: &str,
    record: &Cursor,
    foreign: &mut ForeignFile,
) -> Result<Option<ForeignCue>, InterchangeError> {
    match modality {
        "object" | "category" => Ok(Some(ForeignCue::Category)),
        "description" | "text" | "text_description" => {
            let sentence = record.find("description").map(|text| text.text()).transpose()?;
            Ok(sentence.map(|sentence| ForeignCue::Description(sentence.to_owned())))
        }
        _ => match modality.strip_prefix("image") {
            Some(rest) => {
                let index = rest.trim_start_matches('_').parse().unwrap_or(0);
                Ok(picture(record, index, foreign)?.map(ForeignCue::Image))
            }
            None => Ok(None),
        },
    }
}

/// Picture number `index`, preferably from the older list.
fn picture(
    record: &Cursor,
    index: usize,
    foreign: &mut ForeignFile,
) -> Result<Option<ForeignView>, InterchangeError> {
    let older = record.find("image").and_then(|image| image.find("render_views"));
    let lists = [("image.render_views", older), ("render_view_points", record.find("render_view_points"))];
    for (name, list) in lists {
        let views = list.map(|list| list.list()).transpose()?.unwrap_or_default();
        if let Some(view) = views.get(index) {
            foreign.note(&format!("pictures taken from {name}"));
            return self::view(view).map(Some);
        }
    }
    Ok(None)
}

/// Picture camera in either layout: `position` is the camera, `agent_state` or `agent_base_position` the base.
fn view(view: &Cursor) -> Result<ForeignView, InterchangeError> {
    let state = view.find("agent_state");
    let rotation = match view.find("rotation").or_else(|| state.as_ref()?.find("rotation")) {
        Some(rotation) => rotation.rotation()?,
        None => return Err(view.error("`rotation` is missing")),
    };
    let base = view.find("agent_base_position").or_else(|| state.as_ref()?.find("position"));
    let eye = match (view.find("position"), base) {
        (Some(eye), _) => eye.point()?,
        (None, Some(base)) => base.point()? + Vector3::y() * CAMERA_HEIGHT_M,
        (None, None) => return Err(view.error("`position` is missing")),
    };
    Ok(ForeignView {
        eye,
        heading_rad: rotation.heading_rad,
        pitch_rad: rotation.pitch_rad,
        hfov_rad: view.hfov_rad(HFOV_DEG)?,
    })
}
