//! A replay from above, as shapes. One unit is a metre: right is +X, down is +Z, so up is where heading 0 looks.

use avln_store::{MissionView, Replay, SceneMap, TargetView};
use std::fmt::Write;

/// Pieces that the walk is coloured in.
const PIECES: usize = 60;
/// Colours of the walk from its start over its middle to its end. Each has a contrast of 3 on white and on near-black.
const COLOURS: [[f32; 3]; 3] = [[0.0, 114.0, 178.0], [204.0, 121.0, 167.0], [213.0, 94.0, 0.0]];
/// A floor this far above or below the walk is another storey, metres.
const STOREY_M: f32 = 1.2;
/// Free space around the building, metres.
const MARGIN_M: f32 = 0.6;

/// Everything that the picture shows, in metres.
#[derive(Debug)]
pub(crate) struct MapView {
    /// `min-x min-y width height`.
    pub(crate) view_box: String,
    /// Height of letters.
    pub(crate) letter_m: f32,
    /// Half the height of a mark.
    pub(crate) mark_m: f32,
    /// Floors that were walked on.
    pub(crate) floor: String,
    /// Other storeys.
    pub(crate) faint_floor: String,
    /// The reference tour.
    pub(crate) reference: String,
    /// The walk in order of time.
    pub(crate) pieces: Vec<Piece>,
    pub(crate) collisions: Vec<Spot>,
    pub(crate) start: Spot,
    /// The direction of the first look, degrees clockwise from up.
    pub(crate) start_degrees: f32,
    pub(crate) end: Spot,
    pub(crate) submits: Vec<SubmitSpot>,
    pub(crate) targets: Vec<TargetBox>,
    pub(crate) scale: Scale,
}

/// A stretch of the walk.
#[derive(Debug, PartialEq)]
pub(crate) struct Piece {
    pub(crate) path: String,
    pub(crate) colour: String,
}

/// A point, right and down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Spot {
    pub(crate) x: f32,
    pub(crate) y: f32,
}

/// A claim.
#[derive(Debug)]
pub(crate) struct SubmitSpot {
    pub(crate) at: Spot,
    pub(crate) right: bool,
    pub(crate) words: String,
}

/// A target's box with its label.
#[derive(Debug)]
pub(crate) struct TargetBox {
    pub(crate) corner: Spot,
    pub(crate) width: f32,
    pub(crate) height: f32,
    pub(crate) label: String,
    pub(crate) label_at: Spot,
    /// Whether the label ends at its point instead of beginning there.
    pub(crate) leftwards: bool,
    pub(crate) found: bool,
}

/// The bar that tells how long a metre is.
#[derive(Debug, PartialEq)]
pub(crate) struct Scale {
    pub(crate) from: Spot,
    pub(crate) length_m: f32,
}

impl MapView {
    /// Draws `replay`; the mission tells which goals were found.
    pub(crate) fn new(replay: &Replay, mission: Option<&MissionView>) -> Self {
        let frame = Frame::around(replay);
        let walk: Vec<Spot> = replay.path.iter().map(spot).collect();
        let start = walk.first().copied().unwrap_or(frame.min);
        let storeys = Storeys::of(&replay.path);
        let heading = replay.headings_rad.first().copied().unwrap_or_default();
        Self {
            view_box: frame.view_box(),
            letter_m: frame.letter_m(),
            mark_m: frame.letter_m() * 0.75,
            floor: floors(&replay.map, |y| storeys.include(y)),
            faint_floor: floors(&replay.map, |y| !storeys.include(y)),
            reference: line(&replay.reference_path.iter().map(spot).collect::<Vec<_>>()),
            pieces: pieces(&walk),
            collisions: replay
                .collisions
                .iter()
                .filter_map(|&step| walk.get(step as usize).copied())
                .collect(),
            start,
            start_degrees: -heading.to_degrees(),
            end: walk.last().copied().unwrap_or(start),
            submits: submits(replay, &walk),
            targets: targets(replay, mission, &frame),
            scale: frame.scale(),
        }
    }
}

