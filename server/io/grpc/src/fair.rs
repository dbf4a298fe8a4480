use std::{
    collections::{BTreeMap, VecDeque},
    time::Duration,
};

/// Fair queue of jobs: the team with the least processor time is first, regardless of queue length. Teams that
/// always have jobs waiting get equal time.
#[derive(Debug)]
pub(crate) struct FairQueue<J> {
    teams: BTreeMap<String, TeamQueue<J>>,
    /// Account of the team that was served last. New and idle teams start here, so that idleness earns no credit.
    level: Duration,
}

#[derive(Debug)]
struct TeamQueue<J> {
    waiting: VecDeque<J>,
    /// Counted processor time.
    used: Duration,
    /// Jobs in progress and their expected duration.
    running: u32,
    expected: Duration,
}

impl<J> TeamQueue<J> {
    fn is_idle(&self) -> bool {
        self.waiting.is_empty() && self.running == 0
    }
}

impl<J> Default for FairQueue<J> {
    fn default() -> Self {
        Self { teams: BTreeMap::new(), level: Duration::ZERO }
    }
}

impl<J> FairQueue<J> {
    /// Appends a job to a team's queue.
    pub(crate) fn push(&mut self, team: &str, job: J) {
        let level = self.level;
        let queue = self.teams.entry(team.to_owned()).or_insert_with(|| TeamQueue {
            waiting: VecDeque::new(),
            used: level,
            running: 0,
            expected: Duration::ZERO,
        });
        if queue.is_idle() {
            queue.used = queue.used.max(level);
        }
        queue.waiting.push_back(job);
    }

    /// Takes the next job, with the team.
    pub(crate) fn take(&mut self) -> Option<(String, J)> {
        let waiting = self.teams.iter_mut().filter(|(_, queue)| !queue.waiting.is_empty());
        let (team, queue) = waiting.min_by_key(|(_, queue)| queue.used)?;
        let job = queue.waiting.pop_front()?;
        self.level = self.level.max(queue.used);
        queue.running += 1;
        // Charged in advance, so that other threads do not all serve the same team meanwhile.
        queue.used += queue.expected;
        Some((team.clone(), job))
    }

    /// Accounts for a job that is done or abandoned.
    pub(crate) fn done(&mut self, team: &str, took: Duration) {
        let Some(queue) = self.teams.get_mut(team) else { return };
        queue.running = queue.running.saturating_sub(1);
        queue.used = (queue.used + took).saturating_sub(queue.expected);
        // Not while others run: each of them must be refunded the amount that it was charged.
        if queue.running == 0 {
            queue.expected = took;
        }
        if self.teams.values().all(TeamQueue::is_idle) {
            // No team competes: earlier use no longer counts.
            return self.teams.clear();
        }
        let level = self.level;
        self.teams.retain(|_, queue| !queue.is_idle() || queue.used > level);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    /// Simulates a thread for some turns; all teams keep their slots busy. Returns turns and time per team.
    fn serve(teams: &[(&'static str, u32, Duration)], turns: u32) -> BTreeMap<String, (u32, Duration)> {
        let mut fair = FairQueue::default();
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
    fn one_slot_gets_as_much_as_sixteen() {
        let had = serve(&[("greedy", 16, 5 * MS), ("modest", 1, 5 * MS)], 1000);
        assert!(had["modest"].0.abs_diff(had["greedy"].0) <= 1, "{had:?}");
    }

    #[test]
    fn teams_share_time_rather_than_turns() {
        let had = serve(&[("large pictures", 4, 20 * MS), ("blind", 4, 2 * MS)], 2200);
        let (large, blind) = (had["large pictures"].1, had["blind"].1);
        assert!(large.abs_diff(blind) <= 20 * MS, "{had:?}");
    }

    #[test]
    fn idle_teams_earn_no_credit() {
        let mut fair = FairQueue::default();
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
    fn several_threads_share_fairly() {
        let mut fair = FairQueue::default();
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
        let waiting: usize = fair.teams.values().map(|queue| queue.waiting.len()).sum();
        assert_eq!(waiting, 60);
        assert!(taken["greedy"] >= 17 && taken["other"] >= 17, "{taken:?}");
    }

    #[test]
    fn idle_teams_are_forgotten() {
        let mut fair = FairQueue::default();
        for team in 0..50 {
            fair.push(&team.to_string(), ());
            let (team, ()) = fair.take().unwrap();
            fair.done(&team, MS);
        }
        assert!(fair.teams.len() <= 2, "{:?}", fair.teams);
    }
}
