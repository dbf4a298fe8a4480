//! `avln sim render`: pictures from given camera poses.

use crate::{
    commands::{
        scene::FurnishedSceneArgs,
        sim::{numbers, read, unusable},
    },
    output::{cannot_write, processors, say},
};
use avln_arena::{Failure, cache::CacheFolder};
use avln_geom::{Point3, UnitQuaternion, angle};
use avln_lab::npy;
use avln_lab::preview::{Picture, SceneRenderer};
use avln_render::{Camera, CameraImage, DepthNoise, Noise, Renderer, RgbNoise};
use clap::Args;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use std::{
    fmt::Display,
    fs::File,
    io::{BufWriter, Write},
    ops::RangeInclusive,
    path::{Path, PathBuf},
    str::FromStr,
    sync::atomic::{AtomicUsize, Ordering},
};

/// Picture sides, pixels.
pub(super) const SIDES_PX: RangeInclusive<u32> = 1..=4096;
/// Fields of view for a pinhole camera, degrees.
pub(super) const HFOV_DEG: RangeInclusive<f64> = 0.2..=179.8;
/// Largest camera coordinate, metres.
pub(super) const REACH_M: f64 = 1e6;

/// Picture size, pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PictureSize {
    pub(super) width: u32,
    pub(super) height: u32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Hfov {
    pub(super) degrees: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CameraPose {
    pub(super) eye: Point3<f32>,
    pub(super) world_from_camera: UnitQuaternion<f32>,
}

/// A distance above 0, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MaxDepth(pub(super) f32);

impl PictureSize {
    pub(super) fn new(width: u32, height: u32) -> Result<Self, String> {
        let (least, most) = (SIDES_PX.start(), SIDES_PX.end());
        for (name, side) in [("width", width), ("height", height)] {
            if !SIDES_PX.contains(&side) {
                return Err(format!("{name} {side}: pictures have {least} to {most} pixels along a side"));
            }
        }
        Ok(Self { width, height })
    }
}

impl FromStr for PictureSize {
    type Err = String;
    fn from_str(words: &str) -> Result<Self, String> {
        let sides = words.split_once(['x', 'X']);
        let sides = sides.and_then(|(width, height)| Some((width.parse().ok()?, height.parse().ok()?)));
        let (width, height) = sides.ok_or("write width x height, such as 256x256")?;
        Self::new(width, height)
    }
}

impl Hfov {
    pub(super) fn new(degrees: f64) -> Result<Self, String> {
        let (least, most) = (HFOV_DEG.start(), HFOV_DEG.end());
        match HFOV_DEG.contains(&degrees) {
            true => Ok(Self { degrees }),
            false => Err(format!("hfov {degrees}: view angles are from {least} to {most} degrees")),
        }
    }
}

impl FromStr for Hfov {
    type Err = String;
    fn from_str(word: &str) -> Result<Self, String> {
        Self::new(word.parse().map_err(|_| "write degrees, such as 90")?)
    }
}

impl FromStr for MaxDepth {
    type Err = String;
    fn from_str(word: &str) -> Result<Self, String> {
        let metres = word.parse().ok().filter(|metres: &f32| *metres > 0.0 && metres.is_finite());
        metres.map(Self).ok_or_else(|| "write metres above 0, such as 10".to_owned())
    }
}

impl FromStr for CameraPose {
    type Err = String;
    fn from_str(words: &str) -> Result<Self, String> {
        let values: Vec<f64> = numbers(words, &[','])?;
        let (place, heading_deg, pitch_deg) = match *values.as_slice() {
            [x, y, z, heading_deg] => ([x, y, z], heading_deg, 0.0),
            [x, y, z, heading_deg, pitch_deg] => ([x, y, z], heading_deg, pitch_deg),
            _ => {
                return Err("write x,y,z in metres, the heading and optionally the pitch in degrees".into());
            }
        };
        if let Some(value) = [heading_deg, pitch_deg].into_iter().find(|value| !value.is_finite()) {
            return Err(format!("'{value}' is not an angle; write degrees"));
        }
        let turned = angle::about_up(heading_deg.to_radians() as f32);
        let tipped = angle::about_right(pitch_deg.to_radians() as f32);
        Ok(Self { eye: eye(place)?, world_from_camera: turned * tipped })
    }
}

/// Returns the pinhole at `position`, metres.
pub(super) fn eye(position: [f64; 3]) -> Result<Point3<f32>, String> {
    match position.iter().find(|value| value.is_nan() || value.abs() > REACH_M) {
        Some(value) => Err(format!("position {value}: cameras must be within {REACH_M} m of the origin")),
        None => Ok(Point3::from(position.map(|value| value as f32))),
    }
}

/// Returns the camera. Depth is unlimited if `reach` is `None`.
pub(super) fn camera(pose: &CameraPose, size: PictureSize, hfov: Hfov, reach: Option<MaxDepth>) -> Camera {
    Camera {
        eye: pose.eye,
        world_from_camera: pose.world_from_camera,
        width: size.width,
        height: size.height,
        hfov_rad: hfov.degrees.to_radians() as f32,
        depth_max_m: reach.map_or(f32::MAX, |reach| reach.0),
    }
}

#[derive(Debug, Args)]
pub(crate) struct RenderArgs {
    #[command(flatten)]
    scene: FurnishedSceneArgs,
    /// Camera pose: x,y,z in metres, heading and pitch in degrees; heading 0 is -Z, left and up are positive
    #[arg(
        long,
        value_name = "X,Y,Z,HEADING[,PITCH]",
        allow_hyphen_values = true,
        required_unless_present = "poses"
    )]
    pose: Option<CameraPose>,
    /// Width and height in pixels, 1 to 4096
    #[arg(long, value_name = "WxH", default_value = "256x256", conflicts_with = "poses")]
    size: PictureSize,
    /// Horizontal field of view, degrees from 0.2 to 179.8
    #[arg(long, value_name = "DEGREES", default_value = "90", conflicts_with = "poses")]
    hfov: Hfov,
    /// File for colours, sRGB
    #[arg(
        long,
        value_name = "RGB.png",
        required_unless_present_any = ["depth", "ids", "poses"],
        conflicts_with = "poses"
    )]
    out: Option<PathBuf>,
    /// File for planar depth: float32, height x width, metres, 0 for no hit
    #[arg(long, value_name = "DEPTH.npy", conflicts_with = "poses")]
    depth: Option<PathBuf>,
    /// File for instance ids: uint32, height x width, 0 for no instance
    #[arg(long, value_name = "IDS.npy", conflicts_with = "poses")]
    ids: Option<PathBuf>,
    /// JSON array with an entry per picture: {"position": [x,y,z], "rotation": [x,y,z,w]}, camera to world,
    /// -Z forward; optional "hfov_deg", "width" and "height" (90, 256 and 256 by default)
    #[arg(long, value_name = "FILE.json", requires = "out_dir", conflicts_with = "pose")]
    poses: Option<PathBuf>,
    /// Folder for 000.rgb.png, 000.depth.npy, 000.ids.npy, 001.rgb.png and so on; created if missing
    #[arg(long, value_name = "FOLDER", requires = "poses", conflicts_with = "pose")]
    out_dir: Option<PathBuf>,
    /// Largest depth in metres, 0 beyond it; unlimited by default
    #[arg(long, value_name = "METRES")]
    max_depth: Option<MaxDepth>,
    /// Depth noise: none or redwood, a structured-light camera after Choi, Zhou and Koltun (2015)
    #[arg(long, value_name = "MODEL", default_value = "none", value_parser = depth_noise)]
    depth_noise: DepthNoise,
    /// Colour noise: none or gaussian, with a deviation of 51 grey levels
    #[arg(long, value_name = "MODEL", default_value = "none", value_parser = rgb_noise)]
    rgb_noise: RgbNoise,
    /// Seed for the noise, combined with the picture's index
    #[arg(long, value_name = "SEED", default_value_t = 0)]
    noise_seed: u64,
    /// Threads, 1 to 256 [default: one per core]; files do not depend on it
    #[arg(long, value_name = "COUNT", requires = "poses", conflicts_with = "pose", value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: Option<u16>,
}

