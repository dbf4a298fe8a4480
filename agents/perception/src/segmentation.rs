//! Segmentations: from the network's output to instances.

use crate::NetworkInfo;
use crate::feature_map::FeatureMap;
use crate::network::Picture;
use avln_simd::{Width, Work, run_at};

/// An image segmentation: a coarser map over the whole image.
#[derive(Clone, Debug, PartialEq)]
pub struct Segmentation {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Likeliest category by pixel, row by row from the top-left.
    pub categories: Vec<u8>,
    /// Probability, 0 to 1.
    pub confidences: Vec<f32>,
    /// Instances, largest first, without the building itself.
    pub segments: Vec<Segment>,
}

/// The visible part of an instance.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// Pixel indices, ascending: row times width plus column.
    pub mask: Vec<u32>,
    /// Probability by category; the sum is 1.
    pub categories: Vec<f32>,
    /// Unit embedding: close by cosine to other views of the instance, distant from other instances in the category.
    pub embedding: Vec<f32>,
    /// Colours.
    pub histogram: Histogram,
    /// Bounding box.
    pub bounds: PixelBox,
}

/// A box of pixels; both ends are inside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelBox {
    /// First and last column.
    pub columns: [u32; 2],
    /// First and last row.
    pub rows: [u32; 2],
}

/// Radius around an image's middle, as a share of the width.
const MIDDLE_SHARE: f32 = 0.08;

impl Segmentation {
    /// Returns the instance in the middle; `None` if only the building is there.
    pub fn in_the_middle(&self) -> Option<&Segment> {
        let weighed = self.segments.iter().map(|segment| (segment, self.middle_weight(segment)));
        let best = weighed.max_by(|a, b| a.1.total_cmp(&b.1))?;
        (best.1 > 0.0).then_some(best.0)
    }

    /// Returns a segment's pixel weight in the middle.
    fn middle_weight(&self, segment: &Segment) -> f32 {
        let reach = MIDDLE_SHARE * self.width as f32;
        let from_middle = |at: usize, side: usize| (at as f32 + 0.5 - 0.5 * side as f32) / reach;
        let weight = |pixel: &u32| {
            let (row, column) = (*pixel as usize / self.width, *pixel as usize % self.width);
            let (x, y) = (from_middle(column, self.width), from_middle(row, self.height));
            libm::expf(-0.5 * (x * x + y * y))
        };
        segment.mask.iter().map(weight).sum()
    }
}

impl Segment {
    /// Returns the likeliest category and the probability.
    pub fn category(&self) -> (usize, f32) {
        let all = self.categories.iter().copied().enumerate();
        all.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0))
    }

    /// Returns the cosine of the embeddings, -1 to 1; meaningful within a category.
    pub fn cosine(&self, other: &Self) -> f32 {
        self.embedding.iter().zip(&other.embedding).map(|(a, b)| a * b).sum()
    }
}

impl PixelBox {
    /// Returns the bounding box for pixels in rows of `width`; `None` without pixels.
    pub(crate) fn around(pixels: &[u32], width: usize) -> Option<Self> {
        let place = |pixel: &u32| (pixel % width as u32, pixel / width as u32);
        let (column, row) = place(pixels.first()?);
        let start = Self { columns: [column; 2], rows: [row; 2] };
        Some(pixels.iter().map(place).fold(start, |bounds, (column, row)| Self {
            columns: [bounds.columns[0].min(column), bounds.columns[1].max(column)],
            rows: [bounds.rows[0].min(row), bounds.rows[1].max(row)],
        }))
    }
}

/// Hues, each in [`VIVIDNESSES`] steps of saturation; then greys by value.
const HUES: usize = 12;
const VIVIDNESSES: usize = 3;
const GREYS: usize = 4;
const BINS: usize = HUES * VIVIDNESSES + GREYS;
/// Saturation below which a colour is grey, 0 to 1, and value below which it is black, 0 to 255.
const GREY: f32 = 0.12;
const BLACK: f32 = 40.0;

/// A colour histogram: shares by hue and saturation, and of greys by value; they add up to 1 unless empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Histogram {
    shares: Vec<f32>,
}

impl Histogram {
    /// Counts pixels.
    pub fn of(pixels: impl Iterator<Item = [u8; 3]>) -> Self {
        let mut shares = vec![0.0; BINS];
        let mut count = 0.0_f32;
        for rgb in pixels {
            shares[bin(rgb)] += 1.0;
            count += 1.0;
        }
        shares.iter_mut().for_each(|share| *share /= count.max(1.0));
        Self { shares }
    }

