/// A fit of 1 instead of 0 makes an association `e` to this power times as likely.
const TRUST: f32 = 5.0;
/// What a Submit that found nothing says against an association: it may have been too far away.
const MISSED: f32 = -2.0;
/// What is assumed of the fit of things that have not been seen.
const UNSEEN: f32 = 0.35;

/// Which source is which goal: what is known, what was tried, and how well what stands at a source fits a cue.
#[derive(Clone, Debug)]
pub(crate) struct Goals {
    /// Best fit of a source (row) with a goal (column), 0 to 1; `None` before anything was seen.
    fits: Vec<Vec<Option<f32>>>,
    /// Submits at a source (row) that were not for a goal (column).
    missed: Vec<Vec<u32>>,
    /// Which source each goal turned out to be.
    done: Vec<Option<usize>>,
    ordered: bool,
}

impl Goals {
    pub(crate) fn new(count: usize, ordered: bool) -> Self {
        Self {
            fits: vec![vec![None; count]; count],
            missed: vec![vec![0; count]; count],
            done: vec![None; count],
            ordered,
        }
    }

    /// Number of goals and of sources.
    fn count(&self) -> usize {
        self.done.len()
    }

    pub(crate) fn is_ordered(&self) -> bool {
        self.ordered
    }

    /// The goals that a Submit may be for.
    pub(crate) fn active(&self) -> impl Iterator<Item = usize> {
        let next = self.next();
        (0..self.count()).filter(move |&goal| match next {
            Some(next) => goal == next,
            None => self.done[goal].is_none(),
        })
    }

    /// The goal that a Submit is for, where there is an order.
    fn next(&self) -> Option<usize> {
        self.ordered.then(|| self.done.iter().position(Option::is_none)).flatten()
    }

    /// Whether only one goal is left.
    pub(crate) fn is_last(&self) -> bool {
        self.done.iter().filter(|source| source.is_none()).count() == 1
    }

    /// What stands at `source` fits `goal` as much as this, by the latest look.
    pub(crate) fn see(&mut self, source: usize, goal: usize, fit: f32) {
        self.fits[source][goal] = Some(fit);
    }

    /// What was seen of `source` was elsewhere.
    pub(crate) fn forget(&mut self, source: usize) {
        self.fits[source].fill(None);
    }

    /// A Submit at `source` found its target.
    pub(crate) fn found(&mut self, source: usize) {
        match self.next() {
            Some(goal) => self.done[goal] = Some(source),
            None => {
                let open = (0..self.count()).filter(|&goal| self.done[goal].is_none());
                let best = open.max_by(|&a, &b| self.score(source, a).total_cmp(&self.score(source, b)));
                best.into_iter().for_each(|goal| self.done[goal] = Some(source));
            }
        }
    }

    /// A goal was found, as far as one knows without its sound.
    pub(crate) fn close(&mut self, goal: usize) {
        self.done[goal] = Some(goal);
    }

    /// A Submit at `source` did not find the goal that was next.
    pub(crate) fn missed(&mut self, source: usize) {
        if let Some(goal) = self.next() {
            self.missed[source][goal] += 1;
        }
    }

    /// Probability that a Submit at `source` is for the right goal: 1 where any order will do, else the share of the
    /// likelihood of all ways to pair sources with goals that pair it with the next.
    pub(crate) fn right(&self, source: usize) -> f32 {
        let Some(next) = self.next() else { return 1.0 };
        let open_goals: Vec<usize> = (0..self.count()).filter(|&goal| self.done[goal].is_none()).collect();
        let mut sources: Vec<usize> =
            (0..self.count()).filter(|source| !self.done.contains(&Some(*source))).collect();
        let place = open_goals.iter().position(|&goal| goal == next).unwrap_or(0);
        let (mut right, mut all) = (0.0, 1e-9);
        permutations(&mut sources, 0, &mut |pairing| {
            let pairs = pairing.iter().zip(&open_goals);
            let likelihood = pairs.map(|(&source, &goal)| self.score(source, goal)).sum::<f32>().exp();
            all += likelihood;
            right += if pairing.get(place) == Some(&source) { likelihood } else { 0.0 };
        });
        right / all
    }

    /// Log-likelihood of a pair.
    fn score(&self, source: usize, goal: usize) -> f32 {
        let tried = MISSED * self.missed[source][goal] as f32;
        TRUST * self.fits[source][goal].unwrap_or(UNSEEN) + tried
    }
}

fn permutations(items: &mut [usize], from: usize, visit: &mut dyn FnMut(&[usize])) {
    if from >= items.len() {
        return visit(items);
    }
    for other in from..items.len() {
        items.swap(from, other);
        permutations(items, from + 1, visit);
        items.swap(from, other);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_source_is_right_where_there_is_no_order() {
        let mut goals = Goals::new(3, false);
        assert_eq!((goals.right(2), goals.next()), (1.0, None));
        goals.found(1);
        assert_eq!(goals.active().count(), 2);
    }

    #[test]
    fn without_looks_all_sources_are_as_likely_and_misses_count() {
        let mut goals = Goals::new(3, true);
        assert!((goals.right(0) - 1.0 / 3.0).abs() < 1e-4);
        goals.missed(0);
        assert!(goals.right(0) < 0.1 && (goals.right(1) - 0.47).abs() < 0.01, "{}", goals.right(1));
        (0..2).for_each(|_| goals.missed(0));
        assert!(goals.right(0) < 0.01);
        goals.found(1);
        assert_eq!(goals.active().collect::<Vec<_>>(), [1]);
        assert!((goals.right(0) - 0.5).abs() < 1e-4 && goals.right(1) == 0.0);
    }

    #[test]
    fn fits_of_the_others_speak_too() {
        let mut goals = Goals::new(2, true);
        goals.see(1, 1, 1.0);
        goals.see(1, 0, 0.0);
        assert!(goals.right(0) > 0.9, "{}", goals.right(0));
    }
}
