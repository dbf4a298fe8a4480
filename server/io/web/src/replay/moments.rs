use super::{
    map::{Spot, spot},
    storeys::Storeys,
};
use crate::words::NOTHING;
use avln_store::{Replay, TargetView};
use std::f32::consts::{PI, TAU};

/// Where everything stood before the first action, or after one.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Moment {
    /// The step that had just ended; 0 before the first action.
    pub(crate) step: u32,
    pub(crate) at: Spot,
    pub(crate) storey: usize,
    /// 0 looks along -Z, positive is to the left, radians.
    pub(crate) heading_rad: f32,
    /// The action that led here.
    pub(crate) action: Option<String>,
    /// Whether an obstacle held the body back.
    pub(crate) collided: bool,
    /// The goal that sounded, from 0.
    pub(crate) sounding: Option<u8>,
    /// From straight ahead to what sounded, in the plane, radians; positive is to the left.
    pub(crate) bearing_rad: Option<f32>,
    /// Length of the walk until now.
    pub(crate) walked_m: f64,
    /// For each goal: the straight line from the camera to the box of its target.
    pub(crate) distances_m: Vec<f32>,
    pub(crate) actions_left: u32,
    pub(crate) submits_left: u32,
}

/// All moments of a replay in order of time.
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

/// From the camera of a body at `base` to the nearest point of a target's box.
fn to_box_m(replay: &Replay, base: &[f32; 3], target: &TargetView) -> f32 {
    let eye = [base[0], base[1] + replay.rules.camera_height_m, base[2]];
    let outside = |axis: usize| (target.min[axis] - eye[axis]).max(eye[axis] - target.max[axis]).max(0.0);
    (0..3).map(|axis| outside(axis).powi(2)).sum::<f32>().sqrt()
}

/// Where `source` is for a body at `base`; `None` right above or below it.
fn bearing_rad(base: &[f32; 3], heading_rad: f32, source: &[f32; 3]) -> Option<f32> {
    let (right, back) = (source[0] - base[0], source[2] - base[2]);
    let seen = (right != 0.0 || back != 0.0).then(|| (-right).atan2(-back) - heading_rad)?;
    Some((seen + PI).rem_euclid(TAU) - PI)
}

impl Moment {
    /// The heading as a picture from above is turned: whole degrees, clockwise from up.
    pub(crate) fn turn_degrees(&self) -> i32 {
        (-self.heading_rad).to_degrees().round().rem_euclid(360.0) as i32
    }

    pub(crate) fn action_words(&self) -> String {
        let held_back = if self.collided { ", held back" } else { "" };
        self.action
            .as_ref()
            .map_or_else(|| "before the first".to_owned(), |action| action.clone() + held_back)
    }

    pub(crate) fn sounding_words(&self) -> String {
        match self.sounding {
            Some(goal) => format!("goal {}", u32::from(goal) + 1),
            None => "nothing".to_owned(),
        }
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

    /// How far it is to the target of a goal, metres.
    pub(crate) fn distance_words(&self, goal: &usize) -> String {
        let distance = self.distances_m.get(*goal).filter(|distance| distance.is_finite());
        distance.map_or_else(|| NOTHING.to_owned(), |distance| format!("{distance:.2}"))
    }
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
}
