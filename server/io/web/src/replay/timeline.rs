//! Replay timeline: the storeys, found from the floor polygons, the state at each step, and the list of events.

use crate::format::{self, NOTHING};
use avln_store::{EpisodeView, Replay, SceneMap, SubmitMark, TargetView};
use std::{
    collections::BTreeMap,
    f32::consts::{PI, TAU},
};

const LAYER_M: f32 = 0.3;
/// Smallest distance between storeys, metres.
const APART_M: f32 = 1.5;
// Smallest share of the floor area in a storey; stairs and platforms stay below.
const LEAST_SHARE: f32 = 0.08;

/// A map point, metres: +x is right (world +X), +y is down (world +Z).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Spot {
    pub(crate) x: f32,
    pub(crate) y: f32,
}

pub(super) fn spot(point: &[f32; 3]) -> Spot {
    let finite = |value: f32| if value.is_finite() { value } else { 0.0 };
    Spot { x: finite(point[0]), y: finite(point[2]) }
}

/// Storey heights, metres, lowest first; never empty.
#[derive(Debug, PartialEq)]
pub(crate) struct Storeys(Vec<f32>);

impl Storeys {
    /// Selects the layers with most floor area; `fallback_m` is for buildings without floor.
    pub(super) fn of(map: &SceneMap, fallback_m: f32) -> Self {
        let mut layers: BTreeMap<i32, f32> = BTreeMap::new();
        for polygon in map.polygons.iter().filter(|polygon| !polygon.is_empty()) {
            *layers.entry((height(polygon) / LAYER_M).round() as i32).or_default() += area(polygon);
        }
        let all: f32 = layers.values().sum();
        let mut heights = Vec::new();
        while let Some((&layer, &floor)) = layers.iter().max_by(|a, b| a.1.total_cmp(b.1)) {
            if floor < LEAST_SHARE * all && !heights.is_empty() {
                break;
            }
            heights.push(layer as f32 * LAYER_M);
            layers.retain(|other, _| (other - layer).abs() as f32 * LAYER_M >= APART_M);
        }
        heights.sort_by(f32::total_cmp);
        Self(if heights.is_empty() { vec![fallback_m] } else { heights })
    }

    pub(super) fn count(&self) -> usize {
        self.0.len()
    }

    pub(super) fn nearest(&self, height: f32) -> usize {
        let distance = |index: &usize| (self.0[*index] - height).abs();
        (0..self.0.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(0)
    }

    pub(super) fn heights_m(&self) -> impl Iterator<Item = f32> {
        self.0.iter().map(|height| height - self.0[0])
    }
}

pub(super) fn height(polygon: &[[f32; 3]]) -> f32 {
    polygon.iter().map(|point| point[1]).sum::<f32>() / polygon.len().max(1) as f32
}

fn area(polygon: &[[f32; 3]]) -> f32 {
    let next = polygon.iter().cycle().skip(1);
    let twice: f32 = polygon.iter().zip(next).map(|(a, b)| a[0] * b[2] - b[0] * a[2]).sum();
    twice.abs() / 2.0
}

/// Splits a path by storey; consecutive pieces share a point.
pub(super) fn by_storey(points: &[[f32; 3]], storeys: &Storeys) -> Vec<(usize, Vec<Spot>)> {
    let mut pieces: Vec<(usize, Vec<Spot>)> = Vec::new();
    for pair in points.windows(2) {
        let storey = storeys.nearest((pair[0][1] + pair[1][1]) / 2.0);
        let to = spot(&pair[1]);
        match pieces.last_mut() {
            Some((last, spots)) if *last == storey => spots.push(to),
            _ => pieces.push((storey, vec![spot(&pair[0]), to])),
        }
    }
    pieces
}

/// The state before the first action, or after an action.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Moment {
    pub(crate) step: u32,
    pub(crate) at: Spot,
    pub(crate) storey: usize,
    /// Heading, radians: 0 is -Z, positive is left.
    pub(crate) heading_rad: f32,
    pub(crate) action: Option<String>,
    pub(crate) collided: bool,
    /// Sounding source, from 0: a goal, or a distractor from the goal count on.
    pub(crate) sounding: Option<u8>,
    /// Horizontal bearing to the sounding goal, radians: 0 is straight ahead, positive is left.
    pub(crate) bearing_rad: Option<f32>,
    pub(crate) walked_m: f64,
    /// Straight distances from the camera to the targets' bounding boxes.
    pub(crate) distances_m: Vec<f32>,
    pub(crate) actions_left: u32,
    pub(crate) submits_left: u32,
}

