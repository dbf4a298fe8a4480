//! Fair shares of places.

/// Returns the number of places that a party may occupy: half of those that the others leave, rounded up.
///
/// A party alone has half of all places, so a second one always finds some; the last free place is always left to a newcomer.
pub fn fair_share(places: usize, held_by_others: usize) -> usize {
    places.saturating_sub(held_by_others).div_ceil(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn last_place_is_left_to_newcomers() {
        for places in 1..40 {
            let mut held = Vec::new();
            while held.iter().sum::<usize>() < places {
                let share = fair_share(places, held.iter().sum());
                assert!(share >= 1, "{places} places, {held:?}");
                held.push(share);
            }
            assert_eq!(held.iter().sum::<usize>(), places);
        }
        assert_eq!(fair_share(256, 0), 128);
        assert_eq!(fair_share(256, 300), 0);
    }
}
