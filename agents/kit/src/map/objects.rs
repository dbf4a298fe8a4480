use crate::perception::{Place, Query, Thing, Words, category_likeness};

/// Most hypotheses that are remembered.
const MOST: usize = 400;
/// Things within this distance are near, and in one room, metres.
const NEAR_M: f32 = 1.2;
const ROOM_M: f32 = 3.0;
/// How high things are taken to be that no picture shows, metres.
const SUPPOSED_M: f32 = 1.0;
/// What is said for a goal whose cue says nothing of its surroundings.
const NEUTRAL: f32 = 0.5;
/// What is typical for a room.
const ROOMS: [(&str, &[&str]); 7] = [
    ("bathroom", &["toilet", "bathtub", "shower", "towel"]),
    ("bedroom", &["bed", "chest_of_drawers", "clothes"]),
    ("kitchen", &["counter", "stool"]),
    ("living room", &["sofa", "tv_monitor", "fireplace"]),
    ("dining room", &["table", "chair"]),
    ("office", &["table", "chair", "cabinet"]),
    ("gym", &["gym_equipment"]),
];

/// The object memory O_t of the paper: everything that was seen as a whole, merged over pictures, with what looks at it
/// said for each goal.
#[derive(Clone, Debug, Default)]
pub struct Objects {
    all: Vec<Object>,
    goals: usize,
}

/// A persistent object hypothesis.
#[derive(Clone, Debug)]
pub struct Object {
    /// Position, extent, colours.
    pub thing: Thing,
    /// Looks from nearby.
    pub looks: u32,
    /// Submits here that found nothing.
    pub wrong_submits: i32,
    /// Visual compatibility with each goal over all looks, 0 to 1 (s_vis of the paper).
    vis: Vec<f32>,
}

impl Objects {
    /// A memory for a mission of `goals` goals.
    pub fn new(goals: usize) -> Self {
        Self { all: Vec::new(), goals }
    }

    /// Takes in the things of one picture.
    pub fn see(&mut self, seen: Vec<Thing>) {
        for thing in seen {
            if let Some(known) = self.all.iter_mut().find(|known| known.thing.is_same(&thing)) {
                known.thing.merge(&thing);
            } else if self.all.len() < MOST {
                self.all.push(Object { thing, looks: 0, wrong_submits: 0, vis: vec![0.0; self.goals] });
            }
        }
    }

    /// Something stands at a place, although no picture tells it from what is around it.
    pub fn suppose(&mut self, place: Place) {
        if self.all.len() < MOST {
            let thing = Thing { min: place, max: place, high_m: SUPPOSED_M, ..Thing::default() };
            self.all.push(Object { thing, looks: 0, wrong_submits: 0, vis: vec![0.0; self.goals] });
        }
    }

    /// All hypotheses; the index of one stays the same for the whole episode.
    pub fn all(&self) -> &[Object] {
        &self.all
    }

    /// All hypotheses, to be looked at.
    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut Object> {
        self.all.iter_mut()
    }

    /// A Submit at hypothesis `index` found nothing: it has to be looked at anew.
    pub fn refute(&mut self, index: usize) {
        if let Some(object) = self.all.get_mut(index) {
            object.wrong_submits += 1;
            object.looks = 0;
        }
    }

    /// How much rooms and things around a place speak for a goal, 0 to 1 (P_room, P_obj and P_ctx of the paper).
    pub fn context(&self, place: Place, query: &Query) -> f32 {
        match query {
            Query::Words(words) => self.expects(place, words),
            Query::Picture { .. } => NEUTRAL,
        }
    }

    fn expects(&self, place: Place, words: &Words) -> f32 {
        let stated = words.room.as_deref().map(|room| self.room(place, room));
        let typical = ROOMS.iter().filter(|(_, typical)| typical.contains(&words.category.as_str()));
        let usual = typical.map(|(room, _)| self.room(place, room)).reduce(f32::max);
        let room = stated.or(usual).unwrap_or(NEUTRAL);
        match words.near.as_deref() {
            Some(noun) => 0.5 * room + 0.5 * self.presence(place, NEAR_M, noun),
            None => room,
        }
    }