    /// Returns the shares: 12 hues from red, three saturations each, then four greys from black.
    pub fn shares(&self) -> &[f32] {
        &self.shares
    }

    /// Returns the histogram intersection, 0 to 1 (Swain and Ballard 1991).
    pub fn likeness(&self, other: &Self) -> f32 {
        self.shares.iter().zip(&other.shares).map(|(a, b)| a.min(*b)).sum()
    }
}

fn bin(rgb: [u8; 3]) -> usize {
    let [r, g, b] = rgb.map(f32::from);
    let (most, least) = (r.max(g).max(b), r.min(g).min(b));
    let (chroma, saturation) = (most - least, (most - least) / most.max(1.0));
    if saturation < GREY || most < BLACK {
        return HUES * VIVIDNESSES + ((most / 256.0 * GREYS as f32) as usize).min(GREYS - 1);
    }
    let sixth = match most {
        most if most == r => ((g - b) / chroma).rem_euclid(6.0),
        most if most == g => (b - r) / chroma + 2.0,
        _ => (r - g) / chroma + 4.0,
    };
    let hue = (sixth / 6.0 * HUES as f32) as usize % HUES;
    let vivid = ((saturation - GREY) / (1.0 - GREY) * VIVIDNESSES as f32) as usize;
    hue * VIVIDNESSES + vivid.min(VIVIDNESSES - 1)
}

const LEAST_PX: usize = 12;
/// Radius around predicted centres within an instance, map pixels.
const SPREAD_PX: usize = 5;
/// Least vote share for a centre in a stretch.
const LEAST_SHARE: f32 = 0.12;
const MOST_PARTS: usize = 16;
/// Distance between mean centres below which two stretches are a partly occluded instance, pixels.
const TOGETHER_PX: f32 = 4.0;

pub(crate) fn seen(info: &NetworkInfo, output: &mut FeatureMap, picture: &Picture) -> Segmentation {
    let kinds = info.categories.len();
    let (categories, confidences) = likelihoods(output, kinds);
    let [width, height] = [output.width, output.height];
    let middles = InstanceCenters::of(output, kinds, info.offset_px);
    let mut groups = Vec::new();
    let mut taken: Vec<bool> =
        categories.iter().map(|category| usize::from(*category) < info.building).collect();
    for first in 0..taken.len() {
        if !taken[first] {
            let stretch = flood(&categories, width, first, &mut taken);
            groups.extend(middles.cut(&stretch).into_iter().map(|pixels| (categories[first], pixels)));
        }
    }
    let groups = middles.together(groups);
    let whole = groups.into_iter().filter(|pixels| pixels.len() >= LEAST_PX);
    let mut segments: Vec<Segment> =
        whole.filter_map(|pixels| segment(pixels, output, kinds, picture)).collect();
    segments.sort_by_key(|segment| std::cmp::Reverse(segment.mask.len()));
    Segmentation { width, height, categories, confidences, segments }
}

/// Converts logits to probabilities in place; returns the likeliest category by pixel and its probability.
fn likelihoods(output: &mut FeatureMap, kinds: usize) -> (Vec<u8>, Vec<f32>) {
    run_at(Width::Sixteen, Likelihoods { output, kinds })
}

struct Likelihoods<'a> {
    output: &'a mut FeatureMap,
    kinds: usize,
}

impl Work for Likelihoods<'_> {
    type Output = (Vec<u8>, Vec<f32>);

    #[inline(always)]
    fn run(self) -> Self::Output {
        let pixels = self.output.width * self.output.height;
        let (mut categories, mut confidences) = (Vec::with_capacity(pixels), Vec::with_capacity(pixels));
        let channels = self.output.channels;
        for row in 0..self.output.height {
            for pixel in self.output.row_mut(row).chunks_exact_mut(channels) {
                let logits = &mut pixel[..self.kinds];
                // The maximum is subtracted against overflow.
                let most = logits
                    .iter()
                    .fold(f32::NEG_INFINITY, |most, logit| if *logit > most { *logit } else { most });
                let best = logits.iter().position(|logit| *logit == most).unwrap_or(0);
                logits.iter_mut().for_each(|logit| *logit = exp_of_negative(*logit - most));
                let sum: f32 = logits.iter().sum();
                logits.iter_mut().for_each(|logit| *logit /= sum);
                categories.push(best as u8);
                confidences.push(logits[best]);
            }
        }
        (categories, confidences)
    }
}

