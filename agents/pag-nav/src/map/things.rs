use crate::perception::{Place, Query, Thing, Words, category_likeness};

/// Most things that are remembered.
const MOST: usize = 400;
/// Things within this distance of a source may be what sounds, metres.
const AT_SOURCE_M: f32 = 0.4;
/// Things within this distance are near, and in one room, metres.
const NEAR_M: f32 = 1.2;
const ROOM_M: f32 = 3.0;
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

/// The object memory of the paper: everything that was seen as a whole, merged over pictures.
#[derive(Clone, Debug, Default)]
pub(crate) struct Things {
    all: Vec<Thing>,
}

impl Things {
    /// Takes in the things of one picture.
    pub(crate) fn see(&mut self, seen: Vec<Thing>) {
        for thing in seen {
            if let Some(known) = self.all.iter_mut().find(|known| known.is_same(&thing)) {
                known.merge(&thing);
            } else if self.all.len() < MOST {
                self.all.push(thing);
            }
        }
    }

    /// How well what stands at `place` fits a goal, 0 to 1 (the paper's s_vis and P_ctx); `None` when nothing was seen
    /// there.
    pub(crate) fn fit(&self, place: Place, query: &Query) -> Option<f32> {
        let at = self.all.iter().filter(|thing| thing.distance_m(place) <= AT_SOURCE_M);
        let fits = at.map(|thing| match query {
            Query::Words(words) => self.fit_words(thing, words),
            Query::Picture { middle, .. } => thing.palette.likeness(middle),
        });
        fits.reduce(f32::max)
    }

    fn fit_words(&self, thing: &Thing, words: &Words) -> f32 {
        let color = words.color.as_deref().and_then(|word| thing.palette.share_of(word));
        let near =
            words.near.as_deref().map(|noun| self.presence(thing.center(), NEAR_M + thing.long_m(), noun));
        let room = words.room.as_deref().map(|room| self.room(thing.center(), room));
        let factor = |fit: Option<f32>, least: f32| fit.map_or(1.0, |fit| least + (1.0 - least) * fit);
        category_likeness(thing, &words.category)
            * factor(color.map(|share| (2.0 * share).min(1.0)), 0.15)
            * factor(near, 0.6)
            * factor(room, 0.5)
    }

    /// How much rooms and things around a place speak for what is described, 0 to 1.
    pub(crate) fn expects(&self, place: Place, words: &Words) -> f32 {
        let stated = words.room.as_deref().map(|room| self.room(place, room));
        let typical = ROOMS.iter().filter(|(_, typical)| typical.contains(&words.category.as_str()));
        let usual = typical.map(|(room, _)| self.room(place, room)).fold(0.0, f32::max);
        let near = words.near.as_deref().map_or(0.0, |noun| self.presence(place, ROOM_M, noun));
        0.5 * stated.unwrap_or(usual) + 0.5 * near
    }

    /// How sure it is that something of a category stands within `reach_m` of a place, 0 to 1.
    fn presence(&self, place: Place, reach_m: f32, category: &str) -> f32 {
        let near = self.all.iter().filter(|thing| thing.distance_m(place) <= reach_m);
        near.map(|thing| category_likeness(thing, category)).fold(0.0, f32::max)
    }

    /// How much the things around a place speak for a room, 0 to 1 (the room memory of the paper); 0.5 for rooms of
    /// which nothing is typical.
    fn room(&self, place: Place, room: &str) -> f32 {
        let Some((_, typical)) = ROOMS.iter().find(|(name, _)| *name == room) else { return 0.5 };
        let sum: f32 = typical.iter().map(|category| self.presence(place, ROOM_M, category)).sum();
        sum / typical.len() as f32
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
        Thing { min, max, low_m: 0.0, high_m, palette, views: 1 }
    }

    #[test]
    fn what_fits_the_words_is_told_from_what_does_not() {
        let mut things = Things::default();
        let bed = thing(0.0, [2.0, 1.6], 0.6, [40, 60, 190]);
        things.see(vec![bed.clone(), thing(5.0, [0.5, 0.5], 0.9, [200, 40, 40])]);
        things.see(vec![bed]);
        assert_eq!(things.all.len(), 2);
        let fit = |x: f32, sentence: &str| {
            things.fit(Place::new(x, 0.3), &Query::new(&GoalCue::Description(sentence.into())))
        };
        assert!(fit(1.0, "the blue bed") > fit(5.2, "the blue bed"));
        assert!(fit(5.2, "the red chair") > fit(1.0, "the red chair"));
        assert!(fit(1.0, "the blue bed") > fit(1.0, "the green bed"));
        assert!(fit(1.0, "the bed in the bedroom") > fit(1.0, "the bed in the bathroom"));
        assert_eq!(fit(9.0, "the bed"), None);
    }
}
