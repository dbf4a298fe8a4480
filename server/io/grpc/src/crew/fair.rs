use std::{
    collections::{BTreeMap, VecDeque},
    time::Duration,
};

/// Work that waits for a thread, by team. The team that has had the least goes first, however much of its work waits: where
/// several teams always have work waiting, each gets the same time.
#[derive(Debug)]
pub(super) struct Fair<J> {
    lines: BTreeMap<String, Line<J>>,
    /// What the team that was served last had had before: whoever comes anew begins here, and saves nothing up.
    level: Duration,
}

#[derive(Debug)]
struct Line<J> {
    waiting: VecDeque<J>,
    /// What the team has had, as far as it counts.
    had: Duration,
    /// Work of it that is under way, and what it is expected to take.
    under_way: u32,
    expected: Duration,
}

impl<J> Line<J> {
    fn is_idle(&self) -> bool {
        self.waiting.is_empty() && self.under_way == 0
    }
}

impl<J> Default for Fair<J> {
    fn default() -> Self {
        Self { lines: BTreeMap::new(), level: Duration::ZERO }
    }
}

impl<J> Fair<J> {
    /// Puts work at the end of its team's line.
    pub(super) fn push(&mut self, team: &str, job: J) {
        let level = self.level;
        let new = || Line { waiting: VecDeque::new(), had: level, under_way: 0, expected: Duration::ZERO };
        let line = self.lines.entry(team.to_owned()).or_insert_with(new);
        if line.is_idle() {
            line.had = line.had.max(level);
        }
        line.waiting.push_back(job);
    }

    /// The work that is done next, and its team.
    pub(super) fn take(&mut self) -> Option<(String, J)> {
        let waits = |(_, line): &(&String, &mut Line<J>)| !line.waiting.is_empty();
        let (team, line) = self.lines.iter_mut().filter(waits).min_by_key(|(_, line)| line.had)?;
        let job = line.waiting.pop_front()?;
        self.level = self.level.max(line.had);
        line.under_way += 1;
        // Threads that take more of the same team's work meanwhile see that it has this.
        line.had += line.expected;
        Some((team.clone(), job))
    }

    /// Work of a team is done, or is no longer waited for.
    pub(super) fn done(&mut self, team: &str, took: Duration) {
        let Some(line) = self.lines.get_mut(team) else { return };
        line.under_way = line.under_way.saturating_sub(1);
        line.had = (line.had + took).saturating_sub(line.expected);
        if line.under_way == 0 {
            line.expected = took;
        }
        if self.lines.values().all(Line::is_idle) {
            // Nobody competes with anybody: what was had before counts no more.
            return self.lines.clear();
        }
        let level = self.level;
        self.lines.retain(|_, line| !line.is_idle() || line.had > level);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    /// Serves one thread for so many turns; each team has as much work waiting as it has slots, and gets new work when some is
    /// done. Gives back what each had.
    fn serve(teams: &[(&'static str, u32, Duration)], turns: u32) -> BTreeMap<String, (u32, Duration)> {
        let mut fair = Fair::default();
        for (team, slots, _) in teams {
            (0..*slots).for_each(|_| fair.push(team, ()));
        }
        let mut had: BTreeMap<String, (u32, Duration)> = BTreeMap::new();
        for _ in 0..turns {
            let (team, ()) = fair.take().unwrap();
            let took = teams.iter().find(|(name, ..)| *name == team).unwrap().2;
            let so_far = had.entry(team.clone()).or_default();
            *so_far = (so_far.0 + 1, so_far.1 + took);
            fair.done(&team, took);
            fair.push(&team, ());
        }
        had
    }

    #[test]
    fn a_team_of_one_slot_gets_as_much_as_one_of_sixteen() {
        let had = serve(&[("greedy", 16, 5 * MS), ("modest", 1, 5 * MS)], 1000);
        assert!(had["modest"].0.abs_diff(had["greedy"].0) <= 1, "{had:?}");
    }

    #[test]
    fn what_is_shared_is_time_and_not_turns() {
        let had = serve(&[("large pictures", 4, 20 * MS), ("blind", 4, 2 * MS)], 2200);
        let (large, blind) = (had["large pictures"].1, had["blind"].1);
        assert!(large.abs_diff(blind) <= 20 * MS, "{had:?}");
    }

    #[test]
    fn who_was_idle_saves_nothing_up() {
        let mut fair = Fair::default();
        for _ in 0..100 {
            fair.push("early", ());
            let (team, ()) = fair.take().unwrap();
            fair.done(&team, 10 * MS);
        }
        for _ in 0..20 {
            fair.push("early", ());
            fair.push("late", ());
        }
        let first: Vec<_> = (0..20)
            .map(|_| {
                let (team, ()) = fair.take().unwrap();
                fair.done(&team, 10 * MS);
                team
            })
            .collect();
        let early = first.iter().filter(|team| *team == "early").count();
        assert!((9..=11).contains(&early), "{first:?}");
    }

    #[test]
    fn several_threads_share_as_well() {
        let mut fair = Fair::default();
        (0..50).for_each(|_| fair.push("greedy", ()));
        (0..50).for_each(|_| fair.push("other", ()));
        let mut taken = BTreeMap::new();
        for _ in 0..10 {
            let round: Vec<_> = (0..4).map(|_| fair.take().unwrap().0).collect();
            for team in round {
                *taken.entry(team.clone()).or_insert(0) += 1;
                fair.done(&team, 3 * MS);
            }
        }
        let waiting: usize = fair.lines.values().map(|line| line.waiting.len()).sum();
        assert_eq!(waiting, 60);
        assert!(taken["greedy"] >= 17 && taken["other"] >= 17, "{taken:?}");
    }

    #[test]
    fn nobody_is_remembered_who_has_nothing_to_do() {
        let mut fair = Fair::default();
        for team in 0..50 {
            fair.push(&team.to_string(), ());
            let (team, ()) = fair.take().unwrap();
            fair.done(&team, MS);
        }
        assert!(fair.lines.len() <= 2, "{:?}", fair.lines);
    }
}