    /// How sure it is that something of a category stands within `reach_m` of a place, 0 to 1.
    fn presence(&self, place: Place, reach_m: f32, category: &str) -> f32 {
        let near = self.all.iter().filter(|object| object.thing.distance_m(place) <= reach_m);
        near.map(|object| category_likeness(&object.thing, category)).fold(0.0, f32::max)
    }

    /// How much the things around a place speak for a room, 0 to 1 (the room memory R_t of the paper); neutral for
    /// rooms of which nothing is typical.
    fn room(&self, place: Place, room: &str) -> f32 {
        let Some((_, typical)) = ROOMS.iter().find(|(name, _)| *name == room) else { return NEUTRAL };
        let sum: f32 = typical.iter().map(|category| self.presence(place, ROOM_M, category)).sum();
        sum / typical.len() as f32
    }
}

impl Object {
    /// Takes in one look from nearby: how well it fits each goal, 0 to 1.
    pub fn look(&mut self, fits: &[f32]) {
        /// Looks over which the mean is taken; older ones fade, since extents grow from look to look.
        const WINDOW: u32 = 4;
        self.looks += 1;
        let share = 1.0 / self.looks.min(WINDOW) as f32;
        self.vis.iter_mut().zip(fits).for_each(|(vis, fit)| *vis += share * (fit - *vis));
    }

    /// Visual compatibility with a goal, 0 to 1; 0 before the first look.
    pub fn vis(&self, goal: usize) -> f32 {
        self.vis.get(goal).copied().unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::perception::Palette;
    use avln_client::GoalCue;

    fn thing(x: f32, size_m: [f32; 2], high_m: f32, rgb: [u8; 3]) -> Thing {
        let (min, max) = (Place::new(x, 0.0), Place::new(x + size_m[0], size_m[1]));
        let palette = Palette::of([rgb; 50].into_iter());
        Thing { min, max, low_m: 0.0, high_m, palette, views: 1, ..Thing::default() }
    }

    #[test]
    fn pictures_of_one_thing_are_one_hypothesis() {
        let mut objects = Objects::new(2);
        let bed = thing(0.0, [2.0, 1.6], 0.6, [40, 60, 190]);
        objects.see(vec![bed.clone(), thing(5.0, [0.5, 0.5], 0.9, [200, 40, 40])]);
        objects.see(vec![bed]);
        assert_eq!(objects.all().len(), 2);
        assert_eq!(objects.all()[0].thing.views, 2);
    }

    #[test]
    fn compatibility_is_the_mean_of_the_last_looks() {
        let mut objects = Objects::new(2);
        objects.see(vec![thing(0.0, [1.0, 1.0], 1.0, [0; 3])]);
        let object = objects.iter_mut().next().unwrap();
        assert_eq!((object.vis(0), object.looks), (0.0, 0));
        object.look(&[0.8, 0.0]);
        object.look(&[0.4, 0.2]);
        assert!((object.vis(0) - 0.6).abs() < 1e-6 && (object.vis(1) - 0.1).abs() < 1e-6);
        (0..2).for_each(|_| object.look(&[0.6, 0.1]));
        // Four looks with the mean 0.6; the fifth counts for a quarter.
        object.look(&[1.0, 0.1]);
        assert!((object.vis(0) - 0.7).abs() < 1e-6 && object.looks == 5);
        assert_eq!(object.vis(9), 0.0);
    }

    #[test]
    fn surroundings_speak_for_goals() {
        let mut objects = Objects::new(1);
        objects.see(vec![thing(0.0, [2.0, 1.6], 0.6, [40, 60, 190])]);
        let context = |sentence: &str, x: f32| {
            objects.context(Place::new(x, 0.3), &Query::new(&GoalCue::Description(sentence.into())))
        };
        assert!(context("the lamp in the bedroom", 2.5) > context("the lamp in the bathroom", 2.5));
        assert!(context("the lamp near a bed", 2.5) > context("the lamp near a bed", 9.0));
        assert_eq!(context("the lamp", 2.5), NEUTRAL);
    }
}
