//! Measurements of an object in a picture: size, outline, colours.

use crate::{
    cue::CueView,
    survey::thresholds::{SurveyOptions, SurveyTest},
};
use avln_scene::{InstanceId, colors};
use avln_world::CameraImage;
use std::{collections::BTreeMap, sync::LazyLock};

/// Histogram bins: 12 hues with 2 saturations and 2 values, and 4 greys.
const BINS: usize = 52;
/// Ring width around an object for colour comparison, as a share of the picture side.
const RING_SHARE: f32 = 0.08;
/// Steps per channel in the colour name table.
const STEPS: usize = 32;
const WORDS: usize = colors::PALETTE.len();

/// Colour word index per RGB cell.
static NAMES: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let middle = |step: usize| (step * 256 / STEPS + 128 / STEPS) as u8;
    let word = |cell: usize| {
        let rgb = [cell / (STEPS * STEPS), cell / STEPS % STEPS, cell % STEPS].map(middle);
        word_index(colors::name_of(rgb)) as u8
    };
    (0..STEPS * STEPS * STEPS).map(word).collect()
});

fn word_index(word: &str) -> usize {
    colors::PALETTE.iter().position(|(name, _)| *name == word).unwrap_or(WORDS - 1)
}

/// Pixel shares by hue, saturation and value.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Histogram([f32; BINS]);

impl Histogram {
    pub(crate) fn of(pixels: impl Iterator<Item = [u8; 3]>) -> Self {
        let mut counts = [0_u32; BINS];
        pixels.for_each(|rgb| counts[bin(rgb)] += 1);
        let total = counts.iter().sum::<u32>().max(1) as f32;
        Self(counts.map(|count| count as f32 / total))
    }

    /// Returns 1 minus the histogram intersection (Swain and Ballard 1991), 0 to 1.
    pub(crate) fn distance(&self, other: &Self) -> f32 {
        1.0 - self.0.iter().zip(&other.0).map(|(a, b)| a.min(*b)).sum::<f32>()
    }
}

fn bin([r, g, b]: [u8; 3]) -> usize {
    let [r, g, b] = [r, g, b].map(i32::from);
    let (most, least) = (r.max(g).max(b), r.min(g).min(b));
    let chroma = most - least;
    // Hue is noise for greys and dark pixels; they are binned by brightness.
    if chroma * 6 < most || most < 32 {
        return 48 + (most / 64) as usize;
    }
    let sixth = match most {
        most if most == r => (6 * chroma + g - b) % (6 * chroma),
        most if most == g => 2 * chroma + b - r,
        _ => 4 * chroma + r - g,
    };
    let hue = (2 * sixth / chroma).clamp(0, 11) as usize;
    let vivid = usize::from(chroma * 2 >= most);
    hue * 4 + vivid * 2 + usize::from(most >= 128)
}

#[derive(Clone, Debug)]
pub(crate) struct Look {
    pub(crate) view: CueView,
    /// Pixel share, 0 to 1.
    pub(crate) share: f32,
    /// Outline share on the picture border, 0 to 1.
    pub(crate) truncation: f32,
    /// Outline share with contrast to the surroundings, 0 to 1.
    pub(crate) contrast: f32,
    /// Colour distance to the surrounding ring, 0 to 1.
    pub(crate) distinctness: f32,
    pub(crate) object: Histogram,
    pub(crate) context: Histogram,
    /// Pixels per other instance.
    pub(crate) beside: BTreeMap<InstanceId, u32>,
}