/// Returns `libm::expf(x)` for `x` from -87 to 0, with equal bits, and 1.6e-38 below and for NaN: a function without branches
/// or calls, which the compiler vectorises. Reduction to a power of two and rational approximation: FreeBSD's `e_expf.c`.
#[inline(always)]
fn exp_of_negative(x: f32) -> f32 {
    const LN2: [f32; 2] = [6.931_457_5e-1, 1.428_606_8e-6];
    let x = x.max(-87.0);
    let power = (x * std::f32::consts::LOG2_E - 0.5) as i32;
    let (high, low) = (x - power as f32 * LN2[0], power as f32 * LN2[1]);
    let rest = high - low;
    let square = rest * rest;
    let c = rest - square * (1.666_662_5e-1 + square * -2.766_733_3e-3);
    let near = 1.0 + (rest * c / (2.0 - c) - low + high);
    let scaled = near * f32::from_bits(((power + 127) << 23) as u32);
    // As in libm: close to 0 the approximation differs in the last bit.
    if x >= -1.220_703_1e-4 { 1.0 + x } else { scaled }
}

/// Collects the free pixels connected with `first` in the same category.
fn flood(categories: &[u8], width: usize, first: usize, taken: &mut [bool]) -> Vec<u32> {
    let (mut found, mut open) = (Vec::new(), vec![first]);
    taken[first] = true;
    while let Some(at) = open.pop() {
        found.push(at as u32);
        let column = at % width;
        let sides = [
            (column > 0).then(|| at - 1),
            (column + 1 < width).then_some(at + 1),
            at.checked_sub(width),
            (at + width < categories.len()).then_some(at + width),
        ];
        for next in sides.into_iter().flatten() {
            if !taken[next] && categories[next] == categories[first] {
                taken[next] = true;
                open.push(next);
            }
        }
    }
    found
}

/// Predicted instance centres by pixel, in map pixels.
struct InstanceCenters {
    places: Vec<[f32; 2]>,
    width: usize,
    height: usize,
}

impl InstanceCenters {
    fn of(output: &FeatureMap, kinds: usize, offset_px: f32) -> Self {
        let (width, height) = (output.width, output.height);
        let place = |pixel: usize| {
            let (column, row) = (pixel % width, pixel / width);
            let offsets = &output.at(column, row)[kinds..kinds + 2];
            [column as f32 + offsets[0] * offset_px, row as f32 + offsets[1] * offset_px]
        };
        Self { places: (0..width * height).map(place).collect(), width, height }
    }

    /// Returns a position's nearest pixel.
    fn cell(&self, [x, y]: [f32; 2]) -> [usize; 2] {
        let inside = |at: f32, side: usize| at.round().clamp(0.0, (side - 1) as f32) as usize;
        [inside(x, self.width), inside(y, self.height)]
    }

    /// Splits a stretch by predicted centre.
    fn cut(&self, stretch: &[u32]) -> Vec<Vec<u32>> {
        // A small stretch cannot contain two instances.
        let peaks = if stretch.len() < 2 * LEAST_PX { Vec::new() } else { self.peaks(stretch) };
        if peaks.len() < 2 {
            return vec![stretch.to_vec()];
        }
        let mut parts = vec![Vec::new(); peaks.len()];
        for &pixel in stretch {
            let told = self.places[pixel as usize];
            let nearest =
                (0..peaks.len()).min_by(|&a, &b| apart2(told, peaks[a]).total_cmp(&apart2(told, peaks[b])));
            parts[nearest.unwrap_or(0)].push(pixel);
        }
        parts
    }

    /// Finds the centres with most votes, greedily: after every centre the neighbourhood is removed.
    fn peaks(&self, stretch: &[u32]) -> Vec<[f32; 2]> {
        let reach2 = (SPREAD_PX * SPREAD_PX) as f32;
        let least = (LEAST_SHARE * stretch.len() as f32).max(LEAST_PX as f32) as usize;
        let mut left: Vec<[f32; 2]> = stretch.iter().map(|pixel| self.places[*pixel as usize]).collect();
        let mut votes = Vec::new();
        let mut peaks = Vec::new();
        while left.len() >= least && peaks.len() < MOST_PARTS {
            let peak = self.peak(&left, &mut votes);
            let around = left.iter().filter(|place| apart2(**place, peak) <= reach2).count();
            if around < least && !peaks.is_empty() {
                break;
            }
            peaks.push(peak);
            // Twice the radius: votes at the rim of this centre must not become a centre of their own.
            left.retain(|place| apart2(*place, peak) > 4.0 * reach2);
        }
        peaks
    }