/// Returns the Submits of an episode: one fewer than goals, because a Stop claims the last one.
pub(crate) fn submit_limit(replay: &Replay) -> u32 {
    (replay.targets.len() as u32).saturating_sub(1)
}

pub(crate) fn moments(replay: &Replay) -> Vec<Moment> {
    let storeys = Storeys::of(&replay.map, replay.path.first().map_or(0.0, |point| point[1]));
    let mut walked_m = 0.0;
    let mut before: Option<[f32; 3]> = None;
    let mut submits_left = submit_limit(replay);
    let places = replay.path.iter().zip(&replay.headings_rad);
    let moment = |(step, (place, heading)): (u32, (&[f32; 3], &f32))| {
        walked_m += before.map_or(0.0, |before| distance_m(&before, place));
        before = Some(*place);
        let index = step.checked_sub(1).map(|index| index as usize);
        let sounding = index.and_then(|index| *replay.sounding.get(index)?);
        let source = sounding.and_then(|goal| replay.targets.get(usize::from(goal)));
        let action = index.and_then(|index| replay.actions.get(index).cloned());
        submits_left = submits_left.saturating_sub(u32::from(action.as_deref() == Some("Submit")));
        Moment {
            step,
            at: spot(place),
            storey: storeys.nearest(place[1]),
            heading_rad: *heading,
            action,
            collided: step > 0 && replay.collisions.contains(&step),
            sounding,
            bearing_rad: source.and_then(|target| bearing_rad(place, *heading, &target.source)),
            walked_m,
            distances_m: replay.targets.iter().map(|target| to_box_m(replay, place, target)).collect(),
            actions_left: replay.rules.max_steps.saturating_sub(step),
            submits_left,
        }
    };
    (0..).zip(places).map(moment).collect()
}

fn distance_m(from: &[f32; 3], to: &[f32; 3]) -> f64 {
    let squares = from.iter().zip(to).map(|(from, to)| f64::from(to - from).powi(2));
    squares.sum::<f64>().sqrt()
}

/// Returns the distance from the camera above `base` to a target's bounding box.
fn to_box_m(replay: &Replay, base: &[f32; 3], target: &TargetView) -> f32 {
    let eye = [base[0], base[1] + replay.rules.camera_height_m, base[2]];
    let outside = |axis: usize| (target.min[axis] - eye[axis]).max(eye[axis] - target.max[axis]).max(0.0);
    (0..3).map(|axis| outside(axis).powi(2)).sum::<f32>().sqrt()
}

/// Returns the bearing from `base` to `source`; `None` directly above or below.
fn bearing_rad(base: &[f32; 3], heading_rad: f32, source: &[f32; 3]) -> Option<f32> {
    let (right, back) = (source[0] - base[0], source[2] - base[2]);
    let seen = (right != 0.0 || back != 0.0).then(|| (-right).atan2(-back) - heading_rad)?;
    Some((seen + PI).rem_euclid(TAU) - PI)
}

impl Moment {
    /// Returns the heading on the map: whole degrees, clockwise from up.
    pub(crate) fn turn_degrees(&self) -> i32 {
        (-self.heading_rad).to_degrees().round().rem_euclid(360.0) as i32
    }

