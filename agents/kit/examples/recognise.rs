//! Measures the kit's goal recognitions on a walk through a house; prints tables for docs/perception.md.
//!
//! ```sh
//! avln data dataset frames --measure --split val --houses 11 --views 60 --out FOLDER
//! cargo run --release -p avln-kit --example recognise -- FOLDER
//! cargo run --release -p avln-kit --features onnx --example recognise -- FOLDER models.toml
//! ```

#[path = "../../perception/examples/measure/frames.rs"]
mod frames;

use avln_client::{DepthImage, GoalCue, Image, Mission, Observation, Pose, RgbImage, TaskSpec};
use avln_kit::geometry::{FloorPoint, PinholeCamera, Pose2d};
use avln_kit::map::{Cell, ObjectHypothesis, ObjectMemory, Occupancy};
use avln_kit::perception::{ClassicalRecognition, DetectedObject, NetworkRecognition, Recognition};
use avln_perception::extent;
use frames::{Record, Sentence};
use std::collections::BTreeMap;
use std::path::PathBuf;

fn main() {
    let Some(folder) = std::env::args().nth(1).map(PathBuf::from) else {
        eprintln!("name the folder that avln data dataset frames has written");
        std::process::exit(2);
    };
    let manifest = frames::manifest(&folder);
    let mut perceptions: Vec<(&str, Box<dyn Recognition>)> = vec![
        ("depth and colours", Box::<ClassicalRecognition>::default()),
        ("network", Box::new(NetworkRecognition::new().expect("the weights of the crate"))),
    ];
    perceptions.extend(user_models().map(|models| ("models", models)));
    let mut tallies: Vec<Tally> = perceptions.iter().map(|_| Tally::default()).collect();
    for house in &manifest.houses {
        let records = frames::house(&folder.join(&house.file), manifest.side_px);
        let sentences = frames::sentences(&folder.join(&house.sentences));
        let walk = HouseWalk::through(&records, &sentences, &manifest.categories, manifest.side_px);
        if let Some(walk) = walk {
            for ((_, perception), tally) in perceptions.iter_mut().zip(&mut tallies) {
                tally.add(&walk, &walk.objects(perception.as_mut()));
            }
        }
    }
    let (houses, frames::Manifest { split, recipe, .. }) = (manifest.houses.len(), &manifest);
    println!("{houses} houses of split `{split}` of recipe `{recipe}`.\n");
    let names: Vec<&str> = perceptions.iter().map(|(name, _)| *name).collect();
    print(&names, &tallies);
}

/// Loads the models file in the second argument.
#[cfg(feature = "onnx")]
fn user_models() -> Option<Box<dyn Recognition>> {
    let file = std::env::args().nth(2).map(PathBuf::from)?;
    let models = avln_kit::onnx::OnnxRecognition::load(&file).unwrap_or_else(|error| panic!("{error}"));
    Some(Box::new(models))
}

#[cfg(not(feature = "onnx"))]
fn user_models() -> Option<Box<dyn Recognition>> {
    None
}

/// Categories before this number are the building itself.
const BUILDING: usize = 3;
/// Tolerance for an agent's camera, metres and radians.
const USUAL: f32 = 1e-3;
/// Least share in a reference image: in the middle, and overall.
const IN_THE_MIDDLE: f32 = 0.2;
const OF_THE_WHOLE: f32 = 0.005;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Modality {
    Category,
    Sentence,
    Picture,
}

struct WalkGoal {
    modality: Modality,
    right: Vec<u16>,
    cue: GoalCue,
}

struct HouseWalk<'a> {
    task: TaskSpec,
    shown: Vec<&'a Record>,
    instances: Vec<Instance>,
    goals: Vec<WalkGoal>,
}

