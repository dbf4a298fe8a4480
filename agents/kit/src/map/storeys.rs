/// Storeys are at least this far apart, metres: a landing between two flights of stairs is one of its own.
const APART_M: f32 = 1.2;
/// Most storeys that are remembered, landings among them.
const MOST: usize = 8;

/// What is remembered of the storeys that the body is not on. Plans know no heights: what was drawn below says nothing of where
/// one can walk above.
pub struct Storeys<M> {
    /// Where the body is, metres above its start.
    height_m: f32,
    /// Other storeys by their heights.
    away: Vec<(f32, M)>,
}

impl<M> Default for Storeys<M> {
    /// The storey of the start, and no other.
    fn default() -> Self {
        Self { height_m: 0.0, away: Vec::new() }
    }
}

impl<M> Storeys<M> {
    /// Whether a body at `height_m` above its start is on the storey that it was on.
    pub fn is_on(&self, height_m: f32) -> bool {
        is_same(self.height_m, height_m)
    }

    /// Where the body is at `height_m` above its start: swaps `here` for what is remembered of that storey, or for what `begin`
    /// gives where nothing is. Gives back whether it is another storey than before.
    pub fn enter(&mut self, height_m: f32, here: &mut M, begin: impl FnOnce() -> M) -> bool {
        if self.is_on(height_m) {
            return false;
        }
        let known = self.away.iter().position(|(other_m, _)| is_same(*other_m, height_m));
        let (entered_m, memory) = match known {
            Some(known) => self.away.remove(known),
            None => (height_m, begin()),
        };
        self.away.truncate(MOST - 2);
        self.away.insert(0, (self.height_m, std::mem::replace(here, memory)));
        self.height_m = entered_m;
        true
    }
}

fn is_same(one_m: f32, other_m: f32) -> bool {
    (one_m - other_m).abs() <= APART_M
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_storey_is_remembered_as_it_was_left() {
        let (mut storeys, mut here) = (Storeys::default(), "ground");
        assert!(!storeys.enter(1.1, &mut here, || unreachable!()));
        assert!(storeys.enter(1.4, &mut here, || "landing") && here == "landing");
        assert!(storeys.enter(2.9, &mut here, || "upper") && here == "upper");
        here = "upper, seen";
        assert!(storeys.enter(1.5, &mut here, || unreachable!()) && here == "landing");
        assert!(storeys.enter(0.1, &mut here, || unreachable!()) && here == "ground");
        assert!(storeys.enter(2.8, &mut here, || unreachable!()) && here == "upper, seen");
    }

    #[test]
    fn the_storeys_left_longest_ago_are_forgotten() {
        let (mut storeys, mut here) = (Storeys::default(), 0);
        (1..20).for_each(|storey| assert!(storeys.enter(3.0 * storey as f32, &mut here, || storey)));
        assert_eq!(storeys.away.len(), MOST - 1);
        assert!(storeys.enter(3.0 * 18.0, &mut here, || unreachable!()) && here == 18);
    }
}
