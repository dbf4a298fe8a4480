//! Detected objects, and their colours.

use crate::geometry::{FloorPoint, PinholeCamera, Pose2d, SurfacePoint};
use avln_client::{DepthImage, Image};
use avln_perception::extent;

/// Grid nodes per image row.
const NODES: usize = 64;
/// Object heights, metres: below is floor, above ceiling.
const HEIGHTS_M: [f32; 2] = [0.05, 2.3];
/// Farther objects are too coarse, metres.
const FAR_M: f32 = 6.0;
/// Largest range difference between neighbours within an object: a constant, metres, plus a share.
const STEP_M: f32 = 0.06;
const STEP_SHARE: f32 = 0.04;
/// Largest colour contrast within a free-standing object, and within an object on a wall.
const FREE_CONTRAST: f32 = 0.4;
const WALL_CONTRAST: f32 = 0.07;
/// Fewest nodes and greatest length in an object, metres.
const FEWEST_NODES: usize = 10;
const LONGEST_M: f32 = 3.2;

/// A detected object: box in the pose frame, and appearance.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DetectedObject {
    /// Lowest corner on the floor plan.
    pub min: FloorPoint,
    /// Highest corner.
    pub max: FloorPoint,
    /// Lowest point above the floor, metres.
    pub low_m: f32,
    /// Highest point above the floor, metres.
    pub high_m: f32,
    /// Colours.
    pub palette: Palette,
    /// Instance embedding; empty if the recognition has none.
    pub embedding: Vec<f32>,
    /// Categories and probabilities; empty if the recognition has none.
    pub kinds: Vec<(String, f32)>,
    /// Image count.
    pub views: u32,
    /// True if the last image cuts the object off at two or more edges.
    pub is_cut: bool,
}

impl DetectedObject {
    /// Builds an object from pixels (column, row); `None` for too few, too distant or depthless pixels.
    pub fn of_pixels(
        view: &PinholeCamera,
        pose: &Pose2d,
        image: &Image,
        depth: &DepthImage,
        pixels: Vec<(usize, usize)>,
    ) -> Option<Self> {
        const FEWEST_PIXELS: usize = 32;
        let [mut x, mut z, mut up]: [Vec<f32>; 3] = Default::default();
        for seen in pixels.iter().filter_map(|&(column, row)| view.seen(pose, depth, column, row)) {
            if seen.range_m < FAR_M {
                x.push(seen.place.x);
                z.push(seen.place.z);
                up.push(seen.height_m);
            }
        }
        if x.len() < FEWEST_PIXELS {
            return None;
        }
        let ([x0, x1], [z0, z1], [low_m, high_m]) = (extent(x)?, extent(z)?, extent(up)?);
        let rgb = |(column, row): (usize, usize)| {
            let start = 3 * (row * view.width + column);
            image.pixels.get(start..start + 3)?.try_into().ok()
        };
        let palette = Palette::of(pixels.into_iter().filter_map(rgb));
        let (min, max) = (FloorPoint::new(x0, z0), FloorPoint::new(x1, z1));
        Some(Self { min, max, low_m, high_m, palette, views: 1, ..Self::default() })
    }

    /// Returns the long side on the floor plan, metres.
    pub fn long_m(&self) -> f32 {
        (self.max.x - self.min.x).max(self.max.z - self.min.z)
    }

    /// Returns the short side on the floor plan, metres.
    pub fn short_m(&self) -> f32 {
        (self.max.x - self.min.x).min(self.max.z - self.min.z)
    }

    /// Returns the box's nearest point on the floor plan.
    pub fn nearest(&self, place: FloorPoint) -> FloorPoint {
        FloorPoint::new(place.x.clamp(self.min.x, self.max.x), place.z.clamp(self.min.z, self.max.z))
    }

    /// Returns the point of the object to face from `place`: the nearest one of the box, or its centre from within 0.3 m of the box.
    pub fn facing(&self, place: FloorPoint) -> FloorPoint {
        const BESIDE_M: f32 = 0.3;
        let nearest = self.nearest(place);
        if nearest.distance_m(place) < BESIDE_M { self.center() } else { nearest }
    }