impl Look {
    /// Measures a frame; `None` if `instance` is invisible.
    pub(crate) fn of(
        view: CueView,
        frame: &CameraImage,
        instance: InstanceId,
        options: &SurveyOptions,
    ) -> Option<Self> {
        let mask = Mask::of(frame, instance)?;
        let (border, contrasting, outline) = mask.outline(options.contrast_levels);
        let ring = Histogram::of(mask.ring());
        let object = Histogram::of(mask.pixels(true));
        Some(Self {
            view,
            share: mask.count as f32 / frame.instances.len().max(1) as f32,
            truncation: border as f32 / outline.max(1) as f32,
            contrast: contrasting as f32 / (outline - border).max(1) as f32,
            distinctness: object.distance(&ring),
            context: Histogram::of(mask.pixels(false)),
            beside: others(frame, instance),
            object,
        })
    }

    pub(crate) fn is_good(&self, options: &SurveyOptions) -> bool {
        self.failed(options).is_none()
    }

    /// Returns the first failed test.
    pub(crate) fn failed(&self, options: &SurveyOptions) -> Option<SurveyTest> {
        let tests = [
            (SurveyTest::Small, self.share >= options.min_share),
            (SurveyTest::Large, self.share <= options.max_share),
            (SurveyTest::Truncated, self.truncation <= options.max_truncation),
            (SurveyTest::Contrast, self.contrast >= options.min_contrast),
            (SurveyTest::Color, self.distinctness >= options.min_distinctness),
        ];
        tests.into_iter().find(|(_, is_passed)| !is_passed).map(|(test, _)| test)
    }

    /// Returns the picture quality, 0 to 1: large, whole, clear.
    pub(crate) fn quality(&self) -> f32 {
        const ENOUGH: f32 = 0.2;
        0.5 * (self.share / ENOUGH).min(1.0) + 0.3 * (1.0 - self.truncation) + 0.2 * self.contrast
    }
}

/// Adds all pixels to the palettes of their instances.
pub(crate) fn collect_colors(frame: &CameraImage, palettes: &mut BTreeMap<InstanceId, Palette>) {
    let runs = frame.instances.chunk_by(|a, b| a == b);
    let mut start = 0;
    for run in runs {
        if run[0] != InstanceId::NONE {
            let palette = palettes.entry(run[0]).or_default();
            (start..start + run.len()).for_each(|pixel| palette.add(rgb_at(frame, pixel)));
        }
        start += run.len();
    }
}

fn others(frame: &CameraImage, instance: InstanceId) -> BTreeMap<InstanceId, u32> {
    let mut pixels = BTreeMap::new();
    for run in frame.instances.chunk_by(|a, b| a == b) {
        if run[0] != InstanceId::NONE && run[0] != instance {
            *pixels.entry(run[0]).or_insert(0) += run.len() as u32;
        }
    }
    pixels
}

fn rgb_at(frame: &CameraImage, pixel: usize) -> [u8; 3] {
    [frame.rgb[3 * pixel], frame.rgb[3 * pixel + 1], frame.rgb[3 * pixel + 2]]
}

struct Mask<'a> {
    frame: &'a CameraImage,
    instance: InstanceId,
    count: u32,
    /// Bounding box: first and last column, first and last row.
    columns: [usize; 2],
    rows: [usize; 2],
}

impl<'a> Mask<'a> {
    fn of(frame: &'a CameraImage, instance: InstanceId) -> Option<Self> {
        let width = frame.width as usize;
        let mut mask = Self { frame, instance, count: 0, columns: [width, 0], rows: [0, 0] };
        for (pixel, _) in frame.instances.iter().enumerate().filter(|(_, id)| **id == instance) {
            let (row, column) = (pixel / width, pixel % width);
            if mask.count == 0 {
                mask.rows[0] = row;
            }
            mask.count += 1;
            mask.rows[1] = row;
            mask.columns = [mask.columns[0].min(column), mask.columns[1].max(column)];
        }
        (mask.count > 0).then_some(mask)
    }

    fn is_in(&self, column: usize, row: usize) -> bool {
        self.frame.instances[row * self.frame.width as usize + column] == self.instance
    }

