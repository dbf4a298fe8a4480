//! Measures of scenes, next to real buildings.

use crate::output::say;
use avln_arena::Failure;
use avln_formats::open;
use avln_scene::Scene;
use avln_scene::stats::{Census, MATTERPORT_PER_BUILDING, census, divergence_from_matterport};
use avln_world::stats::{WalkStats, walk_stats};
use clap::Args;
use serde_json::json;
use std::{collections::BTreeMap, path::PathBuf};

#[derive(Debug, Args)]
pub(crate) struct SceneStatsArgs {
    /// Scene file or folder (can be repeated)
    #[arg(long, value_name = "PATH")]
    scene: Vec<PathBuf>,
    /// Seed for a procedural house (can be repeated)
    #[arg(long)]
    seed: Vec<u64>,
    /// Procedural houses with seeds from A to B, excluding B
    #[arg(long, value_name = "A..B", value_parser = seeds)]
    seeds: Option<std::ops::Range<u64>>,
    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,
    /// Fail if a number is outside the band
    #[arg(long)]
    check: bool,
}

struct MeasuredScene {
    name: String,
    census: Census,
    walk: WalkStats,
}

/// A number with band and values from real buildings.
struct BandedNumber {
    name: &'static str,
    value: f64,
    band: [f64; 2],
    real: &'static str,
}

pub(crate) fn run(args: &SceneStatsArgs) -> Result<(), Failure> {
    let seeds = args.seed.iter().copied().chain(args.seeds.clone().into_iter().flatten());
    let houses = seeds.map(|seed| {
        Ok(avln_houses::house(&format!("house-{seed}"), seed, &avln_houses::HouseOptions::default()))
    });
    let files = args.scene.iter().map(|path| open::open(path).map_err(Failure::scene));
    let mut all = Vec::new();
    for scene in files.chain(houses) {
        let measured = measure(&scene?)?;
        if !args.json {
            print(&measured);
        }
        all.push(measured);
    }
    if all.is_empty() {
        let hint = "name one with --scene, --seed or --seeds";
        return Err(Failure::scene("there is no scene to measure").hinted(hint));
    }
    if args.json {
        let scenes: Vec<_> = all.iter().map(as_json).collect();
        say!("{}", json!({ "scenes": scenes, "summary": summary(&all) }));
    } else if all.len() > 1 {
        print_summary(&all);
    }
    verdict(args, &all)
}

fn seeds(text: &str) -> Result<std::ops::Range<u64>, String> {
    let parsed =
        text.split_once("..").and_then(|(a, b)| Some(a.trim().parse().ok()?..b.trim().parse().ok()?));
    parsed.filter(|range: &std::ops::Range<u64>| !range.is_empty()).ok_or_else(|| {
        format!(
            "'{text}' is not a range of seeds; use the first seed and the one after the last, such as 0..100"
        )
    })
}

fn measure(scene: &Scene) -> Result<MeasuredScene, Failure> {
    let walk = walk_stats(scene, 0).map_err(Failure::scene)?;
    Ok(MeasuredScene { name: scene.name.clone(), census: census(scene), walk })
}

/// Returns a scene's numbers. Real values: Matterport3D (90 buildings), HM3D paper, Gibson (572 spaces).
fn lines(measured: &MeasuredScene) -> Vec<BandedNumber> {
    let MeasuredScene { census, walk, .. } = measured;
    let most = f64::INFINITY;
    let per_100_m2 = 100.0 * census.objects as f64 / walk.floor_m2.max(1.0);
    let line = |name, value, band, real| BandedNumber { name, value, band, real };
    vec![
        line("rooms", census.rooms as f64, [6.0, 24.0], "MP3D 24.5, Gibson 15.5, HM3D 14.4"),
        line("storeys", census.storeys as f64, [1.0, 2.0], "MP3D 2.0, Gibson 2.8"),
        line("navigable m2", walk.navigable_m2, [25.0, 400.0], "HM3D 113, HSSD 37 to 132 (r 0.3)"),
        line("floor m2", walk.floor_m2, [50.0, 700.0], "HM3D 366, Gibson 360 (median)"),
        line("complexity beyond 2 m", walk.complexity, [2.0, 10.0], "Gibson 2.7 (median, its own measure)"),
        line("complexity of all pairs", walk.complexity_of_all, [2.0, most], "HM3D 13.3 (so measured)"),
        line("clutter", walk.clutter, [1.0, 4.0], "HM3D 3.9, Gibson 1.38 (median)"),
        line("objects", census.objects as f64, [20.0, most], "HM3D 660, MP3D 565"),
        line("objects per 100 m2", per_100_m2, [25.0, most], "HM3D 180"),
        line("largest island", walk.largest_island, [0.95, 1.0], "-"),
        line("rooms reached (r 0.25)", walk.rooms_reached, [1.0, 1.0], "-"),
        divergence_line(divergence_from_matterport(&census.categories)),
    ]
}

