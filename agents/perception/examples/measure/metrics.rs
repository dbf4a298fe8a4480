//! Accuracy of pixels, objects, masks and retrieval.

use avln_perception::{Segment, Segmentation};
use std::collections::{BTreeMap, BTreeSet};

/// Object size classes, map pixels.
pub(crate) const SIZES_PX: [usize; 2] = [25, 100];

/// Confusion matrices for pixels and objects: true category by row, prediction by column.
pub(crate) struct Confusion {
    kinds: usize,
    pixels: Vec<u64>,
    /// By [`SIZES_PX`].
    objects: [Vec<u64>; 2],
}

/// True labels at the map's resolution.
pub(crate) struct Truth {
    pub(crate) categories: Vec<u8>,
    pub(crate) instances: Vec<u16>,
}

impl Confusion {
    pub(crate) fn new(kinds: usize) -> Self {
        let table = || vec![0; kinds * kinds];
        Self { kinds, pixels: table(), objects: [table(), table()] }
    }

    pub(crate) fn add(&mut self, seen: &Segmentation, truth: &Truth, building: usize) {
        let mut objects = BTreeMap::<u16, Vec<usize>>::new();
        for (pixel, &category) in
            truth.categories.iter().enumerate().filter(|(_, c)| usize::from(**c) < self.kinds)
        {
            self.pixels[usize::from(category) * self.kinds + usize::from(seen.categories[pixel])] += 1;
            if truth.instances[pixel] > 0 && usize::from(category) >= building {
                objects.entry(truth.instances[pixel]).or_default().push(pixel);
            }
        }
        for mask in objects.values() {
            let is = usize::from(truth.categories[mask[0]]);
            let mut votes = vec![0.0; self.kinds];
            mask.iter()
                .for_each(|&p| votes[usize::from(seen.categories[p])] += f64::from(seen.confidences[p]));
            let told = (0..self.kinds).max_by(|&a, &b| votes[a].total_cmp(&votes[b])).unwrap_or(0);
            for (size, table) in SIZES_PX.iter().zip(&mut self.objects) {
                table[is * self.kinds + told] += u64::from(mask.len() >= *size);
            }
        }
    }

    /// Returns the intersection over union by category; `None` without pixels.
    pub(crate) fn ious(&self) -> Vec<Option<f64>> {
        let sum = |cells: &mut dyn Iterator<Item = usize>| cells.map(|cell| self.pixels[cell]).sum::<u64>();
        let iou = |kind: usize| {
            let are = sum(&mut (0..self.kinds).map(|told| kind * self.kinds + told));
            let told = sum(&mut (0..self.kinds).map(|is| is * self.kinds + kind));
            let both = self.pixels[kind * self.kinds + kind];
            (are > 0).then(|| both as f64 / (are + told - both) as f64)
        };
        (0..self.kinds).map(iou).collect()
    }

    pub(crate) fn pixel_accuracy(&self) -> f64 {
        right_share(&self.pixels, self.kinds)
    }

    /// Returns the object accuracy and count for a size class.
    pub(crate) fn object_accuracy(&self, size: usize) -> (f64, u64) {
        (right_share(&self.objects[size], self.kinds), self.objects[size].iter().sum())
    }

    /// Returns the predictions for a category's larger objects.
    pub(crate) fn objects(&self, is: usize) -> &[u64] {
        &self.objects[1][is * self.kinds..(is + 1) * self.kinds]
    }

    /// Returns the most frequent confusions (true, predicted, count, total) for categories of 20 objects.
    pub(crate) fn worst(&self, most: usize) -> Vec<(usize, usize, u64, u64)> {
        let mut pairs = Vec::new();
        for is in 0..self.kinds {
            let row = self.objects(is);
            let all: u64 = row.iter().sum();
            let wrong =
                row.iter().enumerate().filter(|(told, count)| *told != is && **count > 2 && all >= 20);
            pairs.extend(wrong.map(|(told, count)| (is, told, *count, all)));
        }
        pairs.sort_by(|a, b| (b.2 * a.3).cmp(&(a.2 * b.3)));
        pairs.truncate(most);
        pairs
    }
}

fn right_share(table: &[u64], kinds: usize) -> f64 {
    let right: u64 = (0..kinds).map(|kind| table[kind * kinds + kind]).sum();
    right as f64 / table.iter().sum::<u64>().max(1) as f64
}

/// Smaller instances are ignored, map pixels.
const LEAST_PX: usize = 50;
/// Fewest object pixels in a reference image, map pixels.
const REFERENCE_PX: usize = 150;
/// Least intersection over union for a found mask.
const FOUND_IOU: f64 = 0.5;

/// By category: confidence and correctness per predicted segment; number of instances.
pub(crate) struct Precision {
    told: Vec<Vec<(f32, bool)>>,
    there: Vec<usize>,
}

pub(crate) struct Sighting {
    pub(crate) view: usize,
    pub(crate) instance: u16,
    pub(crate) category: u8,
    pub(crate) segment: Segment,
}

fn masks(truth: &Truth, building: usize) -> BTreeMap<u16, Vec<u32>> {
    let mut masks = BTreeMap::<u16, Vec<u32>>::new();
    for (pixel, &instance) in truth.instances.iter().enumerate() {
        let category = truth.categories[pixel];
        if instance > 0 && usize::from(category) >= building && category < u8::MAX {
            masks.entry(instance).or_default().push(pixel as u32);
        }
    }
    masks
}

