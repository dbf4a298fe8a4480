//! Scenes: information, export, import and pictures.

use super::scene_stats;
use crate::{
    data_option,
    output::{self, cannot_write, say},
};
use avln_arena::{Failure, cache::CacheFolder};
use avln_formats::{ImportOptions, ImportReport, LengthUnit, UpAxis, glb, hm3d, open};
use avln_houses::Pool;
use avln_lab::preview::{SceneRenderer, indoors, storeys};
use avln_scene::{Scene, Summary};
use clap::{Args, Subcommand, ValueEnum};
use serde_json::json;
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

#[derive(Debug, Subcommand)]
pub(crate) enum SceneCommand {
    /// Write a scene as a standard GLB file, for Blender or Habitat
    Export {
        #[command(flatten)]
        scene: SceneArgs,
        /// The file to write
        #[arg(value_name = "OUT.glb")]
        out: PathBuf,
        /// Also write instance labels, in files next to OUT.glb: hm3d, the layout that Habitat loads
        #[arg(long, value_name = "LAYOUT", hide_possible_values = true)]
        semantics: Option<Semantics>,
    },
    /// Convert a scan in any supported layout to a scene of the arena
    Import(ImportSceneArgs),
    /// Measure scenes next to real buildings: size, clutter and navigation complexity
    Stats(scene_stats::SceneStatsArgs),
    /// Print a scene's contents
    Info {
        #[command(flatten)]
        scene: SceneArgs,
    },
    #[command(arg(data_option()))]
    /// Draw all storeys from above, and views inside rooms
    Preview(PreviewArgs),
}

/// A scene from a file, or a procedural house.
#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
pub(crate) struct SceneArgs {
    /// Scene file or folder, in any layout that `avln scene import` reads
    #[arg(long, value_name = "PATH")]
    scene: Option<PathBuf>,
    /// Seed for a procedural house
    #[arg(long)]
    seed: Option<u64>,
}

/// A scene, with the furniture pool for a procedural house.
#[derive(Debug, Args)]
pub(crate) struct FurnishedSceneArgs {
    #[command(flatten)]
    scene: SceneArgs,
    /// Furniture pool for a procedural house: train, validation or test
    #[arg(long, default_value = "train", value_parser = pool)]
    pool: Pool,
}

impl FurnishedSceneArgs {
    pub(super) fn load(&self) -> Result<Scene, Failure> {
        open_or_build(self.scene.scene.as_deref(), self.scene.seed, self.pool)
    }

    /// Returns the arguments for a procedural house.
    #[cfg(test)]
    pub(super) fn grown(seed: u64) -> Self {
        Self { scene: SceneArgs { scene: None, seed: Some(seed) }, pool: Pool::default() }
    }
}

fn pool(name: &str) -> Result<Pool, String> {
    Pool::from_name(name).ok_or_else(|| format!("no pool is called `{name}`; use train, validation or test"))
}

pub(crate) fn run(data: &Path, command: SceneCommand) -> Result<(), Failure> {
    match command {
        SceneCommand::Export { scene, out, semantics } => export(&load(&scene)?, &out, semantics),
        SceneCommand::Import(args) => import(&args),
        SceneCommand::Stats(args) => scene_stats::run(&args),
        SceneCommand::Info { scene } => {
            print_info(&load(&scene)?);
            Ok(())
        }
        SceneCommand::Preview(args) => preview(data, &args),
    }
}

fn load(scene: &SceneArgs) -> Result<Scene, Failure> {
    open_or_build(scene.scene.as_deref(), scene.seed, Pool::default())
}

/// Opens a scene file, or builds the house of a seed with furniture from `pool`.
pub(super) fn open_or_build(path: Option<&Path>, seed: Option<u64>, pool: Pool) -> Result<Scene, Failure> {
    if let Some(path) = path {
        return open::open(path).map_err(Failure::scene);
    }
    let seed = seed.unwrap_or_default();
    let options = avln_houses::HouseOptions { pool, ..Default::default() };
    Ok(avln_houses::house(&format!("house-{seed}"), seed, &options))
}

fn print_info(scene: &Scene) {
    say!("scene      {}", scene.name);
    say!("digest     {}", avln_scene::digest::digest(scene));
    say!("triangles  {}", scene.mesh.triangles.len());
    if let Some(bounds) = scene.bounds() {
        let size = bounds.size();
        say!("size       {:.1} x {:.1} x {:.1} m", size.x, size.y, size.z);
    }
    say!("regions    {}", scene.regions.len());
    say!("objects    {}", scene.objects.len());
    for object in &scene.objects {
        let (at, words) = (object.bounds.center(), &object.attributes);
        let looks = [&words.size, &words.shape, &words.color, &words.material].map(String::as_str);
        let looks: Vec<_> = looks.into_iter().filter(|word| !word.is_empty()).collect();
        let (id, category, looks) = (object.id.0, &object.category, looks.join(" "));
        say!("  {id:>4} {category:<18} {:>7.2} {:>6.2} {:>7.2}  {looks}", at.x, at.y, at.z);
    }
}

/// Layout for exported instance labels.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum Semantics {
    /// As in HM3D: Z up, next to OUT.semantic.glb, OUT.semantic.txt and OUT.scene_dataset_config.json
    Hm3d,
}

fn export(scene: &Scene, out: &Path, semantics: Option<Semantics>) -> Result<(), Failure> {
    match semantics {
        None => write_file(out, &glb::export(scene))?,
        Some(Semantics::Hm3d) => export_hm3d(scene, out)?,
    }
    say!("{} triangles, {} instances", scene.mesh.triangles.len(), scene.objects.len());
    Ok(())
}

