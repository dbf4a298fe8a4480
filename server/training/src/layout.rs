//! Arrays of an observation and of its training information.

#[expect(unused_imports, reason = "documentation")]
use crate::CheapSenses;
use crate::{EnvOptions, TrainingError};
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
/// | `is_open` | `u8 [4]` | 1: not found yet |
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
        let mut layout = Self { arrays: Vec::new() };
        let [width, height] = [options.sensors.width as usize, options.sensors.height as usize];
        let samples = options.rules.audio_samples as usize;
        let side = options.goal_side as usize;
        let cues = options.goal_cues;
        layout.add(options.sensors.rgb, "rgb", ArrayKind::U8, &[height, width, 3]);
        layout.add(options.sensors.depth, "depth", ArrayKind::F32, &[height, width]);
        layout.add(options.sensors.audio, "audio", ArrayKind::F32, &[2, samples]);
        layout.add(true, "pose", ArrayKind::F32, &[4]);
        layout.add(true, "remaining", ArrayKind::I32, &[2]);
        layout.add(true, "feedback", ArrayKind::I64, &[]);
        layout.add(true, "order", ArrayKind::I64, &[]);
        layout.add(true, "goal_modality", ArrayKind::I64, &[MAX_GOALS]);
        layout.add(cues, "goal_text", ArrayKind::U8, &[MAX_GOALS, GOAL_TEXT_BYTES]);
        layout.add(cues, "goal_image", ArrayKind::U8, &[MAX_GOALS, side, side, 3]);
        options.cheap.arrays().for_each(|(name, kind, shape)| layout.add(true, name, kind, &shape));
        if options.privileged {
            layout.add_privileged();
        }
        layout.add_info(options.ids, "instance", ArrayKind::I32, &[height, width]);
        layout.add_info(options.ids, "semantic", ArrayKind::U8, &[height, width]);
        layout.add_info(options.ids, "target_instance", ArrayKind::I32, &[MAX_GOALS]);
        layout.add_info(options.top_down, "top_down", ArrayKind::U8, &[MAP_SIDE; 2]);
        layout
    }

    fn add(&mut self, is_wanted: bool, name: &'static str, kind: ArrayKind, shape: &[usize]) {
        if is_wanted {
            self.arrays.push(ArraySpec { name, kind, shape: shape.to_vec(), is_info: false });
        }
    }

    fn add_privileged(&mut self) {
        let (float, integer) = (ArrayKind::F32, ArrayKind::I64);
        let arrays: [(&'static str, ArrayKind, &[usize]); 11] = [
            ("distance_m", float, &[MAX_GOALS]),
            ("bearing_rad", float, &[MAX_GOALS]),
            ("target_position", float, &[MAX_GOALS, 3]),
            ("is_open", ArrayKind::U8, &[MAX_GOALS]),
            ("is_in_region", ArrayKind::U8, &[MAX_GOALS]),
            ("sounding", integer, &[]),
            ("routed", integer, &[]),
            ("expert", integer, &[]),
            ("expert_submit", ArrayKind::U8, &[]),
            ("success", float, &[]),
            ("spl", float, &[]),
        ];
        for (name, kind, shape) in arrays {
            self.add_info(true, name, kind, shape);
        }
    }

    fn add_info(&mut self, is_wanted: bool, name: &'static str, kind: ArrayKind, shape: &[usize]) {
        if is_wanted {
            self.arrays.push(ArraySpec { name, kind, shape: shape.to_vec(), is_info: true });
        }
    }

    fn index(&self, name: &str) -> Option<usize> {
        self.arrays.iter().position(|spec| spec.name == name)
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

    pub(crate) fn bytes(&mut self, layout: &Layout, name: &str) -> Option<&mut [u8]> {
        match &mut self.arrays[layout.index(name)?] {
            RowArray::U8(values) => Some(values),
            _ => None,
        }
    }

    pub(crate) fn floats(&mut self, layout: &Layout, name: &str) -> Option<&mut [f32]> {
        match &mut self.arrays[layout.index(name)?] {
            RowArray::F32(values) => Some(values),
            _ => None,
        }
    }

    pub(crate) fn integers(&mut self, layout: &Layout, name: &str) -> Option<&mut [i64]> {
        match &mut self.arrays[layout.index(name)?] {
            RowArray::I64(values) => Some(values),
            _ => None,
        }
    }

    pub(crate) fn shorts(&mut self, layout: &Layout, name: &str) -> Option<&mut [i32]> {
        match &mut self.arrays[layout.index(name)?] {
            RowArray::I32(values) => Some(values),
            _ => None,
        }
    }

    /// Writes the entries that change in every step.
    pub(crate) fn put_observation(&mut self, layout: &Layout, seen: &Observation) {
        copy(self.bytes(layout, "rgb"), seen.rgb.as_deref());
        copy(self.floats(layout, "depth"), seen.depth.as_deref());
        copy(self.floats(layout, "audio"), seen.audio.as_deref());
        let [x, y, z] = seen.pose.position.coords.into();
        copy(self.floats(layout, "pose"), Some(&[x, y, z, seen.pose.heading_rad]));
        let remaining = [seen.remaining_steps as i32, seen.remaining_submits as i32];
        copy(self.shorts(layout, "remaining"), Some(&remaining));
        copy(self.integers(layout, "feedback"), Some(&[feedback_number(seen.feedback)]));
    }

    /// Writes the entries that are constant during an episode: also in every step, because callers alternate between rows.
    pub(crate) fn put_mission(&mut self, layout: &Layout, mission: &MissionArrays) {
        copy(self.integers(layout, "order"), Some(&[mission.order]));
        copy(self.integers(layout, "goal_modality"), Some(&mission.modalities));
        copy(self.bytes(layout, "goal_text"), Some(&mission.texts));
        copy(self.bytes(layout, "goal_image"), Some(&mission.images));
    }
}

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
            let to = &mut texts[index * GOAL_TEXT_BYTES..][..GOAL_TEXT_BYTES];
            to.iter_mut().zip(text(goal).bytes()).for_each(|(to, byte)| *to = byte);
            if let GoalCue::Image(image) = goal {
                scale(image, &mut images[index * side * side * 3..][..side * side * 3], side);
            }
        }
        Self { order: i64::from(mission.order == Order::Ordered), modalities, texts, images }
    }
}

/// Copies values into an array, if both exist.
pub(crate) fn copy<T: Copy>(to: Option<&mut [T]>, from: Option<&[T]>) {
    if let (Some(to), Some(from)) = (to, from) {
        to.iter_mut().zip(from).for_each(|(to, from)| *to = *from);
    }
}

/// Returns the number in `avln.Feedback`.
fn feedback_number(feedback: Feedback) -> i64 {
    match feedback {
        Feedback::None => 0,
        Feedback::Accepted => 1,
        Feedback::Verdict(true) => 2,
        Feedback::Verdict(false) => 3,
    }
}

fn text(goal: &GoalCue) -> &str {
    match goal {
        GoalCue::Category(text) | GoalCue::Description(text) => text,
        GoalCue::Image(_) => "",
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