struct Shot {
    camera: Camera,
    files: PictureFiles,
}

pub(super) fn run(data: &Path, args: &RenderArgs) -> Result<(), Failure> {
    let shots = args.shots()?;
    let scene_renderer = SceneRenderer::new(args.scene.load()?, CacheFolder::of_data(data));
    if let Some(folder) = &args.out_dir {
        std::fs::create_dir_all(folder).map_err(|error| cannot_write(folder, error))?;
    }
    let noise = Noise { depth: args.depth_noise, rgb: args.rgb_noise, seed: args.noise_seed };
    let threads = args.threads.map_or_else(processors, usize::from);
    take(&scene_renderer.renderer, &shots, &noise, threads)?;
    match (&args.out_dir, shots.as_slice()) {
        (Some(folder), _) => say!("{} pictures in {}", shots.len(), folder.display()),
        (None, shots) => {
            shots.iter().flat_map(|shot| shot.files.paths()).for_each(|path| say!("{}", path.display()))
        }
    }
    Ok(())
}

impl RenderArgs {
    fn shots(&self) -> Result<Vec<Shot>, Failure> {
        if let (Some(file), Some(folder)) = (&self.poses, &self.out_dir) {
            return self.many(file, folder);
        }
        let pose = self.pose.as_ref().ok_or_else(|| Failure::internal("no pose was given"))?;
        let files = PictureFiles { rgb: self.out.clone(), depth: self.depth.clone(), ids: self.ids.clone() };
        Ok(vec![Shot { camera: camera(pose, self.size, self.hfov, self.max_depth), files }])
    }

    fn many(&self, file: &Path, folder: &Path) -> Result<Vec<Shot>, Failure> {
        let entries: Vec<Value> = read(file, "an array of poses")?;
        let digits = entries.len().saturating_sub(1).to_string().len().max(3);
        let shot = |(index, entry): (usize, &Value)| {
            let wanted = PoseEntry::from_json(entry).map_err(|why| {
                unusable(file, format!("pose {index}: {why}"), "the first pose of the array is pose 0")
            })?;
            Ok(Shot {
                camera: camera(&wanted.pose, wanted.size, wanted.hfov, self.max_depth),
                files: PictureFiles::numbered(folder, &format!("{index:0digits$}")),
            })
        };
        entries.iter().enumerate().map(shot).collect()
    }
}