fn divergence_line(value: f64) -> BandedNumber {
    BandedNumber { name: "categories KL", value, band: [0.0, 1.0], real: "0 is Matterport3D" }
}

fn inside(line: &BandedNumber) -> bool {
    (line.band[0]..=line.band[1]).contains(&line.value)
}

fn print(measured: &MeasuredScene) {
    say!("{}", measured.name);
    lines(measured).iter().for_each(print_line);
}

fn print_line(line: &BandedNumber) {
    let band = match line.band[1].is_finite() {
        true => format!("{} to {}", line.band[0], line.band[1]),
        false => format!("{} or more", line.band[0]),
    };
    let mark = if inside(line) { "ok" } else { "OUT" };
    say!("  {:<24} {:>8.2}  {:<4} {:<14} {}", line.name, line.value, mark, band, line.real);
}

fn as_json(measured: &MeasuredScene) -> serde_json::Value {
    let numbers: BTreeMap<&str, serde_json::Value> = lines(measured)
        .iter()
        .map(|line| (line.name, json!({ "value": line.value, "band": line.band, "inside": inside(line) })))
        .collect();
    json!({ "scene": measured.name, "numbers": numbers, "categories": measured.census.categories })
}

/// Returns medians of all numbers and category counts.
fn summary(all: &[MeasuredScene]) -> serde_json::Value {
    let medians: BTreeMap<&str, f64> = medians(all).iter().map(|line| (line.name, line.value)).collect();
    let categories = together(all);
    let divergence = divergence_from_matterport(&categories);
    json!({ "median": medians, "categories": categories, "divergence_from_matterport": divergence })
}

fn medians(all: &[MeasuredScene]) -> Vec<BandedNumber> {
    let every: Vec<Vec<BandedNumber>> = all.iter().map(lines).collect();
    let median = |(index, line): (usize, BandedNumber)| {
        let mut values: Vec<f64> = every.iter().map(|lines| lines[index].value).collect();
        values.sort_by(f64::total_cmp);
        BandedNumber { value: values[values.len() / 2], ..line }
    };
    all.first().map(lines).unwrap_or_default().into_iter().enumerate().map(median).collect()
}

fn together(all: &[MeasuredScene]) -> BTreeMap<String, usize> {
    let mut categories = BTreeMap::new();
    for (category, count) in all.iter().flat_map(|measured| &measured.census.categories) {
        *categories.entry(category.clone()).or_default() += count;
    }
    categories
}

fn print_summary(all: &[MeasuredScene]) {
    say!("{} scenes, medians", all.len());
    medians(all).iter().for_each(print_line);
    let categories = together(all);
    say!("instances per scene, and per building of Matterport3D");
    for (category, real) in MATTERPORT_PER_BUILDING {
        let count = categories.get(category).copied().unwrap_or(0) as f64 / all.len() as f64;
        say!("  {category:<24} {count:>8.2}  {real:>6.1}");
    }
    let value = divergence_from_matterport(&categories);
    print_line(&divergence_line(value));
}

fn verdict(args: &SceneStatsArgs, all: &[MeasuredScene]) -> Result<(), Failure> {
    let outside = |measured: &MeasuredScene| -> Vec<String> {
        let out = lines(measured).into_iter().filter(|line| !inside(line));
        out.map(|line| format!("{}: {} is {:.2}", measured.name, line.name, line.value)).collect()
    };
    let out: Vec<String> = all.iter().flat_map(outside).collect();
    if !args.check || out.is_empty() {
        return Ok(());
    }
    let (count, first) = (out.len(), &out[0]);
    Err(Failure::scene(format!("{count} numbers are outside their bands, the first one: {first}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seed_ranges_are_parsed_and_empty_rejected() {
        assert_eq!(seeds("3..7"), Ok(3..7));
        for text in ["7..3", "4", "a..b", "5..5", ""] {
            assert!(seeds(text).unwrap_err().contains("0..100"), "{text}");
        }
    }

    #[test]
    fn houses_are_measured_and_lie_in_all_bands() {
        let scene = avln_houses::house("one", 1, &avln_houses::HouseOptions::small());
        let measured = measure(&scene).expect("a house to walk in");
        let measured = [measured];
        for line in lines(&measured[0]).iter().chain(&medians(&measured)) {
            assert!(inside(line), "{}: {}", line.name, line.value);
        }
    }
}
