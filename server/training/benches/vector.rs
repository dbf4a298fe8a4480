//! Steps per second of training environments in process, as `avln-py bench` measures them from Python:
//! `cargo bench -p avln-training -- THREADS [cheap]`. `cheap` has `lidar`, `ears` and `map` instead of images and sound.

use avln_episode::Sensors;
use avln_geom::Rng;
use avln_referee::Audio;
use avln_training::{
    CheapSenses, EnvOptions, EpisodeSource, OwnedRow, RewardRule, SourceChoice, SourceOptions, VectorEnv,
};
use avln_world::{Bank, ClipPool};
use std::env;
use std::time::{Duration, Instant};

const ENVS: usize = 64;
/// Four turns: every source has sounded once, and is prepared.
const WARM_UP_STEPS: usize = 100;
const MEASURED: Duration = Duration::from_secs(20);
/// Longest time of a step, with the preparation of a house.
const PATIENCE: Duration = Duration::from_secs(600);
/// Number of actions without Submit and Stop.
const WALKS: usize = 3;

/// Environments with a row each.
struct Walk {
    vector: VectorEnv<OwnedRow>,
    rows: Vec<OwnedRow>,
    rng: Rng,
}

impl Walk {
    fn new(threads: usize, is_cheap: bool) -> Self {
        let source = SourceOptions::new(SourceChoice::Recipe("paper".to_owned()), 0);
        let source = EpisodeSource::open(&source).expect("a recipe of this project");
        let all = Sensors::all(128, 128);
        let sensors = Sensors { rgb: !is_cheap, depth: !is_cheap, audio: !is_cheap, ..all };
        let cheap = CheapSenses { lidar: is_cheap, ears: is_cheap, map: is_cheap };
        let reward = RewardRule::None;
        let options = EnvOptions { sensors, cheap, reward, goal_cues: false, ..EnvOptions::paper(128) };
        let audio = Audio::from(Bank::of(ClipPool::Train));
        let vector = VectorEnv::new(ENVS, threads, source, options, audio).expect("environments");
        let rows = (0..ENVS).map(|_| OwnedRow::new(vector.layout())).collect();
        Self { vector, rows, rng: Rng::new(0) }
    }

    fn reset(&mut self) {
        for (env, row) in self.rows.drain(..).enumerate() {
            self.vector.send_reset(env, row).expect("an environment");
        }
        self.wait();
    }

    fn step(&mut self) {
        for (env, row) in self.rows.drain(..).enumerate() {
            self.vector.send_step(env, self.rng.below(WALKS) as i64, row).expect("an environment");
        }
        self.wait();
    }

    fn wait(&mut self) {
        for finished in self.vector.recv(ENVS, PATIENCE) {
            finished.flags.expect("a step");
            self.rows.push(finished.row);
        }
        assert_eq!(self.rows.len(), ENVS, "an environment needs more than {PATIENCE:?}");
    }
}

fn main() {
    // Cargo adds an option.
    let threads = env::args().find_map(|argument| argument.parse().ok()).unwrap_or(2);
    let is_cheap = env::args().any(|argument| argument == "cheap");
    let mut walk = Walk::new(threads, is_cheap);
    let begun = Instant::now();
    walk.reset();
    let senses = if is_cheap { "lidar, ears and map" } else { "RGB-D 128 x 128 and sound" };
    println!("{ENVS} environments with {senses}, {threads} threads");
    println!("first reset: {:.1} s", begun.elapsed().as_secs_f64());
    (0..WARM_UP_STEPS).for_each(|_| walk.step());
    let (begun, mut steps) = (Instant::now(), 0);
    while begun.elapsed() < MEASURED {
        walk.step();
        steps += ENVS;
    }
    println!("{:.0} steps/s", steps as f64 / begun.elapsed().as_secs_f64());
}