    /// Returns the distance between a point and the box on the floor plan, metres.
    pub fn distance_m(&self, place: FloorPoint) -> f32 {
        self.nearest(place).distance_m(place)
    }

    /// Returns the centre on the floor plan.
    pub fn center(&self) -> FloorPoint {
        self.min.toward(self.max, 0.5)
    }

    /// Returns true for a wall: thin, long and tall.
    fn is_wall(&self) -> bool {
        self.high_m - self.low_m > 1.7 && self.long_m() > 1.2 && self.short_m() < 0.2
    }

    /// Returns true if both may be the same object: touching boxes, similar embeddings or else colours.
    pub fn is_same(&self, other: &Self) -> bool {
        const SLACK_M: f32 = 0.1;
        const LIKE: f32 = 0.6;
        let apart = |a: &Self, b: &Self| {
            a.min.x > b.max.x + SLACK_M || a.min.z > b.max.z + SLACK_M || a.low_m > b.high_m + SLACK_M
        };
        let all_m = self.long_m().max(other.long_m()) + self.center().distance_m(other.center());
        let alike = || match self.embedding.as_slice() {
            [] => all_m < LONGEST_M && self.palette.likeness(&other.palette) > LIKE,
            own => cosine(own, &other.embedding) > LIKE,
        };
        !apart(self, other) && !apart(other, self) && alike()
    }

    /// Merges another view.
    pub fn merge(&mut self, other: &Self) {
        self.min = FloorPoint::new(self.min.x.min(other.min.x), self.min.z.min(other.min.z));
        self.max = FloorPoint::new(self.max.x.max(other.max.x), self.max.z.max(other.max.z));
        (self.low_m, self.high_m) = (self.low_m.min(other.low_m), self.high_m.max(other.high_m));
        self.palette.merge(&other.palette);
        let share = other.views as f32 / (self.views + other.views).max(1) as f32;
        mix(&mut self.embedding, &other.embedding, share);
        self.mix_kinds(&other.kinds, share);
        self.views += other.views;
        self.is_cut = other.is_cut;
    }

    /// Returns a category's probability, 0 to 1; `None` without probabilities.
    pub fn is_a(&self, category: &str) -> Option<f32> {
        let told =
            self.kinds.iter().filter(|(kind, _)| kind == category).map(|(_, probability)| probability).sum();
        (!self.kinds.is_empty()).then_some(told)
    }

    fn mix_kinds(&mut self, others: &[(String, f32)], share: f32) {
        if others.is_empty() {
            return;
        }
        let share = if self.kinds.is_empty() { 1.0 } else { share };
        self.kinds.iter_mut().for_each(|(_, probability)| *probability *= 1.0 - share);
        for (kind, more) in others {
            match self.kinds.iter_mut().find(|(known, _)| known == kind) {
                Some((_, probability)) => *probability += share * more,
                None => self.kinds.push((kind.clone(), share * more)),
            }
        }
    }
}

pub(crate) fn cosine(a: &[f32], b: &[f32]) -> f32 {
    let product = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
    product(a, b) / (product(a, a) * product(b, b)).sqrt().max(f32::EPSILON)
}

/// Moves a mean by `share` towards new values; copies them if the mean is empty.
fn mix(mean: &mut Vec<f32>, others: &[f32], share: f32) {
    if mean.len() != others.len() {
        *mean = if others.is_empty() { std::mem::take(mean) } else { others.to_vec() };
        return;
    }
    mean.iter_mut().zip(others).for_each(|(mean, other)| *mean += share * (other - *mean));
}

#[derive(Clone, Copy)]
struct GridNode {
    seen: SurfacePoint,
    rgb: [u8; 3],
    on_wall: bool,
}

