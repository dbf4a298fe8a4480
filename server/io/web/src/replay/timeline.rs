//! Replay timeline: the state at each step, and the list of events.

use super::storeys::{Spot, Storeys, spot};
use crate::format::{self, NOTHING};
use avln_store::{EpisodeView, Replay, SubmitMark, TargetView};
use std::f32::consts::{PI, TAU};

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

pub(crate) fn moments(replay: &Replay) -> Vec<Moment> {
    let storeys = Storeys::of(&replay.map, replay.path.first().map_or(0.0, |point| point[1]));
    let mut walked_m = 0.0;
    let mut before: Option<[f32; 3]> = None;
    let places = replay.path.iter().zip(&replay.headings_rad);
    let moment = |(step, (place, heading)): (u32, (&[f32; 3], &f32))| {
        walked_m += before.map_or(0.0, |before| distance_m(&before, place));
        before = Some(*place);
        let index = step.checked_sub(1).map(|index| index as usize);
        let sounding = index.and_then(|index| *replay.sounding.get(index)?);
        let source = sounding.and_then(|goal| replay.targets.get(usize::from(goal)));
        let submits = replay.submits.iter().filter(|submit| submit.step <= step).count() as u32;
        Moment {
            step,
            at: spot(place),
            storey: storeys.nearest(place[1]),
            heading_rad: *heading,
            action: index.and_then(|index| replay.actions.get(index).cloned()),
            collided: step > 0 && replay.collisions.contains(&step),
            sounding,
            bearing_rad: source.and_then(|target| bearing_rad(place, *heading, &target.source)),
            walked_m,
            distances_m: replay.targets.iter().map(|target| to_box_m(replay, place, target)).collect(),
            actions_left: replay.rules.max_steps.saturating_sub(step),
            submits_left: (replay.targets.len() as u32).saturating_sub(submits),
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
}
