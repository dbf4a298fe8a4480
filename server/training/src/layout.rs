//! Arrays of an observation and of its training information.

#[expect(unused_imports, reason = "documentation")]
use crate::{AutoReset, CheapSenses};
use crate::{EnvOptions, RowSource, TrainingError};
use avln_episode::{Feedback, GoalCue, Mission, Observation, Order, RgbImage};

/// Most goals per mission; missing goals are zeros.
pub(crate) const MAX_GOALS: usize = 4;
/// Cells per side of the map `top_down`.
pub(crate) const MAP_SIDE: usize = 512;
/// Cell side of this map, metres.
pub(crate) const MAP_CELL_M: f32 = 0.1;
/// UTF-8 bytes per goal text, truncated or padded with zeros.
const GOAL_TEXT_BYTES: usize = 256;

/// Number type of an array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArrayKind {
    /// Bytes.
    U8,
    /// 32-bit integers.
    I32,
    /// 64-bit integers.
    I64,
    /// 32-bit floats.
    F32,
}

/// An array per environment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ArraySpec {
    /// Key.
    pub name: &'static str,
    /// Number type.
    pub kind: ArrayKind,
    /// Shape; empty for a number.
    pub shape: Vec<usize>,
    /// True for privileged information, which belongs to `info`.
    pub is_info: bool,
}

impl ArraySpec {
    /// Returns the element count.
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// Returns true for an array without elements.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// The arrays of one environment, in order. The observation has the keys of `avln.gym` and the [`CheapSenses`]; privileged information follows:
///
/// | key | type and shape | content |
/// | --- | --- | --- |
/// | `distance_m` | `f32 [4]` | walking distance to each success region, metres; -1: unreachable, or no such goal |
/// | `bearing_rad` | `f32 [4]` | direction of the shortest way, radians from straight ahead, left positive; 0 without a way |
/// | `target_position` | `f32 [4, 3]` | target centre, metres, relative to the start pose |
/// | `is_open` | `u8 [4]` | 1: neither found nor skipped |
/// | `is_in_region` | `u8 [4]` | 1: a claim here matches the target |
/// | `sounding` | i64 | sounding source: a goal, or the goal count plus a distractor's index; -1: silence |
/// | `routed` | i64 | goal of the teachers and of the reward `progress`; -1: none |
/// | `expert` | i64 | action of the teacher |
/// | `expert_submit` | u8 | 1: a claim here is right; Stop for the last open goal, otherwise Submit |
/// | `success` | f32 | 1: all goals are found |
/// | `spl` | f32 | SPL, if the episode ended now |
/// | `instance` | `i32 [height, width]` | instance number per pixel of the view; 0: none |
/// | `semantic` | `u8 [height, width]` | category per pixel: its number in mpcat40, 1 to 40; 0: another category, or none |
/// | `target_instance` | `i32 [4]` | instance number of each target; 0: no such goal |
/// | `top_down` | `u8 [512, 512]` | storey of the agent in cells of 0.1 m around the start: 0 unknown, 1 walkable, 2 obstacle |
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    arrays: Vec<ArraySpec>,
}

impl Layout {
    /// Returns the arrays for these options.
    pub fn new(options: &EnvOptions) -> Self {
        use ArrayKind::{F32, I32, I64, U8};
        let mut arrays = Vec::new();
        let mut add = |is_info: bool, is_wanted: bool, name: &'static str, kind, shape: &[usize]| {
            if is_wanted {
                arrays.push(ArraySpec { name, kind, shape: shape.to_vec(), is_info });
            }
        };
        let [width, height] = [options.sensors.width as usize, options.sensors.height as usize];
        let side = options.goal_side as usize;
        add(false, options.sensors.rgb, "rgb", U8, &[height, width, 3]);
        add(false, options.sensors.depth, "depth", F32, &[height, width]);
        add(false, options.sensors.audio, "audio", F32, &[2, options.rules.audio_samples as usize]);
        add(false, true, "pose", F32, &[4]);
        add(false, true, "remaining", I32, &[2]);
        add(false, true, "feedback", I64, &[]);
        add(false, true, "order", I64, &[]);
        add(false, true, "goal_modality", I64, &[MAX_GOALS]);
        add(false, options.goal_cues, "goal_text", U8, &[MAX_GOALS, GOAL_TEXT_BYTES]);
        add(false, options.goal_cues, "goal_image", U8, &[MAX_GOALS, side, side, 3]);
        options.cheap.arrays().for_each(|(name, kind, shape)| add(false, true, name, kind, &shape));
        let is_privileged = options.privileged;
        add(true, is_privileged, "distance_m", F32, &[MAX_GOALS]);
        add(true, is_privileged, "bearing_rad", F32, &[MAX_GOALS]);
        add(true, is_privileged, "target_position", F32, &[MAX_GOALS, 3]);
        add(true, is_privileged, "is_open", U8, &[MAX_GOALS]);
        add(true, is_privileged, "is_in_region", U8, &[MAX_GOALS]);
        add(true, is_privileged, "sounding", I64, &[]);
        add(true, is_privileged, "routed", I64, &[]);
        add(true, is_privileged, "expert", I64, &[]);
        add(true, is_privileged, "expert_submit", U8, &[]);
        add(true, is_privileged, "success", F32, &[]);
        add(true, is_privileged, "spl", F32, &[]);
        add(true, options.ids, "instance", I32, &[height, width]);
        add(true, options.ids, "semantic", U8, &[height, width]);
        add(true, options.ids, "target_instance", I32, &[MAX_GOALS]);
        add(true, options.top_down, "top_down", U8, &[MAP_SIDE; 2]);
        Self { arrays }
    }

    /// Returns the arrays.
    pub fn arrays(&self) -> &[ArraySpec] {
        &self.arrays
    }
}