/// Segments an image into objects: connected stretches without depth jumps, with one colour on walls.
pub fn detect_objects(
    view: &PinholeCamera,
    pose: &Pose2d,
    image: &Image,
    depth: &DepthImage,
    is_wall: impl Fn(FloorPoint) -> bool,
) -> Vec<DetectedObject> {
    let stride = (view.width / NODES).max(1);
    let (columns, rows) = (view.width / stride, view.height / stride);
    let node = |index: usize| {
        let (column, row) = (index % columns * stride, index / columns * stride);
        let seen = view.seen(pose, depth, column, row)?;
        let start = 3 * (row * view.width + column);
        let rgb = image.pixels.get(start..start + 3)?.try_into().ok()?;
        let inside = (HEIGHTS_M[0]..HEIGHTS_M[1]).contains(&seen.height_m) && seen.range_m < FAR_M;
        inside.then(|| GridNode { seen, rgb, on_wall: is_wall(seen.place) })
    };
    let nodes: Vec<Option<GridNode>> = (0..columns * rows).map(node).collect();
    let mut taken = vec![false; nodes.len()];
    (0..nodes.len()).filter_map(|first| detection(&flood(&nodes, columns, first, &mut taken))).collect()
}

/// Collects the free nodes connected with `first`.
fn flood(nodes: &[Option<GridNode>], columns: usize, first: usize, taken: &mut [bool]) -> Vec<GridNode> {
    let (mut found, mut open) = (Vec::new(), vec![first]);
    if taken[first] || nodes[first].is_none() {
        return found;
    }
    taken[first] = true;
    while let Some(at) = open.pop() {
        let Some(here) = nodes[at] else { continue };
        found.push(here);
        let (column, row) = (at % columns, at / columns);
        let sides = [
            (column > 0).then(|| at - 1),
            (column + 1 < columns).then_some(at + 1),
            (row > 0).then(|| at - columns),
            (at + columns < nodes.len()).then_some(at + columns),
        ];
        for next in sides.into_iter().flatten() {
            if !taken[next] && nodes[next].is_some_and(|next| belongs(&here, &next)) {
                taken[next] = true;
                open.push(next);
            }
        }
    }
    found
}

fn belongs(here: &GridNode, next: &GridNode) -> bool {
    let jump_m = (here.seen.range_m - next.seen.range_m).abs();
    let limit = if here.on_wall { WALL_CONTRAST } else { FREE_CONTRAST };
    here.on_wall == next.on_wall
        && jump_m < STEP_M + STEP_SHARE * here.seen.range_m
        && contrast(here.rgb, next.rgb) < limit
}

/// Builds an object from nodes; `None` if too few or too scattered.
fn detection(nodes: &[GridNode]) -> Option<DetectedObject> {
    if nodes.len() < FEWEST_NODES {
        return None;
    }
    let places = nodes.iter().map(|node| node.seen.place);
    let low = |a: FloorPoint, b: FloorPoint| FloorPoint::new(a.x.min(b.x), a.z.min(b.z));
    let high = |a: FloorPoint, b: FloorPoint| FloorPoint::new(a.x.max(b.x), a.z.max(b.z));
    let heights = nodes.iter().map(|node| node.seen.height_m);
    let detection = DetectedObject {
        min: places.clone().reduce(low)?,
        max: places.reduce(high)?,
        low_m: heights.clone().fold(f32::INFINITY, f32::min),
        high_m: heights.fold(0.0, f32::max),
        palette: Palette::of(nodes.iter().map(|node| node.rgb)),
        views: 1,
        ..DetectedObject::default()
    };
    // Long stretches are walls or several objects that the depth does not separate.
    (detection.long_m() < LONGEST_M && !detection.is_wall()).then_some(detection)
}

/// Bins of a [`Palette`]: twelve hues, then black, dark grey, light grey and white.
const BINS: usize = 16;
const HUES: usize = 12;
/// Saturation below which a pixel is grey.
const GREY: f32 = 0.18;

/// Colour words, with examples.
const NAMED: [(&str, [u8; 3]); 13] = [
    ("red", [200, 40, 40]),
    ("orange", [240, 140, 30]),
    ("yellow", [240, 215, 60]),
    ("green", [60, 150, 60]),
    ("teal", [30, 145, 145]),
    ("blue", [45, 85, 190]),
    ("purple", [135, 55, 165]),
    ("pink", [240, 140, 180]),
    ("brown", [125, 85, 50]),
    ("black", [30, 30, 32]),
    ("grey", [135, 135, 135]),
    ("white", [240, 240, 235]),
    ("gray", [135, 135, 135]),
];

