//! A walk through a house, and the goals that are looked for in what it has shown.

use super::{
    frames::{Record, Sentence},
    truth::{self, Instance},
};
use avln_client::{GoalCue, Image, Mission, Observation, Pose, RgbImage, TaskSpec};
use avln_kit::{
    map::{Cell, Objects, Occupancy},
    perception::{Recognition, View},
};
use std::collections::BTreeMap;

/// Categories before this number are the building itself.
const BUILDING: usize = 3;
/// Cameras stand as agents do where they differ by less than this from that, metres and radians.
const USUAL: f32 = 1e-3;
/// A reference picture shows its instance on this share of its middle, at least, and of the whole.
const IN_THE_MIDDLE: f32 = 0.2;
const OF_THE_WHOLE: f32 = 0.005;

/// How a goal is described.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Modality {
    Category,
    Sentence,
    Picture,
}

/// One goal, and the instances that it fits.
pub(crate) struct Goal {
    pub(crate) modality: Modality,
    pub(crate) right: Vec<u16>,
    cue: GoalCue,
}

/// The pictures of one storey.
pub(crate) struct Walk<'a> {
    task: TaskSpec,
    shown: Vec<&'a Record>,
    pub(crate) instances: Vec<Instance>,
    pub(crate) goals: Vec<Goal>,
}

impl<'a> Walk<'a> {
    /// Every second usual picture of the storey with the most of them; the others are reference pictures.
    pub(crate) fn through(
        records: &'a [Record],
        sentences: &[Sentence],
        categories: &[String],
        side_px: usize,
    ) -> Option<Self> {
        let task = TaskSpec { width: side_px as u32, height: side_px as u32, ..TaskSpec::default() };
        let mut storeys = BTreeMap::<i32, Vec<&Record>>::new();
        for record in records.iter().filter(|record| is_usual(record, &task)) {
            storeys.entry((record.base_m[1] / 2.0).round() as i32).or_default().push(record);
        }
        let all = storeys.into_values().max_by_key(Vec::len)?;
        let (shown, others): (Vec<_>, Vec<_>) =
            all.iter().copied().enumerate().partition(|(i, _)| i % 2 == 0);
        let strip = |pairs: Vec<(usize, &'a Record)>| pairs.into_iter().map(|(_, record)| record).collect();
        let (shown, others): (Vec<_>, Vec<_>) = (strip(shown), strip(others));
        let instances = truth::instances(&View::new(&task), &shown, BUILDING);
        let mut walk = Self { task, shown, instances, goals: Vec::new() };
        walk.goals = walk.goals(&others, sentences, categories);
        Some(walk)
    }

    fn goals(&self, others: &[&Record], sentences: &[Sentence], categories: &[String]) -> Vec<Goal> {
        let is_there = |id: u16| self.instances.iter().any(|instance| instance.id == id);
        let mut goals = Vec::new();
        let mut kinds: Vec<&str> = sentences.iter().map(|sentence| sentence.category.as_str()).collect();
        kinds.sort_unstable();
        kinds.dedup();
        for kind in kinds {
            let is_kind = |instance: &&Instance| categories[usize::from(instance.category)] == kind;
            let right: Vec<u16> = self.instances.iter().filter(is_kind).map(|instance| instance.id).collect();
            if !right.is_empty() {
                let cue = GoalCue::Category(kind.to_owned());
                goals.push(Goal { modality: Modality::Category, right, cue });
            }
        }
        let said = sentences.iter().filter(|sentence| is_there(sentence.instance));
        goals.extend(said.map(|sentence| Goal {
            modality: Modality::Sentence,
            right: vec![sentence.instance],
            cue: GoalCue::Description(sentence.text.clone()),
        }));
        let pictured = others.iter().filter_map(|record| Some((in_the_middle(record)?, record)));
        let wanted = |id: u16| is_there(id) && sentences.iter().any(|sentence| sentence.instance == id);
        goals.extend(pictured.filter(|(id, _)| wanted(*id)).map(|(id, record)| Goal {
            modality: Modality::Picture,
            right: vec![id],
            cue: GoalCue::Image(image(record)),
        }));
        goals
    }

    /// What is remembered of the things on the way, by `perception`.
    pub(crate) fn objects(&self, perception: &mut dyn Recognition) -> Objects {
        let goals: Vec<GoalCue> = self.goals.iter().map(|goal| goal.cue.clone()).collect();
        perception.begin(&self.task, &Mission { goals, ..Mission::default() });
        let (view, mut map, mut objects) =
            (View::new(&self.task), Occupancy::default(), Objects::new(self.goals.len()));
        for record in &self.shown {
            let stand = truth::stand(record);
            let seen = observation(record, self.task.width as usize);
            if let Some(depth) = &seen.depth {
                map.see(&view, &stand, depth);
            }
            let things = perception.see(&stand, &seen, &|place| map.is_wall(Cell::at(place)));
            objects.see(things.unwrap_or_default());
            for object in objects.iter_mut() {
                if map.is_in_view(&stand, object.thing.center(), NEAR_M) {
                    let fits: Vec<f32> =
                        (0..self.goals.len()).map(|goal| perception.fit(&object.thing, goal)).collect();
                    object.look(&fits);
                }
            }
        }
        objects
    }
}

/// Things are compared with goals within this distance: pictures are few, and taken for no goal.
const NEAR_M: f32 = 4.0;

fn is_usual(record: &Record, task: &TaskSpec) -> bool {
    let camera = &record.camera;
    let off = [camera.height_m - task.camera_height_m, camera.pitch_rad, camera.hfov_rad - task.hfov_rad];
    off.iter().all(|off| off.abs() < USUAL)
}

/// The instance that fills the middle of a picture.
fn in_the_middle(record: &Record) -> Option<u16> {
    let side = record.instances.len().isqrt();
    let middle = 7 * side / 16..9 * side / 16;
    let (mut counts, mut all) = (BTreeMap::<u16, usize>::new(), BTreeMap::<u16, usize>::new());
    for (pixel, &id) in record.instances.iter().enumerate() {
        *all.entry(id).or_default() += 1;
        if middle.contains(&(pixel / side)) && middle.contains(&(pixel % side)) {
            *counts.entry(id).or_default() += 1;
        }
    }
    let (&id, &count) = counts.iter().max_by_key(|(_, count)| **count)?;
    let share = |count: usize, of: usize| count as f32 / of as f32;
    let fills = share(count, middle.len() * middle.len()) >= IN_THE_MIDDLE;
    (id > 0 && fills && share(all[&id], side * side) >= OF_THE_WHOLE).then_some(id)
}

fn image(record: &Record) -> RgbImage {
    let side = record.instances.len().isqrt() as u32;
    Image { width: side, height: side, pixels: record.rgb.clone() }
}

fn observation(record: &Record, side_px: usize) -> Observation {
    Observation {
        pose: Pose { position: record.base_m, heading_rad: record.heading_rad },
        rgb: Some(image(record)),
        depth: Some(truth::depth(record, side_px)),
        ..Observation::default()
    }
}
