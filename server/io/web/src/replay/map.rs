//! Replay map. One unit is a metre; right is +X and down is +Z, so heading 0 points up.

use super::timeline::{Moment, Spot, Storeys, by_storey, height, spot};
use avln_store::{MissionView, Replay, SceneMap, TargetView};
use std::fmt::Write;

const PIECES: usize = 60;
// Path colours at start, middle and end, with a contrast of at least 3 on white and on near-black.
const COLOURS: [[f32; 3]; 3] = [[0.0, 114.0, 178.0], [204.0, 121.0, 167.0], [213.0, 94.0, 0.0]];
const MARGIN_M: f32 = 0.6;

#[derive(Debug)]
pub(crate) struct MapView {
    /// `min-x min-y width height`.
    pub(crate) view_box: String,
    pub(crate) letter_m: f32,
    pub(crate) mark_m: f32,
    /// Heights above the lowest storey, the lowest first.
    pub(crate) storeys_m: Vec<f64>,
    pub(crate) storey: usize,
    /// Path data by storey.
    pub(crate) floors: Vec<String>,
    pub(crate) reference: Vec<(usize, String)>,
    pub(crate) pieces: Vec<Piece>,
    pub(crate) collisions: Vec<Spot>,
    pub(crate) start: Spot,
    /// Heading at the start, degrees clockwise from up.
    pub(crate) start_degrees: f32,
    pub(crate) end: Spot,
    pub(crate) body: Spot,
    pub(crate) body_degrees: i32,
    pub(crate) submits: Vec<SubmitSpot>,
    pub(crate) targets: Vec<TargetBox>,
    pub(crate) scale: Scale,
}

#[derive(Debug, PartialEq)]
pub(crate) struct Piece {
    pub(crate) path: String,
    pub(crate) colour: String,
    pub(crate) from_step: usize,
    pub(crate) storey: usize,
    pub(crate) is_later: bool,
}

#[derive(Debug)]
pub(crate) struct SubmitSpot {
    pub(crate) at: Spot,
    pub(crate) storey: usize,
    pub(crate) step: u32,
    pub(crate) is_later: bool,
    pub(crate) right: bool,
    pub(crate) text: String,
}

#[derive(Debug)]
pub(crate) struct TargetBox {
    pub(crate) corner: Spot,
    pub(crate) width: f32,
    pub(crate) height: f32,
    pub(crate) label: String,
    pub(crate) label_at: Spot,
    /// True if the label ends at `label_at`, and does not start there.
    pub(crate) leftwards: bool,
    pub(crate) found: bool,
    pub(crate) storey: usize,
    pub(crate) source: Spot,
    pub(crate) sounds: bool,
}

#[derive(Debug, PartialEq)]
pub(crate) struct Scale {
    pub(crate) from: Spot,
    pub(crate) length_m: f32,
}

impl MapView {
    /// `storey` defaults to the agent's storey; `mission` marks found goals.
    pub(super) fn new(
        replay: &Replay,
        mission: Option<&MissionView>,
        moment: &Moment,
        storey: Option<usize>,
    ) -> Self {
        let bounds = MapBounds::around(replay);
        let walk: Vec<Spot> = replay.path.iter().map(spot).collect();
        let start = walk.first().copied().unwrap_or(bounds.min);
        let storeys = Storeys::of(&replay.map, replay.path.first().map_or(0.0, |point| point[1]));
        let heading = replay.headings_rad.first().copied().unwrap_or_default();
        let position = |step: &u32| walk.get(*step as usize).copied();
        let tour = by_storey(&replay.reference_path, &storeys);
        let now = MapMoment { replay, storeys: &storeys, moment };
        Self {
            view_box: bounds.view_box(),
            letter_m: bounds.letter_m(),
            mark_m: bounds.letter_m() * 0.75,
            storeys_m: storeys.heights_m().map(f64::from).collect(),
            storey: storey.filter(|storey| *storey < storeys.count()).unwrap_or(moment.storey),
            floors: floors(&replay.map, &storeys),
            reference: tour.into_iter().map(|(storey, spots)| (storey, line(&spots))).collect(),
            pieces: now.pieces(&walk),
            collisions: replay.collisions.iter().filter_map(position).collect(),
            start,
            start_degrees: -heading.to_degrees(),
            end: walk.last().copied().unwrap_or(start),
            body: moment.at,
            body_degrees: moment.turn_degrees(),
            submits: now.submits(&walk),
            targets: now.targets(mission, &bounds),
            scale: bounds.scale(),
        }
    }