/// A histogram of hues and greys; the shares add up to 1 unless empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Palette {
    shares: [f32; BINS],
    pixels: f32,
}

impl Palette {
    /// Builds a palette from pixels.
    pub fn of(pixels: impl Iterator<Item = [u8; 3]>) -> Self {
        let mut palette = Self::default();
        for rgb in pixels {
            palette.shares[bin(rgb)] += 1.0;
            palette.pixels += 1.0;
        }
        let count = palette.pixels.max(1.0);
        palette.shares.iter_mut().for_each(|share| *share /= count);
        palette
    }

    /// Adds another view's pixels.
    pub fn merge(&mut self, other: &Self) {
        let all = (self.pixels + other.pixels).max(1.0);
        for (share, more) in self.shares.iter_mut().zip(&other.shares) {
            *share = (*share * self.pixels + more * other.pixels) / all;
        }
        // The cap lets new views change the colours of objects with many views.
        self.pixels = all.min(20_000.0);
    }

    /// Returns the similarity, 0 to 1; neighbouring hues count in part.
    pub fn likeness(&self, other: &Self) -> f32 {
        let (a, b) = (self.softened(), other.softened());
        a.iter().zip(&b).map(|(a, b)| (a * b).sqrt()).sum::<f32>().min(1.0)
    }

    /// Returns a colour word's share, 0 to 1; `None` for other words.
    pub fn share_of(&self, word: &str) -> Option<f32> {
        let (_, example) = NAMED.iter().find(|(name, _)| *name == word)?;
        Some(self.softened()[bin(*example)].min(1.0))
    }

    fn softened(&self) -> [f32; BINS] {
        const LEAK: f32 = 0.2;
        std::array::from_fn(|i| {
            let (before, after) = if i < HUES {
                ((i + HUES - 1) % HUES, (i + 1) % HUES)
            } else {
                ((i - 1).max(HUES), (i + 1).min(BINS - 1))
            };
            (1.0 - LEAK) * self.shares[i] + 0.5 * LEAK * (self.shares[before] + self.shares[after])
        })
    }
}

pub(crate) fn is_color(word: &str) -> bool {
    NAMED.iter().any(|(name, _)| *name == word)
}

/// Returns the difference between two colours, 0 to about 1; brightness counts less than hue.
pub(crate) fn contrast(a: [u8; 3], b: [u8; 3]) -> f32 {
    let chroma = |rgb: [u8; 3]| {
        let [r, g, b] = rgb.map(|value| f32::from(value) / 255.0);
        [0.35 * (r + g + b) / 3.0, r - g, 0.5 * (r + g) - b]
    };
    let (a, b) = (chroma(a), chroma(b));
    a.iter().zip(&b).map(|(a, b)| (a - b) * (a - b)).sum::<f32>().sqrt()
}