impl<'a> HouseWalk<'a> {
    /// Takes every second image of the storey with most images; the others become reference images.
    fn through(
        records: &'a [Record],
        sentences: &[Sentence],
        categories: &[String],
        side_px: usize,
    ) -> Option<Self> {
        let task = TaskSpec { width: side_px as u32, height: side_px as u32, ..TaskSpec::default() };
        let mut storeys = BTreeMap::<i32, Vec<&Record>>::new();
        for record in records.iter().filter(|record| is_usual(record, &task)) {
            storeys.entry((record.base_m[1] / 2.0).round() as i32).or_default().push(record);
        }
        let all = storeys.into_values().max_by_key(Vec::len)?;
        let (shown, others): (Vec<_>, Vec<_>) =
            all.iter().copied().enumerate().partition(|(i, _)| i % 2 == 0);
        let strip = |pairs: Vec<(usize, &'a Record)>| pairs.into_iter().map(|(_, record)| record).collect();
        let (shown, others): (Vec<_>, Vec<_>) = (strip(shown), strip(others));
        let instances = instances(&PinholeCamera::new(&task), &shown, BUILDING);
        let mut walk = Self { task, shown, instances, goals: Vec::new() };
        walk.goals = walk.goals(&others, sentences, categories);
        Some(walk)
    }

    fn goals(&self, others: &[&Record], sentences: &[Sentence], categories: &[String]) -> Vec<WalkGoal> {
        let is_there = |id: u16| self.instances.iter().any(|instance| instance.id == id);
        let mut goals = Vec::new();
        let mut kinds: Vec<&str> = sentences.iter().map(|sentence| sentence.category.as_str()).collect();
        kinds.sort_unstable();
        kinds.dedup();
        for kind in kinds {
            let is_kind = |instance: &&Instance| categories[usize::from(instance.category)] == kind;
            let right: Vec<u16> = self.instances.iter().filter(is_kind).map(|instance| instance.id).collect();
            if !right.is_empty() {
                let cue = GoalCue::Category(kind.to_owned());
                goals.push(WalkGoal { modality: Modality::Category, right, cue });
            }
        }
        let said = sentences.iter().filter(|sentence| is_there(sentence.instance));
        goals.extend(said.map(|sentence| WalkGoal {
            modality: Modality::Sentence,
            right: vec![sentence.instance],
            cue: GoalCue::Description(sentence.text.clone()),
        }));
        let pictured = others.iter().filter_map(|record| Some((in_the_middle(record)?, record)));
        let wanted = |id: u16| is_there(id) && sentences.iter().any(|sentence| sentence.instance == id);
        goals.extend(pictured.filter(|(id, _)| wanted(*id)).map(|(id, record)| WalkGoal {
            modality: Modality::Picture,
            right: vec![id],
            cue: GoalCue::Image(image(record)),
        }));
        goals
    }

    /// Runs `perception` over the walk and returns the object memory.
    fn objects(&self, perception: &mut dyn Recognition) -> ObjectMemory {
        let goals: Vec<GoalCue> = self.goals.iter().map(|goal| goal.cue.clone()).collect();
        perception.begin(&self.task, &Mission { goals, ..Mission::default() });
        let (view, mut map, mut objects) =
            (PinholeCamera::new(&self.task), Occupancy::default(), ObjectMemory::new(self.goals.len()));
        for record in &self.shown {
            let pose = pose(record);
            let seen = observation(record, self.task.width as usize);
            if let Some(depth) = &seen.depth {
                map.see(&view, &pose, depth);
            }
            let detections = perception.see(&pose, &seen, &|place| map.is_wall(Cell::at(place)));
            objects.see(detections.unwrap_or_default());
            objects.look(&map, &pose, NEAR_M, |detection, goal| perception.fit(detection, goal));
        }
        objects
    }
}

/// Things are compared with goals within this distance: pictures are few, and taken for no goal.
const NEAR_M: f32 = 4.0;

fn is_usual(record: &Record, task: &TaskSpec) -> bool {
    let camera = &record.camera;
    let off = [camera.height_m - task.camera_height_m, camera.pitch_rad, camera.hfov_rad - task.hfov_rad];
    off.iter().all(|off| off.abs() < USUAL)
}

fn in_the_middle(record: &Record) -> Option<u16> {
    let side = record.instances.len().isqrt();
    let middle = 7 * side / 16..9 * side / 16;
    let (mut counts, mut all) = (BTreeMap::<u16, usize>::new(), BTreeMap::<u16, usize>::new());
    for (pixel, &id) in record.instances.iter().enumerate() {
        *all.entry(id).or_default() += 1;
        if middle.contains(&(pixel / side)) && middle.contains(&(pixel % side)) {
            *counts.entry(id).or_default() += 1;
        }
    }
    let (&id, &count) = counts.iter().max_by_key(|(_, count)| **count)?;
    let share = |count: usize, of: usize| count as f32 / of as f32;
    let fills = share(count, middle.len() * middle.len()) >= IN_THE_MIDDLE;
    (id > 0 && fills && share(all[&id], side * side) >= OF_THE_WHOLE).then_some(id)
}

fn image(record: &Record) -> RgbImage {
    let side = record.instances.len().isqrt() as u32;
    Image { width: side, height: side, pixels: record.rgb.clone() }
}

fn observation(record: &Record, side_px: usize) -> Observation {
    Observation {
        pose: Pose::new(record.base_m, record.heading_rad),
        rgb: Some(image(record)),
        depth: Some(depth(record, side_px)),
        ..Observation::default()
    }
}

/// Instances of fewer pixels in all pictures together are not looked for.
const LEAST_PX: usize = 300;
/// Farther pixels do not count, metres.
const FAR_M: f32 = 6.0;

struct Instance {
    id: u16,
    category: u8,
    min: FloorPoint,
    max: FloorPoint,
    heights_m: [f32; 2],
}

/// Positions and heights from an instance's pixels.
#[derive(Default)]
struct Points {
    category: u8,
    axes: [Vec<f32>; 3],
}

/// The instances that pictures show, by their boxes.
fn instances(view: &PinholeCamera, records: &[&Record], building: usize) -> Vec<Instance> {
    let mut points = BTreeMap::<u16, Points>::new();
    for record in records {
        let depth = depth(record, view.width);
        let pose = pose(record);
        for (pixel, &id) in record.instances.iter().enumerate() {
            let category = record.categories[pixel];
            if id == 0 || usize::from(category) < building || category == u8::MAX {
                continue;
            }
            let seen = view.seen(&pose, &depth, pixel % view.width, pixel / view.width);
            if let Some(seen) = seen.filter(|seen| seen.range_m < FAR_M) {
                let known = points.entry(id).or_default();
                known.category = category;
                let [x, z, up] = &mut known.axes;
                x.push(seen.place.x);
                z.push(seen.place.z);
                up.push(seen.height_m);
            }
        }
    }
    points.into_iter().filter_map(|(id, points)| points.instance(id)).collect()
}

fn depth(record: &Record, side_px: usize) -> DepthImage {
    DepthImage { width: side_px as u32, height: side_px as u32, metres: record.depth_m.clone() }
}

fn pose(record: &Record) -> Pose2d {
    Pose2d::new(&Pose::new(record.base_m, record.heading_rad))
}

impl Points {
    fn instance(self, id: u16) -> Option<Instance> {
        if self.axes[0].len() < LEAST_PX {
            return None;
        }
        let [x, z, up] = self.axes.map(extent);
        let ([x0, x1], [z0, z1], heights_m) = (x?, z?, up?);
        let (min, max) = (FloorPoint::new(x0, z0), FloorPoint::new(x1, z1));
        Some(Instance { id, category: self.category, min, max, heights_m })
    }
}

impl Instance {
    /// Returns the boxes' intersection over union.
    fn overlap(&self, detection: &DetectedObject) -> f32 {
        /// Flat things are made this thick, metres.
        const THICK_M: f32 = 0.1;
        let axes = [
            ([self.min.x, self.max.x], [detection.min.x, detection.max.x]),
            ([self.min.z, self.max.z], [detection.min.z, detection.max.z]),
            (self.heights_m, [detection.low_m, detection.high_m]),
        ];
        let thick = |[low, high]: [f32; 2]| [low - THICK_M, high + THICK_M];
        let (mut both, mut own, mut other) = (1.0, 1.0, 1.0);
        for (a, b) in axes.map(|(a, b)| (thick(a), thick(b))) {
            both *= (a[1].min(b[1]) - a[0].max(b[0])).max(0.0);
            own *= a[1] - a[0];
            other *= b[1] - b[0];
        }
        both / (own + other - both)
    }