    pub(crate) fn action_words(&self) -> String {
        let collided = if self.collided { ", collided" } else { "" };
        self.action.as_ref().map_or_else(|| "none yet".to_owned(), |action| action.clone() + collided)
    }

    pub(crate) fn sounding_words(&self) -> String {
        match self.sounding {
            Some(_) => {
                self.sounding_goal().map_or_else(|| "a distractor".to_owned(), |goal| format!("goal {goal}"))
            }
            None => "nothing".to_owned(),
        }
    }

    /// Returns the sounding goal, from 1; `None` for silence and distractors.
    pub(crate) fn sounding_goal(&self) -> Option<u32> {
        let goal = self.sounding.filter(|&goal| usize::from(goal) < self.distances_m.len())?;
        Some(u32::from(goal) + 1)
    }

    pub(crate) fn bearing_words(&self) -> String {
        let Some(bearing) = self.bearing_rad else { return NOTHING.to_owned() };
        match bearing.to_degrees().round() as i32 {
            0 => "straight ahead".to_owned(),
            180 | -180 => "straight behind".to_owned(),
            left if left > 0 => format!("{left}° to the left"),
            right => format!("{}° to the right", -right),
        }
    }

    pub(crate) fn distance_words(&self, goal: &usize) -> String {
        let distance = self.distances_m.get(*goal).filter(|distance| distance.is_finite());
        distance.map_or_else(|| NOTHING.to_owned(), |distance| format!("{distance:.2}"))
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ReplayEvent {
    /// Event step; 0 is before the first action.
    pub(crate) step: u32,
    pub(crate) text: String,
    /// Submit success; `None` for other events.
    pub(crate) is_right: Option<bool>,
}

pub(super) fn events(view: &EpisodeView, replay: &Replay) -> Vec<ReplayEvent> {
    let mut events = vec![event(0, "Start".to_owned())];
    events.extend(sounds(&replay.sounding, replay.targets.len()));
    events.extend(entries(replay));
    events.extend(replay.submits.iter().map(|submit| submit_event(replay, submit)));
    let reason = view.end.map(|end| format!("End: {}", format::end(&end)));
    events.extend(reason.map(|words| event(replay.actions.len() as u32, words)));
    // A stable sort: events in the same step stay in the order above.
    events.sort_by_key(|event| event.step);
    events
}

fn event(step: u32, text: String) -> ReplayEvent {
    ReplayEvent { step, text, is_right: None }
}

fn goal_name(replay: &Replay, goal: u8) -> String {
    let number = u32::from(goal) + 1;
    match replay.targets.get(usize::from(goal)) {
        Some(target) => format!("goal {number} ({})", target.category.replace('_', " ")),
        None => format!("goal {number}"),
    }
}

fn sounds(sounding: &[Option<u8>], goals: usize) -> Vec<ReplayEvent> {
    let mut last = None;
    let mut changes = Vec::new();
    for (step, &now) in (1..).zip(sounding) {
        if now != last {
            let words = match now {
                Some(goal) if usize::from(goal) < goals => format!("Goal {} sounds", u32::from(goal) + 1),
                Some(_) => "A distractor sounds".to_owned(),
                None => "Silence".to_owned(),
            };
            changes.push(event(step, words));
        }
        last = now;
    }
    changes
}

fn entries(replay: &Replay) -> Vec<ReplayEvent> {
    let first = |goal: u8| {
        let is_inside = |bits: &u8| bits.checked_shr(u32::from(goal)).unwrap_or(0) & 1 == 1;
        let inside = replay.in_region.iter().position(is_inside)?;
        Some(event(inside as u32 + 1, format!("Enters the success region of {}", goal_name(replay, goal))))
    };
    (0..replay.targets.len() as u8).filter_map(first).collect()
}

fn submit_event(replay: &Replay, submit: &SubmitMark) -> ReplayEvent {
    let action =
        replay.actions.get((submit.step as usize).saturating_sub(1)).map_or("Submit", String::as_str);
    let text = match (submit.completed, submit.wrong_instance) {
        (Some(goal), _) => format!("{action}, right: {} found", goal_name(replay, goal)),
        (None, Some(goal)) => {
            format!("{action}, wrong: another instance of the category of {}", goal_name(replay, goal))
        }
        (None, None) => format!("{action}, wrong"),
    };
    ReplayEvent { step: submit.step, text, is_right: Some(submit.completed.is_some()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bearing_is_positive_to_the_left() {
        let at = |source: [f32; 3], heading: f32| {
            bearing_rad(&[0.0; 3], heading, &source).map(|rad| rad.to_degrees().round())
        };
        assert_eq!(at([0.0, 1.0, -2.0], 0.0), Some(0.0));
        assert_eq!(at([-2.0, 1.0, 0.0], 0.0), Some(90.0));
        assert_eq!(at([2.0, 1.0, 0.0], 0.0), Some(-90.0));
        assert_eq!(at([0.0, 1.0, -2.0], PI / 2.0), Some(-90.0));
        assert_eq!(at([0.0, 1.0, 2.0], PI), Some(0.0));
        assert_eq!(at([0.0, 1.0, 0.0], 0.0), None);
    }

    #[test]
    fn changes_of_the_sound_are_listed_once() {
        let changes = sounds(&[Some(1), Some(1), Some(0), None, None], 2);
        let changes: Vec<_> = changes.iter().map(|event| (event.step, event.text.as_str())).collect();
        assert_eq!(changes, [(1, "Goal 2 sounds"), (3, "Goal 1 sounds"), (4, "Silence")]);
        assert_eq!(sounds(&[], 2), []);
        assert_eq!(sounds(&[Some(2)], 2), [event(1, "A distractor sounds".to_owned())]);
    }

    fn floor(height: f32, side: f32) -> Vec<[f32; 3]> {
        vec![[0.0, height, 0.0], [side, height, 0.0], [side, height, side], [0.0, height, side]]
    }

    fn map(polygons: Vec<Vec<[f32; 3]>>) -> SceneMap {
        SceneMap { polygons, ..SceneMap::default() }
    }

    #[test]
    fn storeys_have_most_of_the_floor() {
        let mut polygons = vec![floor(0.0, 10.0), floor(3.12, 8.0)];
        polygons.extend((1..15).map(|step| floor(step as f32 * 0.2, 0.5)));
        let storeys = Storeys::of(&map(polygons), 7.0);
        assert_eq!(storeys.count(), 2);
        assert_eq!([storeys.nearest(0.4), storeys.nearest(1.4), storeys.nearest(2.0)], [0, 0, 1]);
        let heights: Vec<f32> = storeys.heights_m().collect();
        assert!(heights[0] == 0.0 && (heights[1] - 3.1).abs() < 0.2, "{heights:?}");
    }

    #[test]
    fn a_building_without_floor_has_one_storey() {
        let storeys = Storeys::of(&map(vec![vec![]]), 7.0);
        assert_eq!((storeys.count(), storeys.nearest(-3.0)), (1, 0));
        assert_eq!(storeys.heights_m().collect::<Vec<_>>(), [0.0]);
    }

    #[test]
    fn paths_are_split_between_storeys() {
        let storeys = Storeys(vec![0.0, 3.0]);
        let points = [[0.0, 0.0, 0.0], [1.0, 0.5, 0.0], [2.0, 2.9, 0.0], [3.0, 3.0, 0.0]];
        let pieces = by_storey(&points, &storeys);
        let lengths: Vec<(usize, usize)> =
            pieces.iter().map(|(storey, spots)| (*storey, spots.len())).collect();
        assert_eq!(lengths, [(0, 2), (1, 3)]);
        assert_eq!(pieces[0].1[1], pieces[1].1[0]);
    }
}
