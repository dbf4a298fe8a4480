use super::{Layout, Place, Query, Stand, Thing, View, things};
use avln_client::{Mission, Observation, TaskSpec};

/// What tells an agent which things a picture shows, and which of them fit its goals.
pub trait Recognition: Send {
    /// A mission begins: forget the last one and understand the cues of this one.
    fn begin(&mut self, task: &TaskSpec, mission: &Mission);

    /// The things in a picture, in the frame of poses; `None` where it was not looked at: without colours and depth, or as much
    /// like the last one. `is_wall` tells where the map has walls.
    fn see(
        &mut self,
        stand: &Stand,
        seen: &Observation,
        is_wall: &dyn Fn(Place) -> bool,
    ) -> Option<Vec<Thing>>;

    /// How well a remembered thing that is in view fits a goal, by the picture that was seen last, 0 to 1.
    fn fit(&self, thing: &Thing, goal: usize) -> f32;
}

/// Perception without anything learnt: connected stretches of depth are things, cues are compared with their extents and
/// colours, pictures with the whole view.
pub struct Classical {
    view: View,
    queries: Vec<Query>,
    layout: Layout,
}

impl Default for Classical {
    fn default() -> Self {
        Self { view: View::new(&TaskSpec::default()), queries: Vec::new(), layout: Layout::default() }
    }
}

impl Recognition for Classical {
    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        let queries = mission.goals.iter().map(Query::new).collect();
        *self = Self { view: View::new(task), queries, layout: Layout::default() };
    }

    fn see(
        &mut self,
        stand: &Stand,
        seen: &Observation,
        is_wall: &dyn Fn(Place) -> bool,
    ) -> Option<Vec<Thing>> {
        let (image, depth) = (seen.rgb.as_ref()?, seen.depth.as_ref()?);
        self.layout = Layout::of(image);
        Some(things(&self.view, stand, image, depth, is_wall))
    }

    fn fit(&self, thing: &Thing, goal: usize) -> f32 {
        self.queries.get(goal).map_or(0.0, |query| query.fit(thing, &self.layout))
    }
}
