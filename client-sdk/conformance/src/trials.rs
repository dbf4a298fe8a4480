//! Client trials: a run with one injected fault per episode, and the client's behaviour.

use crate::checks::{Check, Outcome};
use avln_proto::v1;

/// Episode length without a Stop, steps.
pub(crate) const STEPS: u32 = 6;
pub(crate) const FAULT_STEP: u32 = 2;
/// Nonce sent by [`InjectedFault::NoticeAndPing`].
pub(crate) const NONCE: u64 = 41;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum InjectedFault {
    None,
    NoticeAndPing,
    /// A frame unknown to all clients with this version.
    UnknownFrame,
    LateObservation,
    /// The stream breaks after an observation.
    BrokenStream,
    /// The stream ends after an observation, without RunEnd.
    SilentEnd,
    /// The stream breaks after an observation, and the next streams are refused.
    Unreachable,
    LostStart,
    LostObservation,
    LostEnd,
    /// A Fault and EpisodeEnd instead of an observation.
    SimulatorFault,
}

use InjectedFault as F;

/// Injected faults with the expected behaviour, in run order.
pub(crate) const TRIALS: [(InjectedFault, &str); 12] = [
    (F::None, "an episode is played to its end"),
    (F::NoticeAndPing, "the client answers Ping by Pong with the same nonce and continues after a Notice"),
    (F::UnknownFrame, "the client ignores an unknown frame"),
    (F::LateObservation, "the client waits for an observation that takes three seconds"),
    (F::BrokenStream, "after a broken stream the client sends Hello.resume with its last step"),
    (F::SilentEnd, "the client handles a stream without RunEnd like a broken stream"),
    (F::Unreachable, "the client retries while the server is unreachable"),
    (F::LostStart, "the client accepts a lost EpisodeStart after Welcome without a second Ready"),
    (F::LostObservation, "the client resends an action without an answer unchanged"),
    (F::LostEnd, "the client accepts a lost EpisodeEnd after Welcome"),
    (F::SimulatorFault, "the client starts the next episode after a server fault"),
    (F::None, "the run is played to its RunEnd"),
];

/// The client's run from the server's perspective.
#[derive(Debug, Default)]
pub(crate) struct TrialRun {
    /// Current or next trial.
    trial: usize,
    pub(crate) open: Option<OpenEpisode>,
    violations: Vec<(usize, String)>,
    /// The server closed the last stream.
    lost: bool,
    greeted: bool,
    pub(crate) refuse: u32,
    pub(crate) sensors: v1::SensorSubscription,
    /// RunEnd was sent.
    pub(crate) is_over: bool,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct OpenEpisode {
    pub(crate) handle: String,
    pub(crate) ordinal: u32,
    actions: Vec<i32>,
    /// Step of the last sent observation; `None` before EpisodeStart.
    pub(crate) sent_step: Option<u32>,
    pub(crate) over: Option<v1::EndReason>,
    fault_injected: bool,
    awaits_pong: bool,
}

impl OpenEpisode {
    pub(crate) fn step(&self) -> u32 {
        self.actions.len() as u32
    }
}

impl TrialRun {
    pub(crate) fn fault(&self) -> InjectedFault {
        TRIALS.get(self.trial).map_or(F::None, |(fault, _)| *fault)
    }

    pub(crate) fn has_next(&self) -> bool {
        self.trial < TRIALS.len()
    }

    pub(crate) fn ended_episodes(&self) -> u32 {
        self.trial as u32
    }

    pub(crate) fn violation(&mut self, message: impl Into<String>) {
        // A violation after the last episode would otherwise be missing from the results.
        self.violations.push((self.trial.min(TRIALS.len() - 1), message.into()));
    }

    pub(crate) fn hello(&mut self, hello: &v1::Hello) {
        let lost = std::mem::take(&mut self.lost);
        match (lost, hello.resume) {
            (true, false) => self.violation("the client reconnected without Hello.resume"),
            // Every stream in this run ends by an injected fault or by RunEnd.
            (false, false) if self.greeted => self.violation("the client left an intact stream"),
            _ => {}
        }
        let expected = self.open.as_ref().and_then(|open| Some((open.handle.as_str(), open.sent_step?)));
        let known = hello.known.iter().find(|known| known.slot == 0);
        let known = known.map(|known| (known.episode.as_str(), known.step));
        if hello.resume && known != expected {
            self.violation(format!("Hello.known of slot 0: expected {expected:?}, got {known:?}"));
        }
        // Tensors keep their shape during a run, so only the first Hello selects sensors.
        if let Some(sensors) = hello.sensors.clone().filter(|_| !self.greeted) {
            self.sensors = sensors;
        }
        self.greeted = true;
    }