    pub(crate) fn is_away(&self, storey: &usize) -> bool {
        *storey != self.storey
    }
}

struct MapBounds {
    min: Spot,
    max: Spot,
}

impl MapBounds {
    fn around(replay: &Replay) -> Self {
        let corners = [replay.map.min, replay.map.max];
        let boxes = replay.targets.iter().flat_map(|target| [target.min, target.max]);
        let points = corners.into_iter().chain(boxes).chain(replay.path.iter().copied());
        let mut bounds = Self { min: spot(&replay.map.min), max: spot(&replay.map.max) };
        for point in points.map(|point| spot(&point)) {
            bounds.min = Spot { x: bounds.min.x.min(point.x), y: bounds.min.y.min(point.y) };
            bounds.max = Spot { x: bounds.max.x.max(point.x), y: bounds.max.y.max(point.y) };
        }
        bounds
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

    /// Returns the SVG view box: the building with a margin, and space for the scale bar.
    fn view_box(&self) -> String {
        let (x, y) = (self.min.x - MARGIN_M, self.min.y - MARGIN_M);
        let below = 3.5 * self.letter_m();
        format!(
            "{x:.2} {y:.2} {:.2} {:.2}",
            self.width() + 2.0 * MARGIN_M,
            self.height() + 2.0 * MARGIN_M + below
        )
    }

    /// Returns the scale bar: the longest round length up to a quarter of the width.
    fn scale(&self) -> Scale {
        let fits = |length: &f32| *length <= self.width() / 4.0;
        let length_m = [50.0, 20.0, 10.0, 5.0, 2.0, 1.0].into_iter().find(fits).unwrap_or(0.5);
        Scale { from: Spot { x: self.min.x, y: self.max.y + MARGIN_M + self.letter_m() * 1.2 }, length_m }
    }
}

fn line(spots: &[Spot]) -> String {
    let mut path = String::new();
    for (index, spot) in spots.iter().enumerate() {
        let command = if index == 0 { 'M' } else { 'L' };
        let _ = write!(path, "{command}{:.2} {:.2}", spot.x, spot.y);
    }
    path
}

fn floors(map: &SceneMap, storeys: &Storeys) -> Vec<String> {
    let mut paths = vec![String::new(); storeys.count()];
    for polygon in map.polygons.iter().filter(|polygon| !polygon.is_empty()) {
        let path = &mut paths[storeys.nearest(height(polygon))];
        *path += &line(&polygon.iter().map(spot).collect::<Vec<_>>());
        path.push('Z');
    }
    paths
}

/// Draws a scene's floor plan. It contains only digits, so it needs no escaping.
pub(crate) fn plan(map: &SceneMap) -> String {
    let bounds = MapBounds { min: spot(&map.min), max: spot(&map.max) };
    let storeys = Storeys::of(map, 0.0);
    let mut svg = format!("<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"{}\">", bounds.view_box());
    for (storey, floor) in floors(map, &storeys).iter().enumerate() {
        let shade = if storey == 0 { "#8a93a3" } else { "#5f6b80" };
        let _ = write!(svg, "<path fill=\"{shade}\" d=\"{floor}\"/>");
    }
    svg + "</svg>"
}

/// Returns the path colour at `time`, from 0 (start) to 1 (end).
pub(crate) fn colour(time: f32) -> String {
    let (half, share) = if time < 0.5 { (0, time * 2.0) } else { (1, time * 2.0 - 1.0) };
    let (from, to) = (COLOURS[half], COLOURS[half + 1]);
    let mix = |index: usize| (from[index] + (to[index] - from[index]) * share).round() as u8;
    format!("#{:02x}{:02x}{:02x}", mix(0), mix(1), mix(2))
}

struct MapMoment<'a> {
    replay: &'a Replay,
    storeys: &'a Storeys,
    moment: &'a Moment,
}

