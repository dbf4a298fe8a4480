/// Which source sounds: a model of the published rule that unfinished targets sound in turn, in an order drawn once,
/// and that a found one falls silent at once. Sources are numbered in the order in which they are first heard.
#[derive(Clone, Debug)]
pub struct Turns {
    silent: Vec<bool>,
    window_steps: u32,
    current: usize,
    steps_left: u32,
    deferred: u32,
}

impl Turns {
    /// `count` sources that have not been found, each of which sounds for `window_steps` steps in turn.
    pub fn new(count: usize, window_steps: u32) -> Self {
        let window_steps = window_steps.max(1);
        Self { silent: vec![false; count], window_steps, current: 0, steps_left: window_steps, deferred: 0 }
    }

    /// Lets an observation pass of which is not known yet who sounds in it.
    pub fn defer(&mut self) {
        self.deferred += 1;
    }

    /// The source that sounds in the next observation; `None` when all have been found.
    pub fn advance(&mut self) -> Option<usize> {
        for _ in 0..std::mem::take(&mut self.deferred) {
            self.step();
        }
        self.step()
    }

    fn step(&mut self) -> Option<usize> {
        if self.steps_left == 0 || *self.silent.get(self.current)? {
            self.current = self.after(self.current)?;
            self.steps_left = self.window_steps;
        }
        self.steps_left -= 1;
        Some(self.current)
    }

    fn after(&self, current: usize) -> Option<usize> {
        let count = self.silent.len();
        (1..=count).map(|ahead| (current + ahead) % count).find(|&next| !self.silent[next])
    }

    /// The source was found: it sounds no more.
    pub fn silence(&mut self, source: usize) {
        if let Some(silent) = self.silent.get_mut(source) {
            *silent = true;
        }
    }

    /// Whether the source was found, or is none.
    pub fn is_silent(&self, source: usize) -> bool {
        self.silent.get(source).copied().unwrap_or(true)
    }

    /// The source that sounds now.
    pub fn current(&self) -> usize {
        self.current
    }

    /// Observations for which the current source goes on, unless it is found.
    pub fn steps_left(&self) -> u32 {
        self.steps_left
    }

    /// Whether the current source has just begun.
    pub fn is_first(&self) -> bool {
        self.steps_left + 1 == self.window_steps
    }

    /// Steps until `source` is heard: 0 when it sounds now.
    pub fn wait_steps(&self, source: usize) -> u32 {
        let count = self.silent.len();
        let mut wait = 0;
        for ahead in 0..count {
            let place = (self.current + ahead) % count;
            if place == source {
                return wait;
            }
            wait += match (ahead, self.silent[place]) {
                (0, _) => self.steps_left,
                (_, false) => self.window_steps,
                (_, true) => 0,
            };
        }
        wait
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_take_turns_and_the_found_are_left_out() {
        let mut turns = Turns::new(3, 2);
        let heard: Vec<_> = (0..7).filter_map(|_| turns.advance()).collect();
        assert_eq!(heard, [0, 0, 1, 1, 2, 2, 0]);
        assert_eq!((turns.wait_steps(0), turns.wait_steps(1), turns.wait_steps(2)), (0, 1, 3));
        turns.silence(0);
        assert!(turns.is_silent(0) && !turns.is_silent(1));
        let heard: Vec<_> = (0..5).filter_map(|_| turns.advance()).collect();
        assert_eq!(heard, [1, 1, 2, 2, 1]);
        turns.silence(1);
        turns.silence(2);
        assert_eq!(turns.advance(), None);
    }

    #[test]
    fn observations_may_be_assigned_later() {
        let mut turns = Turns::new(2, 3);
        assert_eq!((turns.advance(), turns.steps_left()), (Some(0), 2));
        turns.defer();
        turns.silence(0);
        assert_eq!((turns.advance(), turns.steps_left()), (Some(1), 1));
    }

    #[test]
    fn without_sources_nothing_sounds() {
        assert_eq!(Turns::new(0, 25).advance(), None);
    }
}
