//! Measures the network on images from unfamiliar houses, and prints the tables in docs/perception.md:
//!
//! ```sh
//! avln data dataset frames --measure --split val --houses 11 --views 60 --out FOLDER
//! cargo run --release -p avln-perception --example measure -- FOLDER CONFUSIONS.csv
//! ```
//!
//! The optional CSV file receives the confusion matrix by object.

use avln_perception::{Depth, Perception, Picture, Segment, Segmentation, VisionNetwork};
use frames::{Manifest, Record};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

mod frames;

/// Measurements with and without depth.
struct Measured {
    confusions: [Confusion; 2],
    precisions: [Precision; 2],
    retrieval: Retrieval,
}

fn main() {
    let Some(folder) = std::env::args().nth(1).map(PathBuf::from) else {
        eprintln!("name the folder that avln data dataset frames --measure has written");
        std::process::exit(2);
    };
    let manifest = frames::manifest(&folder);
    assert_eq!(manifest.purpose, "measurement", "measured is by what was not learnt from");
    let mut network = VisionNetwork::new().expect("the weights of the crate");
    let known = &network.info().categories;
    assert_eq!(&manifest.categories, known, "pictures and network have the same categories");
    let kinds = manifest.categories.len();
    let mut measured = Measured {
        confusions: [Confusion::new(kinds), Confusion::new(kinds)],
        precisions: [Precision::new(kinds), Precision::new(kinds)],
        retrieval: Retrieval::default(),
    };
    for house in &manifest.houses {
        let records = frames::house(&folder.join(&house.file), manifest.side_px);
        visit(&mut network, &records, manifest.side_px, &mut measured);
    }
    print(&manifest, &measured);
    if let Some(file) = std::env::args().nth(2) {
        std::fs::write(&file, confusions(&manifest, &measured)).expect(&file);
    }
}

/// Formats the confusion matrix: true categories by row, predictions by column.
fn confusions(manifest: &Manifest, measured: &Measured) -> String {
    let mut rows = vec![format!("seen by,category,{}", manifest.categories.join(","))];
    for (way, confusion) in ["depth and colours", "colours"].iter().zip(&measured.confusions) {
        for (kind, name) in manifest.categories.iter().enumerate() {
            let told = confusion.objects(kind);
            if told.iter().any(|count| *count > 0) {
                let counts: Vec<String> = told.iter().map(u64::to_string).collect();
                rows.push(format!("{way},{name},{}", counts.join(",")));
            }
        }
    }
    rows.join("\n") + "\n"
}

fn visit(network: &mut VisionNetwork, records: &[Record], side_px: usize, measured: &mut Measured) {
    let building = network.info().building;
    let mut sighted = [Vec::new(), Vec::new()];
    for (view, record) in records.iter().enumerate() {
        let picture = Picture { width: side_px, height: side_px, rgb: &record.rgb };
        let depth = Depth { metres: &record.depth_m };
        for (way, depth) in [Some((&depth, &record.camera)), None].into_iter().enumerate() {
            let seen = network.see(&picture, depth).expect("a picture");
            let truth = truth(&seen, record, side_px);
            measured.confusions[way].add(&seen, &truth, building);
            measured.precisions[way].add(&seen, &truth, building);
            sighted[way].extend(sightings(view, &seen, &truth, building));
        }
    }
    measured.retrieval.add(&sighted[1], &sighted[0]);
}

/// Samples the labels at the map's resolution.
fn truth(seen: &Segmentation, record: &Record, side_px: usize) -> Truth {
    let (x, y) = (side_px / seen.width, side_px / seen.height);
    let places = (0..seen.width * seen.height).map(|p| p / seen.width * y * side_px + p % seen.width * x);
    let places: Vec<usize> = places.collect();
    Truth {
        categories: places.iter().map(|&place| record.categories[place]).collect(),
        instances: places.iter().map(|&place| record.instances[place]).collect(),
    }
}

fn percent(share: f64) -> String {
    format!("{:.1}", 100.0 * share)
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let values: Vec<f64> = values.collect();
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

fn print(manifest: &Manifest, measured: &Measured) {
    let (houses, Manifest { split, recipe, views, .. }) = (manifest.houses.len(), manifest);
    println!("{} pictures of {houses} houses of split `{split}` of recipe `{recipe}`.\n", houses * views);
    let [full, rgb] = &measured.confusions;
    let [full_ap, rgb_ap] = &measured.precisions;
    let both =
        |measure: &dyn Fn(&Confusion) -> f64| [percent(measure(full)), percent(measure(rgb))].join(" | ");
    println!("| % | with depth | colours alone |\n|---|---|---|");
    println!("| pixels right | {} |", both(&Confusion::pixel_accuracy));
    println!("| mean IoU of categories | {} |", both(&|c| mean(c.ious().into_iter().flatten())));
    for (size, px) in SIZES_PX.iter().enumerate() {
        let label = format!("objects of {px} pixels and more right (n = {})", full.object_accuracy(size).1);
        println!("| {label} | {} |", both(&|c| c.object_accuracy(size).0));
    }
    let map = |p: &Precision| percent(mean(p.average().into_iter().flatten().map(|(average, _)| average)));
    println!("| mean AP of masks, IoU 0.5 | {} | {} |", map(full_ap), map(rgb_ap));
    print_retrieval(&measured.retrieval);
    print_categories(manifest, measured);
    println!("\n| object | taken for | % | n |\n|---|---|---|---|");
    for (is, told, count, all) in full.worst(15) {
        let name = |kind: usize| &manifest.categories[kind];
        println!("| {} | {} | {} | {all} |", name(is), name(told), percent(count as f64 / all as f64));
    }
}

fn print_retrieval(retrieval: &Retrieval) {
    let share = |right: usize| percent(right as f64 / retrieval.all.max(1) as f64);
    println!("\n| instance found again from a picture | % right (n = {}) |\n|---|---|", retrieval.all);
    for (label, right) in ["embedding", "colours", "both"].into_iter().zip(retrieval.right) {
        println!("| by {label} | {} |", share(right));
    }
    println!("| by chance | {} |", percent(retrieval.chance / retrieval.all.max(1) as f64));
}

fn print_categories(manifest: &Manifest, measured: &Measured) {
    let [full, rgb] = [&measured.confusions[0], &measured.confusions[1]].map(Confusion::ious);
    let [full_ap, rgb_ap] = [&measured.precisions[0], &measured.precisions[1]].map(Precision::average);
    println!("\n| category | IoU | IoU, colours | AP | AP, colours | instances |\n|---|---|---|---|---|---|");
    let cell = |value: Option<f64>| value.map_or("–".to_owned(), percent);
    for (kind, name) in manifest.categories.iter().enumerate() {
        let average = |all: &[Option<(f64, usize)>]| cell(all[kind].map(|(average, _)| average));
        let there = full_ap[kind].map_or("–".to_owned(), |(_, there)| there.to_string());
        let (iou, iou_rgb) = (cell(full[kind]), cell(rgb[kind]));
        println!("| {name} | {iou} | {iou_rgb} | {} | {} | {there} |", average(&full_ap), average(&rgb_ap));
    }
}

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
