//! From pixels to instances: connected pixels with one category, split by predicted centres and merged across
//! occlusions.

use crate::feature_map::FeatureMap;
use crate::network::UNet;
use crate::picture::Picture;
use crate::segmentation::{Histogram, PixelBox, Segment, Segmentation};

/// Fewest pixels per instance.
const LEAST_PX: usize = 12;
/// Radius around predicted centres within an instance, map pixels.
const SPREAD_PX: usize = 5;
/// Least vote share for a centre in a stretch.
const LEAST_SHARE: f32 = 0.12;
/// Part limit per stretch.
const MOST_PARTS: usize = 16;
/// Distance between mean centres below which two stretches are a partly occluded instance, pixels.
const TOGETHER_PX: f32 = 4.0;

/// Converts the network's output to a segmentation.
pub(crate) fn seen(network: &mut UNet, picture: &Picture) -> Segmentation {
    let (kinds, building) = (network.info.categories.len(), network.info.building);
    let offset_px = network.info.offset_px;
    let output = network.output();
    let (categories, confidences) = likelihoods(output, kinds);
    let [width, height] = [output.width, output.height];
    let middles = InstanceCenters::of(output, kinds, offset_px);
    let mut groups = Vec::new();
    let mut taken: Vec<bool> = categories.iter().map(|category| usize::from(*category) < building).collect();
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
    let pixels = output.width * output.height;
    let (mut categories, mut confidences) = (Vec::with_capacity(pixels), Vec::with_capacity(pixels));
    let channels = output.channels;
    for row in 0..output.height {
        for pixel in output.row_mut(row).chunks_exact_mut(channels) {
            let logits = &mut pixel[..kinds];
            // The maximum is subtracted against overflow.
            let most = logits.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            let best = logits.iter().position(|logit| *logit == most).unwrap_or(0);
            logits.iter_mut().for_each(|logit| *logit = libm::expf(*logit - most));
            let sum: f32 = logits.iter().sum();
            logits.iter_mut().for_each(|logit| *logit /= sum);
            categories.push(best as u8);
            confidences.push(logits[best]);
        }
    }
    (categories, confidences)
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

    /// Returns the mean predicted centre.
    fn mean(&self, pixels: &[u32]) -> [f32; 2] {
        let places = pixels.iter().map(|pixel| self.places[*pixel as usize]);
        let [x, y] = places.fold([0.0; 2], |[x, y], place| [x + place[0], y + place[1]]);
        [x / pixels.len().max(1) as f32, y / pixels.len().max(1) as f32]
    }
}

fn apart2(a: [f32; 2], b: [f32; 2]) -> f32 {
    (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)
}

/// Builds a segment from pixels.
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
    fn floods_stay_within_their_category() {
        let categories = [1, 1, 2, 1, 2, 2];
        let mut taken = vec![false; 6];
        assert_eq!(flood(&categories, 3, 0, &mut taken).len(), 3);
        assert_eq!(flood(&categories, 3, 2, &mut taken).len(), 3);
        assert!(taken.into_iter().all(|taken| taken));
    }
}
