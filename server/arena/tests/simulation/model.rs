//! A run as its agent knows it: every frame must agree with those before.

use avln_proto::v1::{self, EndReason, play_response::Frame};
use std::{collections::BTreeMap, time::Duration};

/// An observation's content.
type Sight = ([u32; 4], [u32; 2], i32, bool, bool);

/// An episode, by the frames about it.
#[derive(Debug, Default)]
pub(crate) struct EpisodeFacts {
    pub(crate) slot: u32,
    /// Last step that the agent observed.
    pub(crate) seen: u32,
    /// Last step that the agent requested.
    pub(crate) sent: u32,
    /// Reason of the last observation, if it ended the episode.
    last: Option<EndReason>,
    observations: BTreeMap<u32, Sight>,
    pub(crate) end: Option<v1::EpisodeEnd>,
}

/// A run, by the answers about it.
#[derive(Debug)]
pub(crate) struct RunFacts {
    pub(crate) id: String,
    pub(crate) team: usize,
    pub(crate) phase: usize,
    pub(crate) request_id: String,
    /// Uptime of the servers at the start.
    pub(crate) started: Duration,
    /// Number of streams and of unary clients that have connected. Earlier ones may read old frames.
    pub(crate) attachments: u32,
    pub(crate) episodes: BTreeMap<String, EpisodeFacts>,
    /// True if the server reported that every episode was played.
    pub(crate) is_complete: bool,
}

type Checked = Result<(), String>;

fn check(holds: bool, violation: impl FnOnce() -> String) -> Checked {
    if holds { Ok(()) } else { Err(violation()) }
}

impl EpisodeFacts {
    /// Returns whether the server announced a result.
    pub(crate) fn has_result(&self) -> bool {
        self.end.as_ref().is_some_and(|end| end.reason() != EndReason::ServerFault)
    }

    /// Takes the position of a resumed episode.
    fn resume(&mut self, at: &v1::SlotPosition) -> Checked {
        check(!self.has_result(), || format!("{at:?} goes on after its end: {:?}", self.end))?;
        check(at.step >= self.seen, || format!("{at:?} lost steps: the agent saw step {}", self.seen))?;
        check(at.step <= self.sent, || format!("{at:?} is ahead of the last action, {}", self.sent))
    }

    fn observe(&mut self, seen: &v1::Observation) -> Checked {
        let step = seen.step;
        check(step <= self.sent, || format!("step {step} without an action: {seen:?}"))?;
        let pose = seen.pose.unwrap_or_default();
        let sight = (
            [pose.x_m, pose.y_m, pose.z_m, pose.heading_rad].map(f32::to_bits),
            [seen.remaining_steps, seen.remaining_submits],
            seen.feedback,
            seen.terminated,
            seen.truncated,
        );
        let before = *self.observations.entry(step).or_insert(sight);
        // A lost step may be repeated only before its observation was sent.
        check(before == sight, || format!("step {step} was {before:?} and is now {seen:?}"))?;
        self.seen = self.seen.max(step);
        if seen.terminated || seen.truncated {
            self.last = Some(seen.reason());
        }
        Ok(())
    }

    fn finish(&mut self, end: &v1::EpisodeEnd) -> Checked {
        let is_fault = end.reason() == EndReason::ServerFault;
        if let Some(before) = &self.end {
            let is_same = (before.reason, before.step) == (end.reason, end.step)
                && (before.metrics == end.metrics || before.metrics.is_none() || end.metrics.is_none());
            // A lost attempt has no steps when a client asks for it later.
            let is_same = is_same || is_fault && before.reason == end.reason;
            return check(is_same, || format!("the end was {before:?} and is now {end:?}"));
        }
        if !is_fault {
            let steps = self.seen..=self.sent;
            check(steps.contains(&end.step), || format!("{end:?} but {steps:?} steps were seen and sent"))?;
            check(self.last.is_none_or(|last| last == end.reason()), || {
                format!("{end:?} after an observation with {:?}", self.last)
            })?;
        }
        self.end = Some(end.clone());
        Ok(())
    }
}

impl RunFacts {
    pub(crate) fn new(
        id: String,
        (team, phase): (usize, usize),
        request_id: String,
        started: Duration,
    ) -> Self {
        let episodes = BTreeMap::new();
        Self { id, team, phase, request_id, started, attachments: 0, episodes, is_complete: false }
    }

    pub(crate) fn episode(&mut self, handle: &str) -> &mut EpisodeFacts {
        self.episodes.entry(handle.to_owned()).or_default()
    }

    /// Takes a frame. Fails if it contradicts the frames before. Frames that are not `fresh` may be older than others.
    pub(crate) fn take(&mut self, frame: &Frame, fresh: bool) -> Checked {
        match frame {
            Frame::Welcome(welcome) if fresh => self.take_welcome(welcome),
            Frame::Welcome(_) => Ok(()),
            Frame::EpisodeStart(start) => self.start(start, fresh),
            Frame::Observation(seen) => self.episode(&seen.episode).observe(seen),
            Frame::EpisodeEnd(end) => self.episode(&end.episode).finish(end),
            Frame::RunEnd(end) => self.finish(end),
            Frame::Fault(_) | Frame::Notice(_) | Frame::Ping(_) => Ok(()),
        }
    }

    pub(crate) fn take_welcome(&mut self, welcome: &v1::Welcome) -> Checked {
        check(welcome.run == self.id, || format!("welcome of another run: {welcome:?}"))?;
        check((1..=crate::setting::SLOTS).contains(&welcome.slots), || format!("{welcome:?}"))?;
        welcome.resumed.iter().try_for_each(|at| self.episode(&at.episode).resume(at))
    }

    pub(crate) fn start(&mut self, start: &v1::EpisodeStart, fresh: bool) -> Checked {
        let Some(seen) = &start.observation else { return Err(format!("nothing to see in {start:?}")) };
        let at = v1::SlotPosition { slot: start.slot, episode: start.episode.clone(), step: seen.step };
        let episode = self.episode(&start.episode);
        if fresh {
            episode.slot = start.slot;
            episode.resume(&at)?;
        }
        episode.observe(seen)
    }

    pub(crate) fn finish(&mut self, end: &v1::RunEnd) -> Checked {
        check(end.run == self.id, || format!("the end of another run: {end:?}"))?;
        check(!self.is_complete || end.complete, || format!("the run is no longer complete: {end:?}"))?;
        self.is_complete |= end.complete;
        Ok(())
    }
}
