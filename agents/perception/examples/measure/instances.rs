//! Instances: whether their masks are found (average precision), and whether they are known again.

use super::pixels::Truth;
use avln_perception::{Seen, Segment};
use std::collections::BTreeMap;

/// Smaller instances may be found or not, pixels of the map.
const LEAST_PX: usize = 50;
/// A reference picture shows its object this large, at least, pixels of the map.
const REFERENCE_PX: usize = 150;
/// Intersection over union from which a mask is found.
const FOUND_IOU: f64 = 0.5;

/// For each category: how sure each told segment was and whether it was right; how many instances there are.
pub(crate) struct Precision {
    told: Vec<Vec<(f32, bool)>>,
    there: Vec<usize>,
}

/// A segment that shows an instance of a house.
pub(crate) struct Sighting {
    pub(crate) view: usize,
    pub(crate) instance: u16,
    pub(crate) category: u8,
    pub(crate) segment: Segment,
}

/// Masks of the true instances of a picture.
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

/// The true instance that a segment overlaps most, and by how much.
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

    pub(crate) fn add(&mut self, seen: &Seen, truth: &Truth, building: usize) {
        let masks = masks(truth, building);
        let kind = |instance: &u16| usize::from(truth.categories[masks[instance][0] as usize]);
        for (instance, mask) in &masks {
            self.there[kind(instance)] += usize::from(mask.len() >= LEAST_PX);
        }
        let mut order: Vec<&Segment> = seen.segments.iter().collect();
        order.sort_by(|a, b| b.category().1.total_cmp(&a.category().1));
        let mut taken = std::collections::BTreeSet::new();
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

    /// Area under the curve of precision over recall, made monotone, of each category with instances; and their numbers.
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

/// The segments of a picture that show true instances.
pub(crate) fn sightings(view: usize, seen: &Seen, truth: &Truth, building: usize) -> Vec<Sighting> {
    let masks = masks(truth, building);
    let sighting = |segment: &Segment| {
        let (instance, iou) = best(segment, truth, &masks)?;
        let category = truth.categories[masks[&instance][0] as usize];
        let clear = iou >= FOUND_IOU && masks[&instance].len() >= LEAST_PX;
        clear.then(|| Sighting { view, instance, category, segment: segment.clone() })
    };
    seen.segments.iter().filter_map(sighting).collect()
}

/// How often an instance of a house is known again among those of its category: by embedding, by colours, by both, and by chance.
#[derive(Default)]
pub(crate) struct Retrieval {
    pub(crate) right: [usize; 3],
    pub(crate) chance: f64,
    pub(crate) all: usize,
}

impl Retrieval {
    /// Looks for each instance that a reference picture, seen without depth, shows large among the other sightings of its house.
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