/// The part of the plane that is shown.
struct Frame {
    min: Spot,
    max: Spot,
}

impl Frame {
    fn around(replay: &Replay) -> Self {
        let corners = [replay.map.min, replay.map.max];
        let boxes = replay.targets.iter().flat_map(|target| [target.min, target.max]);
        let points = corners.into_iter().chain(boxes).chain(replay.path.iter().copied());
        let mut frame = Self { min: spot(&replay.map.min), max: spot(&replay.map.max) };
        for point in points.map(|point| spot(&point)) {
            frame.min = Spot { x: frame.min.x.min(point.x), y: frame.min.y.min(point.y) };
            frame.max = Spot { x: frame.max.x.max(point.x), y: frame.max.y.max(point.y) };
        }
        frame
    }

    fn width(&self) -> f32 {
        self.max.x - self.min.x
    }

    fn height(&self) -> f32 {
        self.max.y - self.min.y
    }

    fn letter_m(&self) -> f32 {
        (self.width().max(self.height()) * 0.024).max(0.15)
    }

    /// The building with a margin, and room below for the scale.
    fn view_box(&self) -> String {
        let (x, y) = (self.min.x - MARGIN_M, self.min.y - MARGIN_M);
        let below = 3.5 * self.letter_m();
        format!(
            "{x:.2} {y:.2} {:.2} {:.2}",
            self.width() + 2.0 * MARGIN_M,
            self.height() + 2.0 * MARGIN_M + below
        )
    }

    /// The longest round length that takes a quarter of the width at most.
    fn scale(&self) -> Scale {
        let fits = |length: &f32| *length <= self.width() / 4.0;
        let length_m = [50.0, 20.0, 10.0, 5.0, 2.0, 1.0].into_iter().find(fits).unwrap_or(0.5);
        Scale { from: Spot { x: self.min.x, y: self.max.y + MARGIN_M + self.letter_m() * 1.2 }, length_m }
    }
}

/// Heights that the walk came by.
struct Storeys(f32, f32);

impl Storeys {
    fn of(path: &[[f32; 3]]) -> Self {
        let heights = || path.iter().map(|point| point[1]);
        Self(heights().fold(f32::INFINITY, f32::min), heights().fold(f32::NEG_INFINITY, f32::max))
    }

    fn include(&self, height: f32) -> bool {
        height >= self.0 - STOREY_M && height <= self.1 + STOREY_M
    }
}

fn spot(point: &[f32; 3]) -> Spot {
    let finite = |value: f32| if value.is_finite() { value } else { 0.0 };
    Spot { x: finite(point[0]), y: finite(point[2]) }
}

/// The path data of a line through `spots`.
fn line(spots: &[Spot]) -> String {
    let mut path = String::new();
    for (index, spot) in spots.iter().enumerate() {
        let command = if index == 0 { 'M' } else { 'L' };
        let _ = write!(path, "{command}{:.2} {:.2}", spot.x, spot.y);
    }
    path
}

/// The path data of the polygons whose mean height is wanted.
fn floors(map: &SceneMap, wanted: impl Fn(f32) -> bool) -> String {
    let mut path = String::new();
    for polygon in map.polygons.iter().filter(|polygon| !polygon.is_empty()) {
        let height = polygon.iter().map(|point| point[1]).sum::<f32>() / polygon.len() as f32;
        if wanted(height) {
            path += &line(&polygon.iter().map(spot).collect::<Vec<_>>());
            path.push('Z');
        }
    }
    path
}

/// The walk in pieces of about equal time, each with its colour; they share their ends.
fn pieces(walk: &[Spot]) -> Vec<Piece> {
    let moves = walk.len().saturating_sub(1);
    let count = moves.min(PIECES);
    let cut = |index: usize| index * moves / count;
    (0..count)
        .map(|index| Piece {
            path: line(&walk[cut(index)..=cut(index + 1)]),
            colour: colour(index as f32 / (count - 1).max(1) as f32),
        })
        .collect()
}

