//! Brings a scan into the arena: reads whatever layout it comes in and writes the scene that the arena plays in.

use crate::output::say;
use avln_arena::{Failure, FailureKind};
use avln_formats::{ImportOptions, ImportReport, glb, open};
use avln_scene::{Scene, Summary};
use clap::{Args, ValueEnum};
use serde_json::json;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Options of `avln scene import`.
#[derive(Debug, Args)]
pub struct Options {
    /// A folder or file in the layout of HM3D, Matterport3D, Replica, Gibson, HSSD or ReplicaCAD, or plain glTF, OBJ or PLY
    #[arg(value_name = "SRC")]
    source: PathBuf,
    /// The GLB file to write; it opens wherever a scene is asked for
    #[arg(long, value_name = "S.glb")]
    out: PathBuf,
    /// The axis of SRC that points up, where the layout leaves it open or says it wrong
    #[arg(long, value_enum)]
    up: Option<UpAxis>,
    /// The unit of SRC, where it is not the metre
    #[arg(long, value_enum)]
    units: Option<LengthUnit>,
    /// Print the report as JSON
    #[arg(long)]
    json: bool,
}

/// An axis that may point up.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum UpAxis {
    Y,
    Z,
}

/// A unit of length.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum LengthUnit {
    M,
    Cm,
    Mm,
}

/// Imports a scene and reports what it holds.
///
/// # Errors
/// When the source cannot be read as a scene or the file cannot be written.
pub fn run(options: &Options) -> Result<(), Failure> {
    let mut report = ImportReport::default();
    let scene = open::open_as(&options.source, &reading(options), &mut report)
        .map_err(|error| Failure::new(FailureKind::Scene, error))?;
    let bytes = glb::export(&scene);
    std::fs::write(&options.out, &bytes).map_err(|error| {
        Failure::new(FailureKind::Data, format!("cannot write {}: {error}", options.out.display()))
            .hinted("name a file in a folder that exists and has room")
    })?;
    let cached = reopened(&scene, &bytes, options)?;
    let summary = Summary::of(&cached);
    if options.json {
        say!("{}", as_json(options, &report, &summary));
    } else {
        print(options, &report, &summary, bytes.len());
    }
    Ok(())
}

fn reading(options: &Options) -> ImportOptions {
    let up = options.up.map(|up| match up {
        UpAxis::Y => avln_formats::UpAxis::Y,
        UpAxis::Z => avln_formats::UpAxis::Z,
    });
    let unit = options.units.map(|unit| match unit {
        LengthUnit::M => avln_formats::LengthUnit::Metre,
        LengthUnit::Cm => avln_formats::LengthUnit::Centimetre,
        LengthUnit::Mm => avln_formats::LengthUnit::Millimetre,
    });
    ImportOptions { up, unit }
}

/// The scene as the written file gives it, which the report describes.
fn reopened(scene: &Scene, bytes: &[u8], options: &Options) -> Result<Scene, Failure> {
    let label = options.out.display().to_string();
    glb::from_bytes(&scene.name, &label, bytes).map_err(|error| Failure::new(FailureKind::Internal, error))
}

fn as_json(options: &Options, report: &ImportReport, summary: &Summary) -> serde_json::Value {
    json!({
        "source": options.source.display().to_string(),
        "out": options.out.display().to_string(),
        "layout": report.layout,
        "navmesh": report.navmesh.as_ref().map(|path| path.display().to_string()),
        "scene": summary,
        "warnings": report.warnings,
    })
}

fn print(options: &Options, report: &ImportReport, summary: &Summary, bytes: usize) {
    let size: [f32; 3] = std::array::from_fn(|axis| summary.max_m[axis] - summary.min_m[axis]);
    say!("{}: {} bytes", options.out.display(), bytes);
    say!("layout     {}", report.layout);
    if let Some(navmesh) = &report.navmesh {
        say!("navmesh    {} (the arena builds its own)", navmesh.display());
    }
    say!("scene      {}", summary.name);
    say!("digest     {}", summary.digest);
    say!("triangles  {}, {} of them labelled", summary.triangles, summary.labelled_triangles);
    say!("materials  {}", summary.materials);
    say!("textures   {}, {:.1} million texels", summary.textures, summary.texels as f64 / 1.0e6);
    say!("extent     {:.2} x {:.2} x {:.2} m, floor at {:.2} m", size[0], size[1], size[2], summary.min_m[1]);
    say!("storeys    {}", summary.storeys);
    say!("regions    {}{}", summary.regions, listed(&summary.regions_by_label));
    say!("instances  {}{}", summary.instances, listed(&summary.instances_by_category));
    for warning in &report.warnings {
        say!("warning    {warning}");
    }
}

/// Counts in words: `: bed 2, chair 5`.
fn listed(counts: &BTreeMap<String, usize>) -> String {
    let name = |label: &str| if label.is_empty() { "unnamed".to_owned() } else { label.to_owned() };
    let words: Vec<String> = counts.iter().map(|(label, count)| format!("{} {count}", name(label))).collect();
    if words.is_empty() { String::new() } else { format!(": {}", words.join(", ")) }
}
