//! Memory of rows in tests, and options for small houses.

use avln_referee::Audio;
use avln_training::{
    ArrayKind, Curriculum, Env, EnvOptions, EpisodeSource, Layout, Row, RowArray, RowSource, SourceChoice,
    SourceOptions, StepFlags,
};
use avln_world::{Bank, ClipPool};

/// An array with its values.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Values {
    U8(Vec<u8>),
    I32(Vec<i32>),
    I64(Vec<i64>),
    F32(Vec<f32>),
}

/// A row that owns its memory.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct OwnRow {
    pub(crate) values: Vec<Values>,
    pub(crate) finals: Option<Vec<Values>>,
}

impl OwnRow {
    pub(crate) fn new(layout: &Layout) -> Self {
        let values = layout.arrays().iter().map(|spec| match spec.kind {
            ArrayKind::U8 => Values::U8(vec![0; spec.len()]),
            ArrayKind::I32 => Values::I32(vec![0; spec.len()]),
            ArrayKind::I64 => Values::I64(vec![0; spec.len()]),
            ArrayKind::F32 => Values::F32(vec![0.0; spec.len()]),
        });
        Self { values: values.collect(), finals: None }
    }

    fn entry(&self, layout: &Layout, name: &str) -> &Values {
        &self.values[layout.arrays().iter().position(|spec| spec.name == name).expect("an entry")]
    }

    /// Returns the number of an entry with a single integer.
    pub(crate) fn integer(&self, layout: &Layout, name: &str) -> i64 {
        let Values::I64(values) = self.entry(layout, name) else { panic!("{name} has another type") };
        values[0]
    }

    /// Returns the bytes of an entry.
    pub(crate) fn bytes(&self, layout: &Layout, name: &str) -> Vec<u8> {
        let Values::U8(values) = self.entry(layout, name) else { panic!("{name} has another type") };
        values.clone()
    }

    /// Returns the 32-bit integers of an entry.
    pub(crate) fn shorts(&self, layout: &Layout, name: &str) -> Vec<i32> {
        let Values::I32(values) = self.entry(layout, name) else { panic!("{name} has another type") };
        values.clone()
    }

    /// Returns the floats of an entry.
    pub(crate) fn floats(&self, layout: &Layout, name: &str) -> Vec<f32> {
        let Values::F32(values) = self.entry(layout, name) else { panic!("{name} has another type") };
        values.clone()
    }
}

impl RowSource for OwnRow {
    fn row(&mut self) -> Row<'_> {
        let arrays = self.values.iter_mut().map(|values| match values {
            Values::U8(values) => RowArray::U8(values),
            Values::I32(values) => RowArray::I32(values),
            Values::I64(values) => RowArray::I64(values),
            Values::F32(values) => RowArray::F32(values),
        });
        Row { arrays: arrays.collect() }
    }

    fn keep_final(&mut self) {
        self.finals = Some(self.values.clone());
    }
}

/// Small houses with one storey.
pub(crate) fn small_houses(seed: u64) -> SourceOptions {
    let curriculum =
        Curriculum { goals: [1, 2], distance_m: [1.0, 100.0], rooms: Some([3, 4]), storeys: Some([1, 1]) };
    let source = SourceOptions::new(SourceChoice::Recipe("paper".to_owned()), seed);
    SourceOptions { curriculum, scenes: 1, ..source }
}

/// Small images, with privileged information.
pub(crate) fn small_options() -> EnvOptions {
    EnvOptions { privileged: true, goal_side: 16, ..EnvOptions::paper(64) }
}

pub(crate) fn audio() -> Audio {
    Audio::from(Bank::of(ClipPool::Train))
}

pub(crate) fn env(number: u64) -> Env {
    let source = EpisodeSource::open(&small_houses(1)).expect("a source");
    Env::new(number, source, small_options(), audio()).expect("an environment")
}

/// Follows the teacher to the episode's end; returns the last flags and the sum of rewards.
pub(crate) fn follow_teacher(env: &mut Env, row: &mut OwnRow) -> (StepFlags, f64) {
    let layout = env.layout().clone();
    let mut sum = 0.0;
    loop {
        let action = row.integer(&layout, "expert") as u32;
        let flags = env.step(action, &mut row.row()).expect("a step");
        sum += flags.reward;
        if flags.is_over() {
            return (flags, sum);
        }
    }
}