/// The colour at `time` between 0 and 1.
pub(crate) fn colour(time: f32) -> String {
    let (from, to, share) = if time < 0.5 {
        (COLOURS[0], COLOURS[1], time * 2.0)
    } else {
        (COLOURS[1], COLOURS[2], time * 2.0 - 1.0)
    };
    let mix = |index: usize| (from[index] + (to[index] - from[index]) * share).round() as u8;
    format!("#{:02x}{:02x}{:02x}", mix(0), mix(1), mix(2))
}

fn submits(replay: &Replay, walk: &[Spot]) -> Vec<SubmitSpot> {
    let mark = |submit: &avln_store::SubmitMark| {
        let at = *walk.get(submit.step as usize)?;
        let words = match submit.completed {
            Some(goal) => format!("Step {}: claim of goal {}, right", submit.step, u32::from(goal) + 1),
            None => format!("Step {}: claim, wrong", submit.step),
        };
        Some(SubmitSpot { at, right: submit.completed.is_some(), words })
    };
    replay.submits.iter().filter_map(mark).collect()
}

fn targets(replay: &Replay, mission: Option<&MissionView>, frame: &Frame) -> Vec<TargetBox> {
    let found = |index: usize| mission.and_then(|m| m.goals.get(index)?.found_at_step).is_some();
    let boxed = |(index, target): (usize, &TargetView)| {
        let (corner, opposite) = (spot(&target.min), spot(&target.max));
        let leftwards = opposite.x > frame.min.x + 0.7 * frame.width();
        let label_x = if leftwards { opposite.x } else { corner.x };
        TargetBox {
            corner,
            width: (opposite.x - corner.x).max(0.05),
            height: (opposite.y - corner.y).max(0.05),
            label: format!("{} {}", index + 1, target.category.replace('_', " ")),
            label_at: Spot { x: label_x, y: corner.y - 0.3 * frame.letter_m() },
            leftwards,
            found: found(index),
        }
    };
    replay.targets.iter().enumerate().map(boxed).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spots(xs: &[f32]) -> Vec<Spot> {
        xs.iter().map(|&x| Spot { x, y: 0.0 }).collect()
    }

    #[test]
    fn pieces_cover_the_walk_without_gaps() {
        assert_eq!(pieces(&spots(&[])), vec![]);
        assert_eq!(pieces(&spots(&[1.0])), vec![]);
        let three = pieces(&spots(&[0.0, 1.0, 2.0]));
        assert_eq!(three[0], Piece { path: "M0.00 0.00L1.00 0.00".to_owned(), colour: "#0072b2".to_owned() });
        assert_eq!(three[1], Piece { path: "M1.00 0.00L2.00 0.00".to_owned(), colour: "#d55e00".to_owned() });
        let long: Vec<f32> = (0..=1000).map(|x| x as f32).collect();
        let long = pieces(&spots(&long));
        assert_eq!(long.len(), PIECES);
        assert!(long[PIECES - 1].path.ends_with("L1000.00 0.00"));
        assert_eq!(long.iter().map(|piece| piece.path.matches('L').count()).sum::<usize>(), 1000);
    }

    #[test]
    fn storeys_that_were_not_walked_are_faint() {
        let map = SceneMap {
            polygons: vec![vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], vec![[5.0, 3.0, 0.0], [6.0, 3.0, 0.0]]],
            ..SceneMap::default()
        };
        let storeys = Storeys::of(&[[0.0, 0.1, 0.0]]);
        assert_eq!(floors(&map, |y| storeys.include(y)), "M0.00 0.00L1.00 0.00Z");
        assert_eq!(floors(&map, |y| !storeys.include(y)), "M5.00 0.00L6.00 0.00Z");
    }

    #[test]
    fn the_scale_is_round_and_fits() {
        let frame = Frame { min: Spot { x: 0.0, y: 0.0 }, max: Spot { x: 12.0, y: 30.0 } };
        assert_eq!(frame.scale().length_m, 2.0);
        let small = Frame { min: Spot { x: 0.0, y: 0.0 }, max: Spot { x: 1.0, y: 1.0 } };
        assert_eq!(small.scale().length_m, 0.5);
    }
}