    fn center(&self) -> FloorPoint {
        self.min.toward(self.max, 0.5)
    }
}

/// Least intersection over union for a match.
const SAME: f32 = 0.1;
/// Radius for objects at a position, metres.
const AT_M: f32 = 0.4;

#[derive(Default)]
struct Tally {
    /// Goals found among all things, found among the instances of their category, and all.
    found: BTreeMap<Modality, [usize; 3]>,
    chance: BTreeMap<Modality, f64>,
    /// Goals preferred to two others, and all.
    told: BTreeMap<Modality, [usize; 2]>,
}

impl Tally {
    fn add(&mut self, walk: &HouseWalk, objects: &ObjectMemory) {
        for (number, goal) in walk.goals.iter().enumerate() {
            let best = |of: &dyn Fn(&ObjectHypothesis) -> bool| {
                let seen = objects.all().iter().filter(|object| object.looks > 0 && of(object));
                seen.max_by(|a, b| a.vis(number).total_cmp(&b.vis(number)))
            };
            let is_right = |object: Option<&ObjectHypothesis>| {
                let found = object.and_then(|object| instance(walk, object));
                found.is_some_and(|found| goal.right.contains(&found.id))
            };
            let kind = place(walk, goal).map(|instance| instance.category);
            let is_kind =
                |object: &ObjectHypothesis| instance(walk, object).map(|found| found.category) == kind;
            let counts = self.found.entry(goal.modality).or_default();
            counts[0] += usize::from(is_right(best(&|_| true)));
            counts[1] += usize::from(is_right(best(&is_kind)));
            counts[2] += 1;
            let rivals = walk.instances.iter().filter(|instance| Some(instance.category) == kind).count();
            *self.chance.entry(goal.modality).or_default() += goal.right.len() as f64 / rivals.max(1) as f64;
        }
        self.tell(walk, objects);
    }