fn export_hm3d(scene: &Scene, out: &Path) -> Result<(), Failure> {
    let name = out.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let Some(stem) = name.strip_suffix(".glb").filter(|stem| !stem.is_empty()) else {
        let why = "does not end in .glb, which Habitat needs to find the labels";
        return Err(Failure::data(format!("{} {why}", out.display())));
    };
    let beside = |suffix: &str| -> PathBuf { out.with_file_name(format!("{stem}{suffix}")) };
    let files = hm3d::export(scene);
    write_file(out, &files.render)?;
    write_file(&beside(".semantic.glb"), &files.semantic)?;
    write_file(&beside(".semantic.txt"), files.table.as_bytes())?;
    write_file(&beside(".scene_dataset_config.json"), hm3d::dataset_config(name).as_bytes())
}

fn write_file(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    output::write_file(path, bytes)?;
    say!("{}: {} bytes", path.display(), bytes.len());
    Ok(())
}

#[derive(Debug, Args)]
pub(crate) struct ImportSceneArgs {
    /// Folder or file in the layout of HM3D, Matterport3D, Replica, Gibson, HSSD or ReplicaCAD, or plain glTF, OBJ or PLY
    #[arg(value_name = "SRC")]
    source: PathBuf,
    /// GLB file to write; all commands open it as a scene
    #[arg(long, value_name = "S.glb")]
    out: PathBuf,
    /// Up axis in SRC, if the layout does not define it or is wrong
    #[arg(long, value_enum)]
    up: Option<UpArg>,
    /// Unit in SRC, if it is not the metre
    #[arg(long, value_enum)]
    units: Option<UnitArg>,
    /// Print the report as JSON
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum UpArg {
    Y,
    Z,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum UnitArg {
    M,
    Cm,
    Mm,
}

fn import(args: &ImportSceneArgs) -> Result<(), Failure> {
    let mut report = ImportReport::default();
    let scene = open::open_as(&args.source, &import_options(args), &mut report).map_err(Failure::scene)?;
    let bytes = glb::export(&scene);
    output::write_file(&args.out, &bytes)?;
    // Reopened, so that the report describes the written contents.
    let label = args.out.display().to_string();
    let written = glb::from_bytes(&scene.name, &label, &bytes).map_err(Failure::internal)?;
    let summary = Summary::of(&written);
    if args.json {
        say!("{}", as_json(args, &report, &summary));
    } else {
        print_report(args, &report, &summary, bytes.len());
    }
    Ok(())
}

fn import_options(args: &ImportSceneArgs) -> ImportOptions {
    let up = args.up.map(|up| match up {
        UpArg::Y => UpAxis::Y,
        UpArg::Z => UpAxis::Z,
    });
    let unit = args.units.map(|unit| match unit {
        UnitArg::M => LengthUnit::Metre,
        UnitArg::Cm => LengthUnit::Centimetre,
        UnitArg::Mm => LengthUnit::Millimetre,
    });
    ImportOptions { up, unit }
}

fn as_json(args: &ImportSceneArgs, report: &ImportReport, summary: &Summary) -> serde_json::Value {
    json!({
        "source": args.source.display().to_string(),
        "out": args.out.display().to_string(),
        "layout": report.layout,
        "navmesh": report.navmesh.as_ref().map(|path| path.display().to_string()),
        "scene": summary,
        "warnings": report.warnings,
    })
}

fn print_report(args: &ImportSceneArgs, report: &ImportReport, summary: &Summary, bytes: usize) {
    let size: [f32; 3] = std::array::from_fn(|axis| summary.max_m[axis] - summary.min_m[axis]);
    say!("{}: {} bytes", args.out.display(), bytes);
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

/// Formats counts, such as `: bed 2, chair 5`.
fn listed(counts: &BTreeMap<String, usize>) -> String {
    let name = |label: &str| if label.is_empty() { "unnamed".to_owned() } else { label.to_owned() };
    let words: Vec<String> = counts.iter().map(|(label, count)| format!("{} {count}", name(label))).collect();
    if words.is_empty() { String::new() } else { format!(": {}", words.join(", ")) }
}

#[derive(Debug, Args)]
pub(crate) struct PreviewArgs {
    #[command(flatten)]
    scene: FurnishedSceneArgs,
    /// Folder for the pictures; created if missing
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Views inside rooms
    #[arg(long, default_value_t = 8)]
    views: usize,
}

fn preview(data: &Path, args: &PreviewArgs) -> Result<(), Failure> {
    let scene = args.scene.load()?;
    std::fs::create_dir_all(&args.out).map_err(|error| cannot_write(&args.out, error))?;
    let mut pictures = storeys(&scene);
    let name = scene.name.clone();
    pictures.extend(indoors(&SceneRenderer::new(scene, CacheFolder::of_data(data)), args.views));
    for picture in &pictures {
        let path = args.out.join(format!("{}.png", picture.name));
        let file = std::fs::File::create(&path).map_err(|error| cannot_write(&path, error))?;
        picture.write_png(std::io::BufWriter::new(file)).map_err(|error| cannot_write(&path, error))?;
    }
    let names: Vec<&str> = pictures.iter().map(|picture| picture.name.as_str()).collect();
    say!("{name}: {} pictures in {}: {}", pictures.len(), args.out.display(), names.join(" "));
    Ok(())
}