    pub(crate) fn begin(&mut self) {
        let ordinal = self.trial as u32 + 1;
        let handle = format!("ep_{ordinal:032x}");
        self.open = Some(OpenEpisode { handle, ordinal, ..OpenEpisode::default() });
    }

    /// Returns true once, when the trial's fault is due at `step`.
    pub(crate) fn inject_at(&mut self, step: u32) -> bool {
        let Some(open) = self.open.as_mut().filter(|open| !open.fault_injected && open.step() == step) else {
            return false;
        };
        open.fault_injected = true;
        true
    }

    /// Takes an action; returns the Fault's reason for an invalid one.
    pub(crate) fn act(&mut self, act: &v1::Act) -> Result<(), v1::Reason> {
        self.take_action(act).map_err(|(reason, message)| {
            self.violation(message);
            reason
        })
    }

    fn take_action(&mut self, act: &v1::Act) -> Result<(), (v1::Reason, String)> {
        let Some(open) = self.open.as_mut().filter(|open| open.handle == act.episode && act.slot == 0) else {
            let message = format!("episode '{}' is not open in slot {}", act.episode, act.slot);
            return Err((v1::Reason::EpisodeUnknown, message));
        };
        if !(1..=5).contains(&act.action) {
            let message = format!("action: expected 1 to 5, got {}", act.action);
            return Err((v1::Reason::ActionOutOfRange, message));
        }
        let latest = open.step();
        match open.actions.last() {
            Some(taken) if act.step == latest && *taken != act.action => {
                let message = format!("resent action of step {latest}: expected {taken}, got {}", act.action);
                Err((v1::Reason::StepConflict, message))
            }
            // After a lost stream the client cannot know if the server received the action, so it may resend it.
            Some(_) if act.step == latest => Ok(()),
            _ if act.step == latest + 1 && open.over.is_none() => {
                open.actions.push(act.action);
                if act.action == v1::Action::Stop as i32 {
                    open.over = Some(v1::EndReason::Stopped);
                } else if open.step() >= STEPS {
                    open.over = Some(v1::EndReason::StepLimit);
                }
                Ok(())
            }
            _ => Err((v1::Reason::StepAhead, format!("step: expected {}, got {}", latest + 1, act.step))),
        }
    }

    pub(crate) fn ping_sent(&mut self) {
        if let Some(open) = &mut self.open {
            open.awaits_pong = true;
        }
    }

    pub(crate) fn pong(&mut self, nonce: u64) {
        match &mut self.open {
            Some(open) if open.awaits_pong && nonce == NONCE => open.awaits_pong = false,
            _ => self.violation(format!("Pong {nonce} does not match a Ping")),
        }
    }

    pub(crate) fn observation_sent(&mut self) {
        if let Some(open) = &mut self.open {
            open.sent_step = Some(open.step());
        }
    }

    pub(crate) fn lose_stream(&mut self) {
        self.lost = true;
    }

    pub(crate) fn close(&mut self) {
        let open = self.open.take();
        // Several observations follow the Ping, so a Pong still missing here was never sent.
        if open.as_ref().is_some_and(|open| open.awaits_pong) {
            self.violation(format!("the client did not answer Ping {NONCE}"));
        }
        // An agent that stops early would pass the trial without the fault.
        let needs_steps = !matches!(self.fault(), F::None | F::LostStart | F::LostEnd);
        if needs_steps && open.is_some_and(|open| !open.fault_injected) {
            self.violation(format!("the episode ended before the fault at step {FAULT_STEP}"));
        }
        self.trial += 1;
    }

    /// Returns all trials' results. `timeout` describes a missing answer.
    pub(crate) fn checks(&self, timeout: Option<String>) -> Vec<Check> {
        let check = |(number, (_, rule)): (usize, &(InjectedFault, &'static str))| {
            let own = self.violations.iter().filter(|(trial, _)| *trial == number);
            let mut broken: Vec<_> = own.map(|(_, message)| message.clone()).collect();
            if number == self.trial {
                broken.extend(timeout.clone());
            } else if number > self.trial {
                broken.push("the client did not reach this episode".to_owned());
            }
            let outcome = if broken.is_empty() { Outcome::Kept } else { Outcome::Broken(broken.join("; ")) };
            Check { rule, outcome }
        };
        TRIALS.iter().enumerate().map(check).collect()
    }
}