    /// Returns the position with most votes, in steps of two pixels; `votes` is a scratch buffer.
    fn peak(&self, places: &[[f32; 2]], votes: &mut Vec<u32>) -> [f32; 2] {
        let columns = self.width.div_ceil(2);
        votes.clear();
        votes.resize(columns * self.height.div_ceil(2), 0);
        for [x, y] in places.iter().map(|place| self.cell(*place)) {
            votes[y / 2 * columns + x / 2] += 1;
        }
        let most = (0..votes.len()).max_by_key(|&cell| (votes[cell], std::cmp::Reverse(cell))).unwrap_or(0);
        [(most % columns * 2) as f32 + 0.5, (most / columns * 2) as f32 + 0.5]
    }

    /// Merges groups with the same category and nearly equal mean centres.
    fn together(&self, mut groups: Vec<(u8, Vec<u32>)>) -> Vec<Vec<u32>> {
        // Large groups come first: their mean centres are the most reliable.
        groups.sort_by_key(|(category, pixels)| (*category, std::cmp::Reverse(pixels.len())));
        let mut whole: Vec<(u8, [f32; 2], Vec<u32>)> = Vec::new();
        for (category, pixels) in groups {
            let middle = self.mean(&pixels);
            let same = whole
                .iter_mut()
                .find(|(other, at, _)| *other == category && apart2(*at, middle) < TOGETHER_PX * TOGETHER_PX);
            match same {
                Some((_, _, all)) => all.extend(pixels),
                None => whole.push((category, middle, pixels)),
            }
        }
        whole.into_iter().map(|(_, _, pixels)| pixels).collect()
    }

    fn mean(&self, pixels: &[u32]) -> [f32; 2] {
        let places = pixels.iter().map(|pixel| self.places[*pixel as usize]);
        let [x, y] = places.fold([0.0; 2], |[x, y], place| [x + place[0], y + place[1]]);
        [x / pixels.len().max(1) as f32, y / pixels.len().max(1) as f32]
    }
}

fn apart2(a: [f32; 2], b: [f32; 2]) -> f32 {
    (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)
}