    fn pixels(&self, inside: bool) -> impl Iterator<Item = [u8; 3]> {
        let own = move |pixel: &usize| (self.frame.instances[*pixel] == self.instance) == inside;
        (0..self.frame.instances.len()).filter(own).map(|pixel| rgb_at(self.frame, pixel))
    }

    /// Outline pixel counts: on the picture border, with contrast of at least `levels`, and all.
    fn outline(&self, levels: u8) -> (u32, u32, u32) {
        let (mut border, mut contrasting, mut all) = (0, 0, 0);
        for (row, column) in self.places(0) {
            if !self.is_in(column, row) {
                continue;
            }
            let neighbours = self.neighbours(column, row);
            let outside = || neighbours.iter().flatten().filter(|&&[c, r]| !self.is_in(c, r));
            let at_border = neighbours.iter().any(Option::is_none);
            if !at_border && outside().next().is_none() {
                continue;
            }
            all += 1;
            if at_border {
                border += 1;
            } else if outside().any(|&[c, r]| self.difference([column, row], [c, r]) >= levels) {
                contrasting += 1;
            }
        }
        (border, contrasting, all)
    }

    /// Four neighbours; `None` outside the picture.
    fn neighbours(&self, column: usize, row: usize) -> [Option<[usize; 2]>; 4] {
        let (width, height) = (self.frame.width as usize, self.frame.height as usize);
        [
            column.checked_sub(1).map(|c| [c, row]),
            row.checked_sub(1).map(|r| [column, r]),
            (column + 1 < width).then_some([column + 1, row]),
            (row + 1 < height).then_some([column, row + 1]),
        ]
    }

    fn difference(&self, a: [usize; 2], b: [usize; 2]) -> u8 {
        let rgb = |[column, row]: [usize; 2]| rgb_at(self.frame, row * self.frame.width as usize + column);
        let (a, b) = (rgb(a), rgb(b));
        (0..3).map(|channel| a[channel].abs_diff(b[channel])).max().unwrap_or(0)
    }

    /// Colours in the bounding box, grown by the ring width, without the mask.
    fn ring(&self) -> impl Iterator<Item = [u8; 3]> {
        let width = self.frame.width as usize;
        let margin = ((width as f32 * RING_SHARE) as usize).max(1);
        let outside = self.places(margin).filter(move |&(row, column)| !self.is_in(column, row));
        outside.map(move |(row, column)| rgb_at(self.frame, row * width + column))
    }

    /// Rows and columns in the bounding box, grown by `margin`.
    fn places(&self, margin: usize) -> impl Iterator<Item = (usize, usize)> + use<> {
        let grown = |[low, high]: [usize; 2], size: u32| {
            low.saturating_sub(margin)..(high + margin + 1).min(size as usize)
        };
        let columns = grown(self.columns, self.frame.width);
        grown(self.rows, self.frame.height)
            .flat_map(move |row| columns.clone().map(move |column| (row, column)))
    }
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Palette {
    counts: [u64; WORDS],
    sums: [u64; 3],
}

impl Palette {
    pub(crate) fn add(&mut self, rgb: [u8; 3]) {
        let [r, g, b] = rgb.map(|value| usize::from(value) * STEPS / 256);
        self.counts[usize::from(NAMES[(r * STEPS + g) * STEPS + b])] += 1;
        (0..3).for_each(|channel| self.sums[channel] += u64::from(rgb[channel]));
    }

    pub(crate) fn pixels(&self) -> u64 {
        self.counts.iter().sum()
    }

    /// Returns the pixel share with the colour `word`, 0 to 1.
    pub(crate) fn share_of(&self, word: &str) -> f32 {
        let known = colors::PALETTE.iter().position(|(name, _)| *name == word);
        known.map_or(0.0, |index| self.counts[index] as f32 / self.pixels().max(1) as f32)
    }

