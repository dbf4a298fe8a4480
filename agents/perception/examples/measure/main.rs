//! Measures the network on images from unfamiliar houses, and prints the tables in docs/perception.md:
//!
//! ```sh
//! avln data dataset frames --measure --split val --houses 11 --views 60 --out FOLDER
//! cargo run --release -p avln-perception --example measure -- FOLDER CONFUSIONS.csv
//! ```
//!
//! The optional CSV file receives the confusion matrix by object.

mod frames;
mod metrics;

use avln_perception::{Depth, Perception, Picture, Segmentation, VisionNetwork};
use frames::{Manifest, Record};
use metrics::{Confusion, Precision, Retrieval, SIZES_PX, Truth, sightings};
use std::path::PathBuf;

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
