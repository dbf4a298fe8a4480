//! Places shared between teams.

use avln_net::fair_share;
use parking_lot::Mutex;
use std::{collections::BTreeMap, sync::Arc};

/// A number of places, of which every team may hold its [`fair_share`].
#[derive(Debug)]
pub(crate) struct TeamPlaces {
    all: usize,
    held: Mutex<BTreeMap<String, usize>>,
}

/// A team's place, until it is dropped.
#[derive(Debug)]
pub(crate) struct TeamPlace {
    places: Arc<TeamPlaces>,
    team: String,
}

impl TeamPlaces {
    pub(crate) fn new(all: usize) -> Arc<Self> {
        Arc::new(Self { all, held: Mutex::default() })
    }

    /// Takes a place. Fails with the team's share if the team has no other.
    pub(crate) fn take(self: &Arc<Self>, team: &str) -> Result<TeamPlace, usize> {
        let mut held = self.held.lock();
        let own = held.get(team).copied().unwrap_or(0);
        let share = fair_share(self.all, held.values().sum::<usize>() - own);
        if own >= share {
            return Err(share);
        }
        held.insert(team.to_owned(), own + 1);
        Ok(TeamPlace { places: self.clone(), team: team.to_owned() })
    }
}

impl Drop for TeamPlace {
    fn drop(&mut self) {
        let mut held = self.places.held.lock();
        match held.get_mut(&self.team) {
            Some(count) if *count > 1 => *count -= 1,
            _ => drop(held.remove(&self.team)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn new_teams_find_a_place() {
        let places = TeamPlaces::new(4);
        let red = [places.take("red").unwrap(), places.take("red").unwrap()];
        assert_eq!(places.take("red").unwrap_err(), 2);
        let _blue = places.take("blue").unwrap();
        let _green = places.take("green").unwrap();
        assert_eq!(places.take("late").unwrap_err(), 0, "all are taken");
        drop(red);
        assert!(places.take("late").is_ok(), "dropped places are free");
    }
}