    /// Returns the word for the mean colour; `None` without pixels.
    pub(crate) fn mean_word(&self) -> Option<&'static str> {
        let pixels = self.pixels();
        (pixels > 0).then(|| colors::name_of(self.sums.map(|sum| (sum / pixels) as u8)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_geom::{Point3, Pose};

    /// 20 × 20 pixels with an 8 × 8 square at `corner`, instance 7.
    fn look(corner: [usize; 2], inside: [u8; 3], outside: [u8; 3]) -> Option<Look> {
        let is_in = |i: usize| {
            (corner[0]..corner[0] + 8).contains(&(i % 20)) && (corner[1]..corner[1] + 8).contains(&(i / 20))
        };
        let ids = (0..400).map(|i| if is_in(i) { InstanceId(7) } else { InstanceId(u32::from(i < 20)) });
        let frame = CameraImage {
            width: 20,
            height: 20,
            rgb: (0..400).flat_map(|i| if is_in(i) { inside } else { outside }).collect(),
            depth: vec![1.0; 400],
            instances: ids.collect(),
        };
        let view = CueView { pose: Pose::new(Point3::origin(), 0.0), hfov_rad: 1.5, side_px: 20 };
        Look::of(view, &frame, InstanceId(7), &SurveyOptions::default())
    }

    #[test]
    fn clear_picture_is_good() {
        let look = look([6, 6], [200, 30, 30], [240, 240, 240]).expect("it is in the picture");
        assert!((look.share - 64.0 / 400.0).abs() < 1e-6);
        assert_eq!((look.truncation, look.contrast, look.distinctness), (0.0, 1.0, 1.0));
        assert_eq!(look.beside, BTreeMap::from([(InstanceId(1), 20)]));
        assert!(look.is_good(&SurveyOptions::default()) && look.quality() > 0.8);
    }

    #[test]
    fn truncated_or_camouflaged_object_is_not_good() {
        let options = SurveyOptions::default();
        // Two 8-pixel sides without their shared corner are on the border: 15 out of 28 outline pixels.
        let cut = look([12, 12], [200, 30, 30], [240, 240, 240]).expect("it is in the picture");
        assert!((cut.truncation - 15.0 / 28.0).abs() < 1e-6 && !cut.is_good(&options));
        let blob = look([6, 6], [240, 240, 240], [236, 238, 240]).expect("it is in the picture");
        assert_eq!((blob.contrast, blob.distinctness), (0.0, 0.0));
        assert!(!blob.is_good(&options));
        assert!(look([30, 30], [0; 3], [9; 3]).is_none());
    }

    #[test]
    fn histograms_tell_hues_and_greys_apart() {
        let of = |rgb: [u8; 3]| Histogram::of(std::iter::once(rgb));
        let colors =
            [[200, 30, 30], [30, 200, 30], [30, 30, 200], [200, 200, 30], [20, 20, 20], [250, 250, 250]];
        for (i, a) in colors.iter().enumerate() {
            for (j, b) in colors.iter().enumerate() {
                assert_eq!(of(*a).distance(&of(*b)), f32::from(u8::from(i != j)), "{a:?} {b:?}");
            }
        }
    }

    #[test]
    fn palette_counts_names_and_mean() {
        let mut palette = Palette::default();
        assert_eq!((palette.mean_word(), palette.share_of("red")), (None, 0.0));
        (0..3).for_each(|_| palette.add([200, 30, 30]));
        palette.add([24, 24, 26]);
        assert_eq!(palette.pixels(), 4);
        assert!((palette.share_of("red") - 0.75).abs() < 1e-6);
        assert!((palette.share_of("black") - 0.25).abs() < 1e-6);
        assert_eq!(palette.mean_word(), Some("red"), "the mean is (156, 28, 29)");
        assert_eq!(palette.share_of("beige"), 0.0);
    }

    #[test]
    fn color_table_agrees_with_names() {
        for (word, rgb) in colors::PALETTE {
            let mut palette = Palette::default();
            palette.add(rgb);
            assert_eq!(palette.share_of(word), 1.0, "{word}");
        }
    }
}