fn depth_noise(name: &str) -> Result<DepthNoise, String> {
    DepthNoise::from_name(name)
        .ok_or_else(|| format!("depth noise `{name}` does not exist; use none or redwood"))
}

fn rgb_noise(name: &str) -> Result<RgbNoise, String> {
    RgbNoise::from_name(name)
        .ok_or_else(|| format!("colour noise `{name}` does not exist; use none or gaussian"))
}

/// Renders and writes all pictures; stops at the first failure.
fn take(renderer: &Renderer, shots: &[Shot], noise: &Noise, threads: usize) -> Result<(), Failure> {
    let next = AtomicUsize::new(0);
    let work = || {
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(shot) = shots.get(index) else { return Ok(()) };
            let mut frame = renderer.render(&shot.camera);
            noise.apply(&mut frame, index as u64, shot.camera.depth_max_m);
            if let Err(failure) = shot.files.write(frame) {
                // Other threads stop after their present picture.
                next.store(shots.len(), Ordering::Relaxed);
                return Err(failure);
            }
        }
    };
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads.min(shots.len())).map(|_| scope.spawn(work)).collect();
        let broken = |_| Err(Failure::internal("a rendering thread panicked"));
        workers.into_iter().try_for_each(|worker| worker.join().unwrap_or_else(broken))
    })
}

struct PictureFiles {
    rgb: Option<PathBuf>,
    depth: Option<PathBuf>,
    ids: Option<PathBuf>,
}

impl PictureFiles {
    fn numbered(folder: &Path, number: &str) -> Self {
        let file = |ending: &str| Some(folder.join(format!("{number}.{ending}")));
        Self { rgb: file("rgb.png"), depth: file("depth.npy"), ids: file("ids.npy") }
    }

    fn paths(&self) -> impl Iterator<Item = &Path> {
        [&self.rgb, &self.depth, &self.ids].into_iter().filter_map(Option::as_deref)
    }

    fn write(&self, frame: CameraImage) -> Result<(), Failure> {
        let shape = [frame.height, frame.width];
        if let Some(path) = &self.depth {
            let depths = frame.depth.iter().map(|depth_m| depth_m.to_le_bytes());
            written(path, |out| npy::write(out, "<f4", shape, depths))?;
        }
        if let Some(path) = &self.ids {
            let ids = frame.instances.iter().map(|id| id.0.to_le_bytes());
            written(path, |out| npy::write(out, "<u4", shape, ids))?;
        }
        match &self.rgb {
            Some(path) => written(path, |out| Picture::of(String::new(), frame).write_png(out)),
            None => Ok(()),
        }
    }
}

fn written<E: Display>(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<File>) -> Result<(), E>,
) -> Result<(), Failure> {
    let mut out = BufWriter::new(File::create(path).map_err(|error| cannot_write(path, error))?);
    fill(&mut out).map_err(|error| cannot_write(path, error))?;
    out.flush().map_err(|error| cannot_write(path, error))
}

const FIELDS: [&str; 5] = ["position", "rotation", "hfov_deg", "width", "height"];

/// An entry in a pose file.
#[derive(Clone, Copy, Debug, PartialEq)]
struct PoseEntry {
    pose: CameraPose,
    size: PictureSize,
    hfov: Hfov,
}

impl PoseEntry {
    fn from_json(entry: &Value) -> Result<Self, String> {
        let fields = entry.as_object().ok_or("it is no object")?;
        if let Some(name) = fields.keys().find(|name| !FIELDS.contains(&name.as_str())) {
            return Err(format!("the field '{name}' is unknown; there are {}", FIELDS.join(", ")));
        }
        let position = required(fields, "position")?;
        let rotation = required(fields, "rotation")?;
        let world_from_camera = angle::rotation(rotation).ok_or_else(|| {
            format!("rotation {rotation:?} has no direction; write x, y, z, w of a unit quaternion")
        })?;
        let [width, height] = [optional(fields, "width", 256)?, optional(fields, "height", 256)?];
        Ok(Self {
            pose: CameraPose { eye: eye(position)?, world_from_camera },
            size: PictureSize::new(width, height)?,
            hfov: Hfov::new(optional(fields, "hfov_deg", 90.0)?)?,
        })
    }
}

fn required<T: DeserializeOwned>(fields: &Map<String, Value>, name: &str) -> Result<T, String> {
    let value = fields.get(name).ok_or_else(|| format!("the field '{name}' is missing"))?;
    T::deserialize(value).map_err(|error| format!("{name}: {error}"))
}

fn optional<T: DeserializeOwned>(fields: &Map<String, Value>, name: &str, otherwise: T) -> Result<T, String> {
    if fields.contains_key(name) { required(fields, name) } else { Ok(otherwise) }
}

#[cfg(test)]
mod tests;