/// Returns the true instance with the largest overlap, and the intersection over union.
fn best(segment: &Segment, truth: &Truth, masks: &BTreeMap<u16, Vec<u32>>) -> Option<(u16, f64)> {
    let mut shared = BTreeMap::<u16, usize>::new();
    for &pixel in &segment.mask {
        *shared.entry(truth.instances[pixel as usize]).or_default() += 1;
    }
    let iou = |(instance, both): (u16, usize)| {
        let union = masks.get(&instance)?.len() + segment.mask.len() - both;
        Some((instance, both as f64 / union as f64))
    };
    shared.into_iter().filter_map(iou).max_by(|a, b| a.1.total_cmp(&b.1))
}

impl Precision {
    pub(crate) fn new(kinds: usize) -> Self {
        Self { told: vec![Vec::new(); kinds], there: vec![0; kinds] }
    }

    pub(crate) fn add(&mut self, seen: &Segmentation, truth: &Truth, building: usize) {
        let masks = masks(truth, building);
        let kind = |instance: &u16| usize::from(truth.categories[masks[instance][0] as usize]);
        for (instance, mask) in &masks {
            self.there[kind(instance)] += usize::from(mask.len() >= LEAST_PX);
        }
        let mut order: Vec<&Segment> = seen.segments.iter().collect();
        order.sort_by(|a, b| b.category().1.total_cmp(&a.category().1));
        let mut taken = BTreeSet::new();
        for segment in order {
            let (category, sure) = segment.category();
            let found = best(segment, truth, &masks)
                .filter(|(instance, iou)| *iou >= FOUND_IOU && kind(instance) == category);
            let small = found
                .map_or(segment.mask.len() < LEAST_PX, |(instance, _)| masks[&instance].len() < LEAST_PX);
            if !small {
                let right = found.is_some_and(|(instance, _)| taken.insert(instance));
                self.told[category].push((sure, right));
            }
        }
    }

    /// Returns the average precision (area under the monotone precision-recall curve) and instance count by category.
    pub(crate) fn average(&self) -> Vec<Option<(f64, usize)>> {
        let average = |(told, &there): (&Vec<(f32, bool)>, &usize)| {
            let mut told = told.clone();
            told.sort_by(|a, b| b.0.total_cmp(&a.0));
            let (mut right, mut curve) = (0, Vec::new());
            for (count, (_, is_right)) in told.iter().enumerate() {
                right += usize::from(*is_right);
                curve.push((right, right as f64 / (count + 1) as f64));
            }
            let (mut area, mut precision, mut after) = (0.0, 0.0_f64, right);
            for &(right, here) in curve.iter().rev() {
                area += (after - right) as f64 * precision;
                (precision, after) = (precision.max(here), right);
            }
            area += after as f64 * precision;
            (there > 0).then(|| (area / there as f64, there))
        };
        self.told.iter().zip(&self.there).map(average).collect()
    }
}

/// Returns the segments with a clear true instance.
pub(crate) fn sightings(view: usize, seen: &Segmentation, truth: &Truth, building: usize) -> Vec<Sighting> {
    let masks = masks(truth, building);
    let sighting = |segment: &Segment| {
        let (instance, iou) = best(segment, truth, &masks)?;
        let category = truth.categories[masks[&instance][0] as usize];
        let clear = iou >= FOUND_IOU && masks[&instance].len() >= LEAST_PX;
        clear.then(|| Sighting { view, instance, category, segment: segment.clone() })
    };
    seen.segments.iter().filter_map(sighting).collect()
}

/// Retrieval accuracy within a category: by embedding, by colours, by both, and by chance.
#[derive(Default)]
pub(crate) struct Retrieval {
    pub(crate) right: [usize; 3],
    pub(crate) chance: f64,
    pub(crate) all: usize,
}

impl Retrieval {
    /// Searches for the large instances in a reference image, seen without depth, among the house's other views.
    pub(crate) fn add(&mut self, references: &[Sighting], all: &[Sighting]) {
        for reference in references.iter().filter(|sighting| sighting.segment.mask.len() >= REFERENCE_PX) {
            let mut rivals = BTreeMap::<u16, Vec<&Segment>>::new();
            for other in all.iter().filter(|o| o.view != reference.view && o.category == reference.category) {
                rivals.entry(other.instance).or_default().push(&other.segment);
            }
            if rivals.len() < 2 || !rivals.contains_key(&reference.instance) {
                continue;
            }
            let own = &reference.segment;
            let measures: [&dyn Fn(&Segment) -> f32; 3] =
                [&|other| own.cosine(other), &|other| own.histogram.likeness(&other.histogram), &|other| {
                    own.cosine(other) + own.histogram.likeness(&other.histogram)
                }];
            for (right, measure) in self.right.iter_mut().zip(measures) {
                let likeness = |segments: &Vec<&Segment>| {
                    segments.iter().map(|segment| measure(segment)).sum::<f32>() / segments.len() as f32
                };
                let told = rivals.iter().max_by(|a, b| likeness(a.1).total_cmp(&likeness(b.1)));
                *right += usize::from(told.is_some_and(|(instance, _)| *instance == reference.instance));
            }
            self.chance += 1.0 / rivals.len() as f64;
            self.all += 1;
        }
    }
}