/// Memory of an array.
#[derive(Debug)]
#[expect(missing_docs, reason = "as ArrayKind")]
pub enum RowArray<'a> {
    U8(&'a mut [u8]),
    I32(&'a mut [i32]),
    I64(&'a mut [i64]),
    F32(&'a mut [f32]),
}

/// Memory of one environment, with an array per entry of the [`Layout`].
#[derive(Debug)]
pub struct Row<'a> {
    /// The arrays, in the layout's order.
    pub arrays: Vec<RowArray<'a>>,
}

impl Row<'_> {
    /// Checks the arrays' types and lengths.
    pub(crate) fn check(&self, layout: &Layout) -> Result<(), TrainingError> {
        let fits = |(array, spec): (&RowArray, &ArraySpec)| {
            let (kind, length) = match array {
                RowArray::U8(values) => (ArrayKind::U8, values.len()),
                RowArray::I32(values) => (ArrayKind::I32, values.len()),
                RowArray::I64(values) => (ArrayKind::I64, values.len()),
                RowArray::F32(values) => (ArrayKind::F32, values.len()),
            };
            (kind, length) == (spec.kind, spec.len())
        };
        let all =
            self.arrays.len() == layout.arrays.len() && self.arrays.iter().zip(&layout.arrays).all(fits);
        if all { Ok(()) } else { Err(TrainingError::Shared("a row does not fit its layout".to_owned())) }
    }

    /// Returns an array; `None` if the layout lacks it.
    pub(crate) fn array<T: RowNumber>(&mut self, layout: &Layout, name: &str) -> Option<&mut [T]> {
        T::slice(&mut self.arrays[layout.arrays.iter().position(|spec| spec.name == name)?])
    }

    /// Copies values into an array, if the layout has it.
    pub(crate) fn put<T: RowNumber>(&mut self, layout: &Layout, name: &str, values: &[T]) {
        if let Some(array) = self.array(layout, name) {
            array.iter_mut().zip(values).for_each(|(to, from)| *to = *from);
        }
    }

    /// Writes the entries that change in every step.
    pub(crate) fn put_observation(&mut self, layout: &Layout, seen: &Observation) {
        self.put(layout, "rgb", seen.rgb.as_deref().unwrap_or_default());
        self.put(layout, "depth", seen.depth.as_deref().unwrap_or_default());
        self.put(layout, "audio", seen.audio.as_deref().unwrap_or_default());
        let [x, y, z] = seen.pose.position.coords.into();
        self.put(layout, "pose", &[x, y, z, seen.pose.heading_rad]);
        self.put(layout, "remaining", &[seen.remaining_steps as i32, seen.remaining_submits as i32]);
        // Numbers in `avln.Feedback`.
        let feedback: i64 = match seen.feedback {
            Feedback::None => 0,
            Feedback::Accepted => 1,
            Feedback::Verdict(true) => 2,
            Feedback::Verdict(false) => 3,
        };
        self.put(layout, "feedback", &[feedback]);
    }

    /// Writes the entries that are constant during an episode: also in every step, because callers alternate between rows.
    pub(crate) fn put_mission(&mut self, layout: &Layout, mission: &MissionArrays) {
        self.put(layout, "order", &[mission.order]);
        self.put(layout, "goal_modality", &mission.modalities);
        self.put(layout, "goal_text", &mission.texts);
        self.put(layout, "goal_image", &mission.images);
    }
}

/// An array with its values.
#[derive(Clone, Debug, PartialEq)]
#[expect(missing_docs, reason = "as ArrayKind")]
pub enum OwnedArray {
    U8(Vec<u8>),
    I32(Vec<i32>),
    I64(Vec<i64>),
    F32(Vec<f32>),
}

/// Memory of one environment, for callers without arrays of their own.
#[derive(Clone, Debug, PartialEq)]
pub struct OwnedRow {
    /// The arrays, in the layout's order.
    pub arrays: Vec<OwnedArray>,
    /// The arrays of the last episode's end, under [`AutoReset::SameStep`].
    pub finals: Option<Vec<OwnedArray>>,
}

impl OwnedRow {
    /// Returns a row of zeros.
    pub fn new(layout: &Layout) -> Self {
        let array = |spec: &ArraySpec| match spec.kind {
            ArrayKind::U8 => OwnedArray::U8(vec![0; spec.len()]),
            ArrayKind::I32 => OwnedArray::I32(vec![0; spec.len()]),
            ArrayKind::I64 => OwnedArray::I64(vec![0; spec.len()]),
            ArrayKind::F32 => OwnedArray::F32(vec![0.0; spec.len()]),
        };
        Self { arrays: layout.arrays.iter().map(array).collect(), finals: None }
    }
}

impl RowSource for OwnedRow {
    fn row(&mut self) -> Row<'_> {
        let arrays = self.arrays.iter_mut().map(|array| match array {
            OwnedArray::U8(values) => RowArray::U8(values),
            OwnedArray::I32(values) => RowArray::I32(values),
            OwnedArray::I64(values) => RowArray::I64(values),
            OwnedArray::F32(values) => RowArray::F32(values),
        });
        Row { arrays: arrays.collect() }
    }

    fn keep_final(&mut self) {
        self.finals = Some(self.arrays.clone());
    }
}

