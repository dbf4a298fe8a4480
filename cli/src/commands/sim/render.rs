//! `avln sim render`: pictures from given camera poses.

use super::camera::{CameraPose, Hfov, MaxDepth, PictureSize, camera, eye};
use super::{read, unusable};
use crate::commands::scene::FurnishedSceneArgs;
use crate::output::say;
use avln_arena::{Failure, FailureKind, cache::CacheFolder};
use avln_geom::angle;
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
    path::{Path, PathBuf},
    sync::atomic::{AtomicUsize, Ordering},
};

/// Arguments of `avln sim render`.
#[derive(Debug, Args)]
pub struct RenderArgs {
    /// Scene
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
    /// JSON array with one entry per picture: {"position": [x,y,z], "rotation": [x,y,z,w]}, camera to world, -Z forward; optional
    /// "hfov_deg", "width" and "height" (90, 256 and 256 by default)
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
    /// Seed of the noise, combined with the picture's index
    #[arg(long, value_name = "SEED", default_value_t = 0)]
    noise_seed: u64,
    /// Threads, 1 to 256 [default: one per core]; files do not depend on it
    #[arg(long, value_name = "COUNT", requires = "poses", conflicts_with = "pose", value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: Option<u16>,
}

/// A picture and its files.
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
    take(&scene_renderer.renderer, &shots, &args.noise(), args.threads())?;
    match (&args.out_dir, shots.as_slice()) {
        (Some(folder), _) => say!("{} pictures in {}", shots.len(), folder.display()),
        (None, shots) => shots
            .iter()
            .flat_map(|camera_args| camera_args.files.paths())
            .for_each(|path| say!("{}", path.display())),
    }
    Ok(())
}

impl RenderArgs {
    fn shots(&self) -> Result<Vec<Shot>, Failure> {
        if let (Some(file), Some(folder)) = (&self.poses, &self.out_dir) {
            return self.many(file, folder);
        }
        let pose =
            self.pose.as_ref().ok_or_else(|| Failure::new(FailureKind::Internal, "no pose was given"))?;
        let files = PictureFiles { rgb: self.out.clone(), depth: self.depth.clone(), ids: self.ids.clone() };
        Ok(vec![Shot { camera: camera(pose, self.size, self.hfov, self.max_depth), files }])
    }

    /// Reads the pictures of a file of poses.
    fn many(&self, file: &Path, folder: &Path) -> Result<Vec<Shot>, Failure> {
        let entries: Vec<Value> = read(file, "an array of poses")?;
        let digits = entries.len().saturating_sub(1).to_string().len().max(3);
        let camera_args = |(index, entry): (usize, &Value)| {
            let wanted = PoseEntry::from_json(entry).map_err(|why| {
                unusable(file, format!("pose {index}: {why}"), "the first pose of the array is pose 0")
            })?;
            Ok(Shot {
                camera: camera(&wanted.pose, wanted.size, wanted.hfov, self.max_depth),
                files: PictureFiles::numbered(folder, &format!("{index:0digits$}")),
            })
        };
        entries.iter().enumerate().map(camera_args).collect()
    }

    fn noise(&self) -> Noise {
        Noise { depth: self.depth_noise, rgb: self.rgb_noise, seed: self.noise_seed }
    }

    fn threads(&self) -> usize {
        let cores = || std::thread::available_parallelism().map_or(1, usize::from);
        self.threads.map_or_else(cores, usize::from)
    }
}

fn depth_noise(name: &str) -> Result<DepthNoise, String> {
    DepthNoise::from_name(name)
        .ok_or_else(|| format!("no noise of depth is called `{name}`; use none or redwood"))
}

fn rgb_noise(name: &str) -> Result<RgbNoise, String> {
    RgbNoise::from_name(name)
        .ok_or_else(|| format!("no noise of colours is called `{name}`; use none or gaussian"))
}

/// Renders and writes all pictures; stops at the first failure.
fn take(renderer: &Renderer, shots: &[Shot], noise: &Noise, threads: usize) -> Result<(), Failure> {
    let next = AtomicUsize::new(0);
    let work = || {
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(camera_args) = shots.get(index) else { return Ok(()) };
            let mut frame = renderer.render(&camera_args.camera);
            noise.apply(&mut frame, index as u64, camera_args.camera.depth_max_m);
            if let Err(failure) = camera_args.files.write(frame) {
                next.store(shots.len(), Ordering::Relaxed);
                return Err(failure);
            }
        }
    };
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads.min(shots.len())).map(|_| scope.spawn(work)).collect();
        let broken = |_| Err(Failure::new(FailureKind::Internal, "a thread that takes pictures broke"));
        workers.into_iter().try_for_each(|worker| worker.join().unwrap_or_else(broken))
    })
}

/// Output files of a picture.
struct PictureFiles {
    rgb: Option<PathBuf>,
    depth: Option<PathBuf>,
    ids: Option<PathBuf>,
}

impl PictureFiles {
    /// All files of picture `number`.
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

/// Creates a file and fills it.
fn written<E: Display>(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<File>) -> Result<(), E>,
) -> Result<(), Failure> {
    let mut out = BufWriter::new(File::create(path).map_err(|error| cannot_write(path, error))?);
    fill(&mut out).map_err(|error| cannot_write(path, error))?;
    out.flush().map_err(|error| cannot_write(path, error))
}

fn cannot_write(path: &Path, error: impl Display) -> Failure {
    Failure::new(FailureKind::Data, format!("cannot write {}: {error}", path.display()))
        .hinted("choose an existing folder with write access")
}

const FIELDS: [&str; 5] = ["position", "rotation", "hfov_deg", "width", "height"];

/// An entry of a file of poses.
#[derive(Clone, Copy, Debug, PartialEq)]
struct PoseEntry {
    pose: CameraPose,
    size: PictureSize,
    hfov: Hfov,
}

impl PoseEntry {
    /// Parses an entry.
    ///
    /// # Errors
    /// If a field is missing, unknown or invalid; the message names it.
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