impl MapMoment<'_> {
    fn storey_at(&self, step: usize) -> usize {
        self.replay.path.get(step).map_or(0, |place| self.storeys.nearest(place[1]))
    }

    /// Splits the agent's path into pieces with about equal duration, which share their end points.
    fn pieces(&self, walk: &[Spot]) -> Vec<Piece> {
        let moves = walk.len().saturating_sub(1);
        let count = moves.min(PIECES);
        let cut = |index: usize| index * moves / count;
        let piece = |index: usize| Piece {
            path: line(&walk[cut(index)..=cut(index + 1)]),
            colour: colour(index as f32 / (count - 1).max(1) as f32),
            from_step: cut(index) + 1,
            storey: self.storey_at(cut(index + 1)),
            is_later: cut(index) as u32 >= self.moment.step,
        };
        (0..count).map(piece).collect()
    }

    fn submits(&self, walk: &[Spot]) -> Vec<SubmitSpot> {
        let mark = |submit: &avln_store::SubmitMark| {
            let at = *walk.get(submit.step as usize)?;
            let text = match submit.completed {
                Some(goal) => format!("Step {}: Submit of goal {}, right", submit.step, u32::from(goal) + 1),
                None => format!("Step {}: Submit, wrong", submit.step),
            };
            Some(SubmitSpot {
                at,
                storey: self.storey_at(submit.step as usize),
                step: submit.step,
                is_later: submit.step > self.moment.step,
                right: submit.completed.is_some(),
                text,
            })
        };
        self.replay.submits.iter().filter_map(mark).collect()
    }

    fn targets(&self, mission: Option<&MissionView>, bounds: &MapBounds) -> Vec<TargetBox> {
        let found = |index: usize| mission.and_then(|m| m.goals.get(index)?.found_at_step).is_some();
        let boxed = |(index, target): (usize, &TargetView)| {
            let (corner, opposite) = (spot(&target.min), spot(&target.max));
            let leftwards = opposite.x > bounds.min.x + 0.7 * bounds.width();
            let label_x = if leftwards { opposite.x } else { corner.x };
            TargetBox {
                corner,
                width: (opposite.x - corner.x).max(0.05),
                height: (opposite.y - corner.y).max(0.05),
                label: format!("{} {}", index + 1, target.category.replace('_', " ")),
                label_at: Spot { x: label_x, y: corner.y - 0.3 * bounds.letter_m() },
                leftwards,
                found: found(index),
                storey: self.storeys.nearest(target.floor_y_m),
                source: spot(&target.source),
                sounds: self.moment.sounding.is_some_and(|goal| usize::from(goal) == index),
            }
        };
        self.replay.targets.iter().enumerate().map(boxed).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spots(xs: &[f32]) -> Vec<Spot> {
        xs.iter().map(|&x| Spot { x, y: 0.0 }).collect()
    }

    #[test]
    fn pieces_cover_the_path_without_gaps() {
        let replay = crate::replay::tests::replay(1000);
        let storeys = Storeys::of(&replay.map, 0.0);
        let moment = &crate::replay::moments(&replay)[500];
        let now = MapMoment { replay: &replay, storeys: &storeys, moment };
        assert_eq!(now.pieces(&spots(&[])), vec![]);
        assert_eq!(now.pieces(&spots(&[1.0])), vec![]);
        let three = now.pieces(&spots(&[0.0, 1.0, 2.0]));
        assert_eq!((three[0].path.as_str(), three[0].colour.as_str()), ("M0.00 0.00L1.00 0.00", "#0072b2"));
        assert_eq!((three[1].path.as_str(), three[1].colour.as_str()), ("M1.00 0.00L2.00 0.00", "#d55e00"));
        let long: Vec<f32> = (0..=1000).map(|x| x as f32).collect();
        let long = now.pieces(&spots(&long));
        assert_eq!(long.len(), PIECES);
        assert!(long[PIECES - 1].path.ends_with("L1000.00 0.00"));
        assert_eq!(long.iter().map(|piece| piece.path.matches('L').count()).sum::<usize>(), 1000);
        assert_eq!(long.iter().filter(|piece| !piece.is_later).count(), PIECES / 2);
        assert_eq!((long[0].from_step, long[30].from_step), (1, 501));
    }

    #[test]
    fn each_storey_has_its_floor() {
        let map = SceneMap {
            polygons: vec![
                vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 1.0]],
                vec![[5.0, 3.0, 0.0], [6.0, 3.0, 0.0], [6.0, 3.0, 1.0]],
            ],
            ..SceneMap::default()
        };
        let floors = floors(&map, &Storeys::of(&map, 0.0));
        assert_eq!(floors, ["M0.00 0.00L1.00 0.00L1.00 1.00Z", "M5.00 0.00L6.00 0.00L6.00 1.00Z"]);
    }

    #[test]
    fn the_scale_bar_is_round_and_fits() {
        let bounds = MapBounds { min: Spot { x: 0.0, y: 0.0 }, max: Spot { x: 12.0, y: 30.0 } };
        assert_eq!(bounds.scale().length_m, 2.0);
        let small = MapBounds { min: Spot { x: 0.0, y: 0.0 }, max: Spot { x: 1.0, y: 1.0 } };
        assert_eq!(small.scale().length_m, 0.5);
    }
}
