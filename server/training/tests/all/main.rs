//! Training environments on small houses.

mod episodes;
mod senses;
mod sources;

use avln_episode::Rules;
use avln_referee::Audio;
use avln_training::{
    Curriculum, Env, EnvOptions, EpisodeSource, Goals, Layout, OwnedArray, OwnedRow, RowSource, SourceChoice,
    SourceOptions, StepFlags, TrainingEpisode,
};
use avln_world::{Bank, ClipPool};
use std::sync::{Arc, Mutex, PoisonError};

/// The entries of a row by name.
trait Entries {
    fn entry(&self, layout: &Layout, name: &str) -> &OwnedArray;

    /// Returns the number of an entry with a single integer.
    fn integer(&self, layout: &Layout, name: &str) -> i64 {
        let OwnedArray::I64(values) = self.entry(layout, name) else { panic!("{name} has another type") };
        values[0]
    }

    /// Returns the bytes of an entry.
    fn bytes(&self, layout: &Layout, name: &str) -> Vec<u8> {
        let OwnedArray::U8(values) = self.entry(layout, name) else { panic!("{name} has another type") };
        values.clone()
    }

    /// Returns the 32-bit integers of an entry.
    fn shorts(&self, layout: &Layout, name: &str) -> Vec<i32> {
        let OwnedArray::I32(values) = self.entry(layout, name) else { panic!("{name} has another type") };
        values.clone()
    }

    /// Returns the floats of an entry.
    fn floats(&self, layout: &Layout, name: &str) -> Vec<f32> {
        let OwnedArray::F32(values) = self.entry(layout, name) else { panic!("{name} has another type") };
        values.clone()
    }
}

impl Entries for OwnedRow {
    fn entry(&self, layout: &Layout, name: &str) -> &OwnedArray {
        &self.arrays[layout.arrays().iter().position(|spec| spec.name == name).expect("an entry")]
    }
}

/// Small houses with one storey.
fn small_houses(seed: u64) -> SourceOptions {
    let curriculum =
        Curriculum { goals: [1, 2], distance_m: [1.0, 100.0], rooms: Some([3, 4]), storeys: Some([1, 1]) };
    let source = SourceOptions::new(SourceChoice::Recipe("paper".to_owned()), seed);
    SourceOptions { curriculum, scenes: 1, ..source }
}

/// Small images, with privileged information.
fn small_options() -> EnvOptions {
    EnvOptions { privileged: true, goal_side: 16, ..EnvOptions::paper(64) }
}

fn audio() -> Audio {
    Audio::from(Bank::of(ClipPool::Train))
}

/// A source with its seed and order.
struct SharedSource {
    key: (u64, Goals),
    source: Arc<EpisodeSource>,
    /// Keeps the house loaded.
    _episode: TrainingEpisode,
}

static SOURCES: Mutex<Vec<SharedSource>> = Mutex::new(Vec::new());

/// Returns the source of small houses with a seed. Tests share it, because the preparation of a house takes a second.
fn shared_source(seed: u64, goals: Goals) -> Arc<EpisodeSource> {
    let mut sources = SOURCES.lock().unwrap_or_else(PoisonError::into_inner);
    let key = (seed, goals);
    if let Some(shared) = sources.iter().find(|shared| shared.key == key) {
        return Arc::clone(&shared.source);
    }
    let options = SourceOptions { goals, ..small_houses(seed) };
    let source = Arc::new(EpisodeSource::open(&options).expect("a source"));
    let episode = source.episode(0, 0, &Rules::paper()).expect("an episode");
    sources.push(SharedSource { key, source: Arc::clone(&source), _episode: episode });
    source
}

/// Returns an environment of the house that most tests share.
fn shared_env(options: EnvOptions, number: u64) -> Env {
    Env::new(number, shared_source(1, Goals::Drawn), options, audio()).expect("an environment")
}

/// Follows the teacher to the episode's end; returns the last flags and the sum of rewards.
fn follow_teacher(env: &mut Env, row: &mut OwnedRow) -> (StepFlags, f64) {
    let layout = env.layout().clone();
    let mut sum = 0.0;
    loop {
        let action = row.integer(&layout, "expert");
        let flags = env.step(action, &mut row.row()).expect("a step");
        sum += flags.reward;
        if flags.is_over() {
            return (flags, sum);
        }
    }
}