fn segment(mut mask: Vec<u32>, output: &FeatureMap, kinds: usize, picture: &Picture) -> Option<Segment> {
    // A fixed summation order makes results reproducible.
    mask.sort_unstable();
    let bounds = PixelBox::around(&mask, output.width)?;
    let mut sums = vec![0.0; output.channels];
    for &pixel in &mask {
        let values = output.at(pixel as usize % output.width, pixel as usize / output.width);
        sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
    }
    let categories = sums[..kinds].iter().map(|sum| sum / mask.len() as f32).collect();
    let embedding = &sums[kinds + 2..];
    let length = embedding.iter().map(|value| value * value).sum::<f32>().sqrt().max(f32::MIN_POSITIVE);
    let embedding = embedding.iter().map(|value| value / length).collect();
    let color = |pixel: &u32| {
        let (row, column) = (*pixel as usize / output.width, *pixel as usize % output.width);
        let (x, y) = (column * picture.width / output.width, row * picture.height / output.height);
        let start = 3 * (y * picture.width + x);
        [picture.rgb[start], picture.rgb[start + 1], picture.rgb[start + 2]]
    };
    let histogram = Histogram::of(mask.iter().map(color));
    Some(Segment { categories, embedding, histogram, bounds, mask })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn segment(mask: Vec<u32>) -> Segment {
        let bounds = PixelBox::around(&mask, 16).expect("pixels");
        let (categories, histogram) = (vec![0.2, 0.7, 0.1], Histogram::default());
        Segment { mask, categories, embedding: vec![0.6, 0.8], histogram, bounds }
    }

    #[test]
    fn middle_prefers_position_to_size() {
        let large = segment((0..80).collect());
        let small = segment(vec![119, 120, 135, 136]);
        let mut seen = Segmentation {
            width: 16,
            height: 16,
            categories: vec![0; 256],
            confidences: vec![1.0; 256],
            segments: vec![large, small],
        };
        assert_eq!(seen.in_the_middle().map(|segment| segment.mask.len()), Some(4));
        seen.segments.clear();
        assert_eq!(seen.in_the_middle(), None);
    }

    #[test]
    fn segments_have_box_category_and_cosine() {
        let segment = segment(vec![18, 35, 36]);
        assert_eq!(segment.bounds, PixelBox { columns: [2, 4], rows: [1, 2] });
        assert_eq!(segment.category(), (1, 0.7));
        assert!((segment.cosine(&segment) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn distinct_colours_have_distinct_bins() {
        let bins: Vec<usize> = [
            [255, 0, 0],
            [255, 140, 0],
            [255, 255, 0],
            [0, 255, 0],
            [0, 0, 255],
            [255, 0, 255],
            [200, 90, 90],
            [255, 200, 200],
            [10, 0, 0],
            [90, 90, 90],
            [160, 160, 160],
            [250, 250, 250],
        ]
        .map(bin)
        .to_vec();
        let mut distinct = bins.clone();
        distinct.sort_unstable();
        distinct.dedup();
        assert_eq!(distinct.len(), bins.len(), "{bins:?}");
        assert!(bins.iter().all(|bin| *bin < BINS));
    }

    #[test]
    fn likeness_is_the_intersection() {
        let red = Histogram::of([[200, 0, 0]; 4].into_iter());
        let half = Histogram::of([[200, 0, 0], [200, 0, 0], [0, 0, 200], [0, 0, 200]].into_iter());
        assert_eq!((red.likeness(&red), red.likeness(&half), half.likeness(&red)), (1.0, 0.5, 0.5));
        assert_eq!(Histogram::of(std::iter::empty()).likeness(&red), 0.0);
    }

    /// Predicted centres for all pixels.
    fn told(width: usize, height: usize, middle: impl Fn(usize, usize) -> [f32; 2]) -> InstanceCenters {
        let places = (0..width * height).map(|pixel| middle(pixel % width, pixel / width)).collect();
        InstanceCenters { places, width, height }
    }

    #[test]
    fn adjacent_chairs_are_split() {
        let middles = told(40, 20, |x, _| if x < 20 { [9.5, 10.0] } else { [29.5, 10.0] });
        let all: Vec<u32> = (0..800).collect();
        let parts = middles.cut(&all);
        assert_eq!(parts.iter().map(Vec::len).collect::<Vec<_>>(), [400, 400]);
        assert!(parts.iter().any(|part| part.iter().all(|pixel| pixel % 40 < 20)));
    }

    #[test]
    fn noisy_centres_do_not_split_a_table() {
        let middles = told(40, 20, |x, y| [19.5 + (x % 3) as f32, 9.5 + (y % 3) as f32]);
        let all: Vec<u32> = (0..800).collect();
        assert_eq!(middles.cut(&all).len(), 1);
    }

    #[test]
    fn occluded_halves_are_merged() {
        let middles = told(40, 20, |_, _| [20.0, 10.0]);
        let half = |from: u32| (0..800).filter(|pixel| pixel % 40 / 20 == from).collect::<Vec<u32>>();
        let together = middles.together(vec![(3, half(0)), (3, half(1)), (4, vec![1])]);
        assert_eq!(together.iter().map(Vec::len).collect::<Vec<_>>(), [800, 1]);
    }

    #[test]
    fn exponentials_have_the_bits_of_libm() {
        for x in (0..=87.0_f32.to_bits()).step_by(1009).map(|bits| -f32::from_bits(bits)) {
            assert_eq!(exp_of_negative(x).to_bits(), libm::expf(x).to_bits(), "{x:e}");
        }
        let least = [-87.0, f32::NEG_INFINITY, f32::NAN].map(exp_of_negative);
        assert!(least[0] < 1.7e-38 && least == [least[0]; 3], "{least:?}");
    }

    #[test]
    fn floods_stay_within_their_category() {
        let categories = [1, 1, 2, 1, 2, 2];
        let mut taken = vec![false; 6];
        assert_eq!(flood(&categories, 3, 0, &mut taken).len(), 3);
        assert_eq!(flood(&categories, 3, 2, &mut taken).len(), 3);
        assert!(taken.into_iter().all(|taken| taken));
    }
}