    /// Compares every goal's position with two others' positions, a third and two thirds further in the list.
    fn tell(&mut self, walk: &HouseWalk, objects: &ObjectMemory) {
        let count = walk.goals.len();
        for first in 0..count {
            let trio = [first, (first + count / 3) % count, (first + 2 * count / 3) % count];
            let places = trio.map(|goal| place(walk, &walk.goals[goal]));
            let [Some(a), Some(b), Some(c)] = places else { continue };
            if a.id == b.id || b.id == c.id || a.id == c.id {
                continue;
            }
            let fit = |at: &Instance| {
                let near = |object: &&ObjectHypothesis| object.detection.distance_m(at.center()) <= AT_M;
                objects.all().iter().filter(near).map(|object| object.vis(first)).fold(0.0, f32::max)
            };
            let counts = self.told.entry(walk.goals[first].modality).or_default();
            counts[0] += usize::from(fit(a) > fit(b) && fit(a) > fit(c));
            counts[1] += 1;
        }
    }
}

fn place<'a>(walk: &'a HouseWalk, goal: &WalkGoal) -> Option<&'a Instance> {
    walk.instances.iter().find(|instance| goal.right.contains(&instance.id))
}

/// The instance that a remembered thing is.
fn instance<'a>(walk: &'a HouseWalk, object: &ObjectHypothesis) -> Option<&'a Instance> {
    let overlaps = walk.instances.iter().map(|instance| (instance.overlap(&object.detection), instance));
    let (overlap, best) = overlaps.max_by(|a, b| a.0.total_cmp(&b.0))?;
    (overlap >= SAME).then_some(best)
}

fn print(names: &[&str], tallies: &[Tally]) {
    println!(
        "| goal | by | found among all detections, % | among its category, % | by chance, % | n | told from two others, % | n |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    for modality in [Modality::Category, Modality::Sentence, Modality::Picture] {
        for (name, tally) in names.iter().zip(tallies) {
            let [found, of_kind, all] = tally.found.get(&modality).copied().unwrap_or_default();
            let [told, asked] = tally.told.get(&modality).copied().unwrap_or_default();
            let chance = tally.chance.get(&modality).copied().unwrap_or_default();
            let percent = |share: f64, all: usize| format!("{:.1}", 100.0 * share / all.max(1) as f64);
            println!(
                "| {modality:?} | {name} | {} | {} | {} | {all} | {} | {asked} |",
                percent(found as f64, all),
                percent(of_kind as f64, all),
                percent(chance, all),
                percent(told as f64, asked)
            );
        }
    }
}