/// A number type of rows.
pub(crate) trait RowNumber: Copy {
    /// Returns an array's memory; `None` for an array of another type.
    fn slice<'a>(array: &'a mut RowArray<'_>) -> Option<&'a mut [Self]>;
}

macro_rules! row_numbers {
    ($($number:ty: $kind:ident),*) => {$(
        impl RowNumber for $number {
            fn slice<'a>(array: &'a mut RowArray<'_>) -> Option<&'a mut [Self]> {
                match array {
                    RowArray::$kind(values) => Some(values),
                    _ => None,
                }
            }
        }
    )*};
}

row_numbers!(u8: U8, i32: I32, i64: I64, f32: F32);

/// The entries of a mission.
pub(crate) struct MissionArrays {
    order: i64,
    modalities: [i64; MAX_GOALS],
    texts: Vec<u8>,
    images: Vec<u8>,
}

impl MissionArrays {
    /// Converts a mission, with images of `side × side` pixels.
    pub(crate) fn new(mission: &Mission, side: usize) -> Self {
        let mut modalities = [0; MAX_GOALS];
        let mut texts = vec![0; MAX_GOALS * GOAL_TEXT_BYTES];
        let mut images = vec![0; MAX_GOALS * side * side * 3];
        for (index, goal) in mission.goals.iter().take(MAX_GOALS).enumerate() {
            modalities[index] = 1 + goal.modality() as i64;
            match goal {
                GoalCue::Category(text) | GoalCue::Description(text) => {
                    let to = &mut texts[index * GOAL_TEXT_BYTES..][..GOAL_TEXT_BYTES];
                    to.iter_mut().zip(text.bytes()).for_each(|(to, byte)| *to = byte);
                }
                GoalCue::Image(image) => {
                    scale(image, &mut images[index * side * side * 3..][..side * side * 3], side);
                }
            }
        }
        Self { order: i64::from(mission.order == Order::Ordered), modalities, texts, images }
    }
}

/// Scales an image to `side × side` pixels by the nearest pixels, as the Python client does.
fn scale(image: &RgbImage, to: &mut [u8], side: usize) {
    let place = |index: usize, count: u32| ((index as f64 + 0.5) * f64::from(count) / side as f64) as usize;
    for (index, pixel) in to.chunks_exact_mut(3).enumerate() {
        let (row, column) = (place(index / side, image.height), place(index % side, image.width));
        let from = 3 * (row * image.width as usize + column);
        pixel.copy_from_slice(&image.pixels[from..from + 3]);
    }
}
