use super::{Layout, Place, Query, Recognition, Stand, Thing, View, Words, objects::cosine};
use avln_client::{DepthImage, GoalCue, Image, Mission, Observation, RgbImage, TaskSpec};
use avln_perception::{Camera, Depth, Eyes, Perception as _, Picture, Seen, Segment, WeightsError, lift};

/// Likelihoods below this are left out.
const UNLIKELY: f32 = 0.003;
/// Range of the likeness of two looks over which they go from unlike to alike.
const ALIKE: [f32; 2] = [0.3, 0.9];
/// Weight of the network's word on a picture against the likeness of views.
const NETWORK: f32 = 0.6;
/// What people call things that the network knows by a wider word.
const WIDER: [(&str, &str); 13] = [
    ("armchair", "chair"),
    ("coffee_table", "table"),
    ("desk", "table"),
    ("nightstand", "chest_of_drawers"),
    ("wardrobe", "cabinet"),
    ("bookshelf", "shelving"),
    ("bench", "seating"),
    ("ottoman", "stool"),
    ("refrigerator", "appliances"),
    ("stove", "appliances"),
    ("washing_machine", "appliances"),
    ("lamp", "lighting"),
    ("floor_lamp", "lighting"),
];

/// Perception by the network of `avln-perception`: segments with likelihoods of categories and embeddings, lifted to boxes by depth.
pub struct Sight {
    eyes: Eyes,
    view: View,
    camera: Camera,
    goals: Vec<Goal>,
    layout: Layout,
    /// From where it looked last.
    last: Option<Stand>,
}

/// What is looked for.
enum Goal {
    Words(Words),
    /// The look of the thing in the middle of a picture, where the network found one, and the picture's own.
    Picture(Option<Vec<f32>>, Query),
}

impl Default for Sight {
    fn default() -> Self {
        Self::new().expect("the weights that come with avln-perception can be read")
    }
}

impl Sight {
    /// The network that comes with `avln-perception`.
    ///
    /// # Errors
    /// When its weights cannot be read.
    pub fn new() -> Result<Self, WeightsError> {
        let (task, eyes) = (TaskSpec::default(), Eyes::new()?);
        let (view, camera) = (View::new(&task), camera(&task));
        Ok(Self { eyes, view, camera, goals: Vec::new(), layout: Layout::default(), last: None })
    }

    fn goal(&mut self, cue: &GoalCue) -> Goal {
        match Query::new(cue) {
            Query::Words(words) => Goal::Words(words),
            query @ Query::Picture { .. } => Goal::Picture(self.look_of(cue), query),
        }
    }

    fn look_of(&mut self, cue: &GoalCue) -> Option<Vec<f32>> {
        let GoalCue::Image(image) = cue else { return None };
        self.eyes.look_at_picture(&picture(image)).ok()?.map(|segment| look(&segment))
    }

    /// The box and colours of a segment of a map of `width` x `height` pixels; `None` where it is too far, or without depth.
    fn thing(
        &self,
        segment: &Segment,
        seen: &Seen,
        stand: &Stand,
        (image, depth): (&Image, &DepthImage),
    ) -> Option<Thing> {
        let (width, height) = (seen.width, seen.height);
        let pixels = segment.mask.iter().map(|&pixel| {
            let (row, column) = (pixel as usize / width, pixel as usize % width);
            (column * self.view.width / width, row * self.view.height / height)
        });
        let thing = Thing::of_pixels(&self.view, stand, image, depth, pixels.collect())?;
        let kinds = self.kinds(&self.judged(segment, seen, (image, depth)));
        Some(Thing { embedding: look(segment), kinds, ..thing })
    }

    /// Likelihood of each category, by likeness and shape.
    fn judged(&self, segment: &Segment, seen: &Seen, (image, depth): (&Image, &DepthImage)) -> Vec<f32> {
        let metres = Depth { metres: &depth.metres };
        let solid = lift(seen, segment, &picture(image), &metres, &self.camera);
        solid.map_or_else(|| segment.categories.clone(), |solid| self.eyes.judge(seen, segment, &solid))
    }

    /// The words for likelihoods of categories, each with its own.
    fn kinds(&self, likelihoods: &[f32]) -> Vec<(String, f32)> {
        let names = self.eyes.categories().iter().zip(likelihoods);
        let likely: Vec<(&str, f32)> =
            names.map(|(name, &p)| (name.as_str(), p)).filter(|(_, p)| *p > UNLIKELY).collect();
        let of = |wide: &str| likely.iter().find(|(name, _)| *name == wide).map(|(_, p)| *p);
        let narrow = WIDER.iter().filter_map(|(narrow, wide)| Some((*narrow, of(wide)?)));
        likely.iter().copied().chain(narrow).map(|(name, p)| (name.to_owned(), p)).collect()
    }
}