fn bin(rgb: [u8; 3]) -> usize {
    let [r, g, b] = rgb.map(|value| f32::from(value) / 255.0);
    let (high, low) = (r.max(g).max(b), r.min(g).min(b));
    if high - low < GREY * high.max(0.25) {
        return HUES + ((high * 4.0) as usize).min(3);
    }
    let span = high - low;
    let hue = if high == r {
        ((g - b) / span).rem_euclid(6.0)
    } else if high == g {
        (b - r) / span + 2.0
    } else {
        (r - g) / span + 4.0
    };
    ((hue * HUES as f32 / 6.0 + 0.5) as usize) % HUES
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_client::{Pose, TaskSpec};

    #[test]
    fn block_before_a_wall_is_one_object() {
        let view = PinholeCamera::new(&TaskSpec { width: 64, height: 64, ..TaskSpec::default() });
        let block = |i: usize| (24..40).contains(&(i % 64)) && (32..48).contains(&(i / 64));
        let metres = (0..4096).map(|i| if block(i) { 1.5 } else { 3.0 }).collect();
        let depth = DepthImage { width: 64, height: 64, metres };
        let pixels = (0..4096).flat_map(|i| if block(i) { [200, 30, 30] } else { [128; 3] }).collect();
        let image = Image { width: 64, height: 64, pixels };
        let found =
            detect_objects(&view, &Pose2d::new(&Pose::default()), &image, &depth, |place| place.z < -2.9);
        assert_eq!(found.len(), 1, "{found:?}");
        // 16 of 64 pixels at 1.5 m are 0.75 m wide; rows 32 to 48 reach from the eye down to 0.25 m.
        assert!((found[0].long_m() - 0.7).abs() < 0.05 && (found[0].center().z + 1.5).abs() < 0.05);
        assert!((found[0].low_m - 0.27).abs() < 0.05 && (found[0].high_m - 0.98).abs() < 0.05);
        assert!(found[0].palette.share_of("red").unwrap() > 0.7);
    }

    #[test]
    fn equal_colours_merge_and_others_do_not() {
        let block = |x: f32, rgb: [u8; 3]| DetectedObject {
            min: FloorPoint::new(x, 0.0),
            max: FloorPoint::new(x + 0.5, 0.5),
            low_m: 0.0,
            high_m: 0.8,
            palette: Palette::of([rgb; 20].into_iter()),
            views: 1,
            ..DetectedObject::default()
        };
        let mut red = block(0.0, [200, 30, 30]);
        assert!(red.is_same(&block(0.4, [190, 35, 30])));
        assert!(!red.is_same(&block(0.4, [30, 30, 200])) && !red.is_same(&block(1.0, [200, 30, 30])));
        red.merge(&block(0.4, [190, 35, 30]));
        assert!((red.long_m() - 0.9).abs() < 1e-6 && red.views == 2);
        assert!((red.distance_m(FloorPoint::new(1.2, 0.9)) - 0.5).abs() < 1e-6);
    }

    #[test]
    fn probabilities_and_embeddings_are_averaged() {
        let view = |kind: &str, value: f32| DetectedObject {
            kinds: vec![(kind.to_owned(), 1.0)],
            embedding: vec![value, 1.0],
            views: 1,
            ..DetectedObject::default()
        };
        let mut detection = view("bed", 0.0);
        detection.merge(&view("bed", 0.0));
        detection.merge(&view("sofa", 3.0));
        let near = |value: Option<f32>, expected: f32| (value.unwrap() - expected).abs() < 1e-6;
        assert!(
            near(detection.is_a("bed"), 2.0 / 3.0) && near(detection.is_a("sofa"), 1.0 / 3.0),
            "{detection:?}"
        );
        assert!(detection.is_a("lamp") == Some(0.0) && DetectedObject::default().is_a("lamp").is_none());
        assert!((detection.embedding[0] - 1.0).abs() < 1e-6 && detection.embedding[1] == 1.0);
        detection.merge(&DetectedObject { views: 1, ..DetectedObject::default() });
        assert_eq!(detection.embedding.len(), 2);
    }

    #[test]
    fn colour_names_match_pixels() {
        let red = Palette::of([[190, 30, 35]; 10].into_iter());
        assert!(red.share_of("red").unwrap() > 0.7 && red.share_of("blue").unwrap() < 0.1);
        let white = Palette::of([[250, 250, 240]; 10].into_iter());
        assert!(white.share_of("white").unwrap() > 0.7 && white.share_of("black").unwrap() < 0.1);
        assert_eq!(red.share_of("velvet"), None);
        assert!(is_color("teal") && !is_color("chair"));
    }

    #[test]
    fn palettes_match_themselves() {
        let red = Palette::of([[190, 30, 35]; 10].into_iter());
        let mut mixed = Palette::of([[30, 60, 190]; 10].into_iter());
        assert!(red.likeness(&red) > 0.95 && red.likeness(&mixed) < 0.1);
        mixed.merge(&red);
        assert!((0.3..0.95).contains(&red.likeness(&mixed)), "{}", red.likeness(&mixed));
    }

    #[test]
    fn brightness_counts_less_than_hue() {
        assert!(contrast([100, 50, 50], [120, 60, 60]) < 0.1);
        assert!(contrast([120, 60, 60], [60, 60, 120]) > 0.2);
    }
}
