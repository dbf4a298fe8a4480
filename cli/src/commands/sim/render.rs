mod files;
mod poses;

use super::shot::{Hfov, Pose, Reach, Size, camera};
use super::{read, unusable};
use crate::commands::scene::Furnished;
use crate::output::say;
use avln_arena::cache::CacheFolder;
use avln_arena::{Failure, FailureKind};
use avln_lab::scene_renderer::Studio;
use avln_render::{Camera, DepthNoise, Noise, Renderer, RgbNoise};
use clap::Args;
use files::Files;
use poses::Wanted;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

/// The scene, where cameras stand in it, and what to write.
#[derive(Debug, Args)]
pub struct Options {
    /// The scene to take pictures of
    #[command(flatten)]
    scene: Furnished,
    /// The camera: x,y,z in metres, heading and pitch in degrees; heading 0 looks along -Z, left and up are positive
    #[arg(
        long,
        value_name = "X,Y,Z,HEADING[,PITCH]",
        allow_hyphen_values = true,
        required_unless_present = "poses"
    )]
    pose: Option<Pose>,
    /// Pixels in a row and rows, 1 to 4096 each
    #[arg(long, value_name = "WxH", default_value = "256x256", conflicts_with = "poses")]
    size: Size,
    /// Angle between left and right border, degrees from 0.2 to 179.8
    #[arg(long, value_name = "DEGREES", default_value = "90", conflicts_with = "poses")]
    hfov: Hfov,
    /// Write the colours, sRGB
    #[arg(
        long,
        value_name = "RGB.png",
        required_unless_present_any = ["depth", "ids", "poses"],
        conflicts_with = "poses"
    )]
    out: Option<PathBuf>,
    /// Write depth along the viewing direction: float32, height x width, metres, 0 where nothing is seen
    #[arg(long, value_name = "DEPTH.npy", conflicts_with = "poses")]
    depth: Option<PathBuf>,
    /// Write the numbers of instances: uint32, height x width, 0 where there is none
    #[arg(long, value_name = "IDS.npy", conflicts_with = "poses")]
    ids: Option<PathBuf>,
    /// Take one picture for each entry of a JSON array: {"position": [x,y,z], "rotation": [x,y,z,w]}, camera to world,
    /// -Z ahead; "hfov_deg", "width" and "height" are 90, 256 and 256 unless an entry says otherwise
    #[arg(long, value_name = "FILE.json", requires = "out_dir", conflicts_with = "pose")]
    poses: Option<PathBuf>,
    /// The folder for 000.rgb.png, 000.depth.npy, 000.ids.npy, 001.rgb.png and so on; made if it does not exist
    #[arg(long, value_name = "FOLDER", requires = "poses", conflicts_with = "pose")]
    out_dir: Option<PathBuf>,
    /// Depth is 0 beyond this distance, metres; unlimited unless given
    #[arg(long, value_name = "METRES")]
    max_depth: Option<Reach>,
    /// Noise of depth: none or redwood, a structured-light camera after Choi, Zhou and Koltun (2015)
    #[arg(long, value_name = "MODEL", default_value = "none", value_parser = depth_noise)]
    depth_noise: DepthNoise,
    /// Noise of colours: none or gaussian, a deviate of 51 grey levels
    #[arg(long, value_name = "MODEL", default_value = "none", value_parser = rgb_noise)]
    rgb_noise: RgbNoise,
    /// What noise is drawn with; each picture has its own by its number
    #[arg(long, value_name = "SEED", default_value_t = 0)]
    noise_seed: u64,
    /// Threads that take pictures, 1 to 256 [default: one for each core]; files do not depend on it
    #[arg(long, value_name = "COUNT", requires = "poses", conflicts_with = "pose", value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: Option<u16>,
}

/// A picture to take and where it goes.
struct Shot {
    camera: Camera,
    files: Files,
}

pub(super) fn run(data: &Path, options: &Options) -> Result<(), Failure> {
    let shots = options.shots()?;
    let studio = Studio::new(options.scene.load()?, CacheFolder::of_data(data));
    if let Some(folder) = &options.out_dir {
        std::fs::create_dir_all(folder).map_err(|error| files::unwritten(folder, error))?;
    }
    take(&studio.renderer, &shots, &options.noise(), options.threads())?;
    match (&options.out_dir, shots.as_slice()) {
        (Some(folder), _) => say!("{} pictures in {}", shots.len(), folder.display()),
        (None, shots) => {
            shots.iter().flat_map(|shot| shot.files.paths()).for_each(|path| say!("{}", path.display()))
        }
    }
    Ok(())
}

impl Options {
    fn shots(&self) -> Result<Vec<Shot>, Failure> {
        if let (Some(file), Some(folder)) = (&self.poses, &self.out_dir) {
            return self.many(file, folder);
        }
        let pose =
            self.pose.as_ref().ok_or_else(|| Failure::new(FailureKind::Internal, "no pose was given"))?;
        let files = Files { rgb: self.out.clone(), depth: self.depth.clone(), ids: self.ids.clone() };
        Ok(vec![Shot { camera: camera(pose, self.size, self.hfov, self.max_depth), files }])
    }

    /// The pictures of a file of poses.
    fn many(&self, file: &Path, folder: &Path) -> Result<Vec<Shot>, Failure> {
        let entries: Vec<Value> = read(file, "an array of poses")?;
        let digits = entries.len().saturating_sub(1).to_string().len().max(3);
        let shot = |(index, entry): (usize, &Value)| {
            let wanted = Wanted::from_json(entry).map_err(|why| {
                unusable(file, format!("pose {index}: {why}"), "the first pose of the array is pose 0")
            })?;
            Ok(Shot {
                camera: camera(&wanted.pose, wanted.size, wanted.hfov, self.max_depth),
                files: Files::numbered(folder, &format!("{index:0digits$}")),
            })
        };
        entries.iter().enumerate().map(shot).collect()
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

/// Takes and writes all pictures, and stops at the first that cannot be written.
fn take(renderer: &Renderer, shots: &[Shot], noise: &Noise, threads: usize) -> Result<(), Failure> {
    let next = AtomicUsize::new(0);
    let work = || {
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(shot) = shots.get(index) else { return Ok(()) };
            let mut frame = renderer.render(&shot.camera);
            noise.apply(&mut frame, index as u64, shot.camera.depth_max_m);
            if let Err(failure) = shot.files.write(frame) {
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

#[cfg(test)]
mod tests;