impl Recognition for Sight {
    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        (self.view, self.camera) = (View::new(task), camera(task));
        self.goals = mission.goals.iter().map(|cue| self.goal(cue)).collect();
        (self.layout, self.last) = (Layout::default(), None);
    }

    fn see(&mut self, stand: &Stand, seen: &Observation, _: &dyn Fn(Place) -> bool) -> Option<Vec<Thing>> {
        let (image, depth) = (seen.rgb.as_ref()?, seen.depth.as_ref()?);
        self.layout = Layout::of(image);
        if self.last.is_some_and(|last| last.sees_like(stand)) {
            return None;
        }
        self.last = Some(*stand);
        let metres = Depth { metres: &depth.metres };
        let told = self.eyes.see(&picture(image), Some((&metres, &self.camera))).ok()?;
        let thing = |segment| self.thing(segment, &told, stand, (image, depth));
        Some(told.segments.iter().filter_map(thing).collect())
    }

    fn fit(&self, thing: &Thing, goal: usize) -> f32 {
        match self.goals.get(goal) {
            Some(Goal::Words(words)) => words.fit(thing),
            Some(Goal::Picture(look, query)) => {
                let view = query.fit(thing, &self.layout);
                look.as_ref()
                    .map_or(view, |look| NETWORK * alike(look, &thing.embedding) + (1.0 - NETWORK) * view)
            }
            None => 0.0,
        }
    }
}

/// How alike two looks are, 0 to 1.
fn alike(a: &[f32], b: &[f32]) -> f32 {
    let [low, high] = ALIKE;
    ((cosine(a, b) - low) / (high - low)).clamp(0.0, 1.0)
}

fn camera(task: &TaskSpec) -> Camera {
    Camera { hfov_rad: task.hfov_rad, height_m: task.camera_height_m, pitch_rad: 0.0 }
}

fn picture(image: &RgbImage) -> Picture<'_> {
    Picture { width: image.width as usize, height: image.height as usize, rgb: &image.pixels }
}

/// What a segment looks like, as one vector: half its embedding, half its categories.
fn look(segment: &Segment) -> Vec<f32> {
    let length = segment.categories.iter().map(|p| p * p).sum::<f32>().sqrt().max(f32::EPSILON);
    let categories = segment.categories.iter().map(|p| p / length);
    segment.embedding.iter().copied().chain(categories).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_client::{Mission, Pose};
    use avln_perception::{Histogram, PixelBox};

    const SIDE: usize = 32;

    /// A segment over the middle of a map of `SIDE` x `SIDE` pixels that the network takes for one category.
    fn segment(sight: &Sight, category: &str) -> Segment {
        let of = |name: &String| if name == category { 1.0 } else { 0.0 };
        let middle = SIDE as u32 / 4..3 * SIDE as u32 / 4;
        let (first, last) = (middle.start, middle.end - 1);
        Segment {
            mask: middle.clone().flat_map(|row| middle.clone().map(move |x| row * SIDE as u32 + x)).collect(),
            categories: sight.eyes.categories().iter().map(of).collect(),
            embedding: vec![1.0; 12].into_iter().map(|one: f32| one / 12_f32.sqrt()).collect(),
            histogram: Histogram::default(),
            bounds: PixelBox { columns: [first, last], rows: [first, last] },
        }
    }

    fn seen() -> Seen {
        let (categories, confidences) = (vec![0; SIDE * SIDE], vec![1.0; SIDE * SIDE]);
        Seen { width: SIDE, height: SIDE, categories, confidences, segments: Vec::new() }
    }

    fn ready(goals: &[&str]) -> Sight {
        let mut sight = Sight::new().unwrap();
        let task = TaskSpec { width: 64, height: 64, ..TaskSpec::default() };
        let goals = goals.iter().map(|label| GoalCue::Category((*label).to_owned())).collect();
        sight.begin(&task, &Mission { goals, ..Mission::default() });
        sight
    }

    #[test]
    fn segments_become_things_with_boxes_words_and_looks() {
        let sight = ready(&["chair", "bed"]);
        let image = Image { width: 64, height: 64, pixels: [200, 30, 30].repeat(64 * 64) };
        let depth = DepthImage { width: 64, height: 64, metres: vec![2.0; 64 * 64] };
        let (segment, stand) = (segment(&sight, "chair"), Stand::new(&Pose::default()));
        let thing = sight.thing(&segment, &seen(), &stand, (&image, &depth)).unwrap();
        // The middle half of 64 pixels of 90 degrees, 2 m ahead, is 2 m wide but for outliers.
        assert!((thing.long_m() - 1.85).abs() < 0.1 && (thing.center().z + 2.0).abs() < 1e-4, "{thing:?}");
        let likely = |word: &str| thing.is_a(word).unwrap();
        assert!(likely("chair") > 0.0 && likely("armchair") == likely("chair") && likely("unicorn") == 0.0);
        assert!((sight.fit(&thing, 0) - likely("chair")).abs() < 1e-6 && sight.fit(&thing, 2) == 0.0);
        let far = DepthImage { metres: vec![8.0; 64 * 64], ..depth };
        assert_eq!(sight.thing(&segment, &seen(), &stand, (&image, &far)), None);
    }

    #[test]
    fn looks_are_alike_by_embedding_and_category() {
        let sight = ready(&[]);
        let [chair, bed] = ["chair", "bed"].map(|category| look(&segment(&sight, category)));
        assert!(alike(&chair, &chair) > 0.99 && (alike(&chair, &bed) - (0.5 - 0.3) / 0.6).abs() < 1e-3);
    }

    #[test]
    fn a_blank_picture_shows_nothing_and_one_without_depth_neither() {
        let mut sight = ready(&["chair"]);
        let image = Image { width: 64, height: 64, pixels: vec![128; 3 * 64 * 64] };
        let blind = Observation { rgb: Some(image), ..Observation::default() };
        assert_eq!(sight.see(&Stand::default(), &blind, &|_| false), None);
    }
}
