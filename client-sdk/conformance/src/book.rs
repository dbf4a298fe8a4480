//! A client's behaviour per trial.

use crate::{
    Check, Outcome,
    trials::{TRIALS, Trick},
};
use avln_proto::v1;

/// Steps after which an episode ends when the client does not stop it.
pub(crate) const STEPS: u32 = 6;
/// Fault step.
pub(crate) const TRICKED_STEP: u32 = 2;
/// The Ping that a client must answer.
pub(crate) const NONCE: u64 = 41;

/// The run as the server sees it.
#[derive(Debug, Default)]
pub(crate) struct Book {
    /// Number of the trial that is played, or begins next.
    trial: usize,
    /// Open episode in the slot.
    pub(crate) open: Option<Open>,
    /// Violations by trial.
    wrong: Vec<(usize, String)>,
    /// A stream was lost, and the client has not come back.
    lost: bool,
    greeted: bool,
    /// Streams to refuse.
    pub(crate) refuse: u32,
    /// Client sensors.
    pub(crate) sensors: v1::SensorSubscription,
    /// RunEnd was sent.
    pub(crate) is_over: bool,
}

/// An episode that has begun.
#[derive(Clone, Debug)]
pub(crate) struct Open {
    pub(crate) handle: String,
    pub(crate) ordinal: u32,
    actions: Vec<i32>,
    /// Step of the last observation that was sent; `None` before EpisodeStart was.
    pub(crate) told: Option<u32>,
    /// End reason, if ended.
    pub(crate) over: Option<v1::EndReason>,
    tricked: bool,
    asked: bool,
}

impl Open {
    /// Actions that it has taken.
    pub(crate) fn step(&self) -> u32 {
        self.actions.len() as u32
    }
}

impl Book {
    pub(crate) fn trick(&self) -> Trick {
        TRIALS.get(self.trial).map_or(Trick::Nothing, |trial| trial.trick)
    }

    pub(crate) fn has_next(&self) -> bool {
        self.trial < TRIALS.len()
    }

    /// Episodes that are over.
    pub(crate) fn done(&self) -> u32 {
        self.trial as u32
    }

    pub(crate) fn wrong(&mut self, what: impl Into<String>) {
        self.wrong.push((self.trial.min(TRIALS.len() - 1), what.into()));
    }

    /// A stream's first frame.
    pub(crate) fn hello(&mut self, hello: &v1::Hello) {
        let lost = std::mem::take(&mut self.lost);
        match (lost, hello.resume) {
            (true, false) => self.wrong("the client came back without Hello.resume"),
            (false, false) if self.greeted => self.wrong("the client left a stream that was not broken"),
            _ => {}
        }
        let due = self.open.as_ref().and_then(|open| Some((open.handle.clone(), open.told?)));
        let known = hello.known.iter().find(|known| known.slot == 0);
        let told = known.map(|known| (known.episode.clone(), known.step));
        if hello.resume && told != due {
            self.wrong(format!("Hello.known says {told:?} of slot 0, {due:?} was sent"));
        }
        if let Some(sensors) = hello.sensors.clone().filter(|_| !self.greeted) {
            self.sensors = sensors;
        }
        self.greeted = true;
    }

    /// Begins the next episode.
    pub(crate) fn begin(&mut self) {
        let ordinal = self.trial as u32 + 1;
        self.open = Some(Open {
            handle: format!("ep_{ordinal:032x}"),
            ordinal,
            actions: Vec::new(),
            told: None,
            over: None,
            tricked: false,
            asked: false,
        });
    }

    /// Returns true once when the fault of this trial is due.
    pub(crate) fn tricks(&mut self, step: u32) -> bool {
        let Some(open) = self.open.as_mut().filter(|open| !open.tricked && open.step() == step) else {
            return false;
        };
        open.tricked = true;
        true
    }

    /// Handles an action; an invalid action is answered with a Fault for the returned reason.
    pub(crate) fn act(&mut self, act: &v1::Act) -> Result<(), v1::Reason> {
        let judged = self.judge(act);
        if let Err((reason, what)) = judged {
            self.wrong(what);
            return Err(reason);
        }
        Ok(())
    }

    fn judge(&mut self, act: &v1::Act) -> Result<(), (v1::Reason, String)> {
        let Some(open) = self.open.as_mut().filter(|open| open.handle == act.episode && act.slot == 0) else {
            let what =
                format!("it acts in episode '{}' of slot {}, which it does not hold", act.episode, act.slot);
            return Err((v1::Reason::EpisodeUnknown, what));
        };
        if !(1..=5).contains(&act.action) {
            return Err((v1::Reason::ActionOutOfRange, format!("{} is no action", act.action)));
        }
        let latest = open.step();
        match open.actions.last() {
            Some(taken) if act.step == latest && *taken != act.action => {
                let what = format!("step {latest} was action {taken} and is {} when sent again", act.action);
                Err((v1::Reason::StepConflict, what))
            }
            Some(_) if act.step == latest => Ok(()),
            _ if act.step == latest + 1 && open.over.is_none() => {
                open.actions.push(act.action);
                open.over = match (act.action, latest + 1) {
                    (action, _) if action == v1::Action::Stop as i32 => Some(v1::EndReason::Stopped),
                    (_, STEPS..) => Some(v1::EndReason::StepLimit),
                    _ => None,
                };
                Ok(())
            }
            _ => Err((v1::Reason::StepAhead, format!("step {} comes after step {latest}", act.step))),
        }
    }

    /// A Ping is sent.
    pub(crate) fn ask(&mut self) {
        if let Some(open) = &mut self.open {
            open.asked = true;
        }
    }

    pub(crate) fn pong(&mut self, nonce: u64) {
        match &mut self.open {
            Some(open) if open.asked && nonce == NONCE => open.asked = false,
            _ => self.wrong(format!("Pong {nonce} answers no Ping")),
        }
    }

    /// The stream is lost on purpose.
    pub(crate) fn lose(&mut self) {
        self.lost = true;
    }

    /// Marks the episode as ended and reported.
    pub(crate) fn close(&mut self) {
        let open = self.open.take();
        if open.as_ref().is_some_and(|open| open.asked) {
            self.wrong(format!("Ping {NONCE} was not answered"));
        }
        let needs_steps = !matches!(self.trick(), Trick::Nothing | Trick::LoseStart | Trick::LoseEnd);
        if needs_steps && open.is_some_and(|open| !open.tricked) {
            self.wrong(format!("it was over before step {TRICKED_STEP}, where things go wrong"));
        }
        self.trial += 1;
    }

    /// Trial results. `late` contains the timeout, if the client did not answer.
    pub(crate) fn checks(&self, late: Option<String>) -> Vec<Check> {
        let check = |(number, trial): (usize, &crate::trials::Trial)| {
            let mut wrong: Vec<_> =
                self.wrong.iter().filter(|(at, _)| *at == number).map(|(_, what)| what.clone()).collect();
            if number == self.trial {
                wrong.extend(late.clone());
            } else if number > self.trial {
                wrong.push("the client did not come so far".to_owned());
            }
            let outcome = if wrong.is_empty() { Outcome::Kept } else { Outcome::Broken(wrong.join("; ")) };
            Check { rule: trial.rule, outcome }
        };
        TRIALS.iter().enumerate().map(check).collect()
    }
}
