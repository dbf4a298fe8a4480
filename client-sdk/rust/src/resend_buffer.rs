//! Sent and received frames per slot, for resuming after a lost connection.

use avln_proto::v1::{self, play_request::Frame as Sent, play_response::Frame as Arrived};

/// A run's slots from the client's perspective.
#[derive(Debug, Default)]
pub(crate) struct ResendBuffer {
    slots: Vec<SlotBuffer>,
    goodbye_sent: bool,
    /// RunEnd was received.
    pub(crate) is_over: bool,
}

#[derive(Debug, Default)]
struct SlotBuffer {
    /// Open episode and last received step.
    received: Option<(String, u32)>,
    // The protocol permits one pending request per slot, so a single frame suffices.
    unanswered: Option<Sent>,
}

impl ResendBuffer {
    pub(crate) fn new(slots: u32) -> Self {
        Self { slots: (0..slots).map(|_| SlotBuffer::default()).collect(), ..Self::default() }
    }

    fn slot(&mut self, slot: u32) -> Option<&mut SlotBuffer> {
        self.slots.get_mut(usize::try_from(slot).ok()?)
    }

    pub(crate) fn sending(&mut self, frame: &Sent) {
        let slot = match frame {
            Sent::Ready(ready) => ready.slot,
            Sent::Act(act) => act.slot,
            Sent::Abandon(abandon) => abandon.slot,
            Sent::Goodbye(_) => {
                self.goodbye_sent = true;
                return;
            }
            // Specific to a stream.
            Sent::Hello(_) | Sent::Pong(_) => return,
        };
        if let Some(slot) = self.slot(slot) {
            slot.unanswered = Some(frame.clone());
        }
    }

    /// Records a received frame; returns false for a repeated observation.
    pub(crate) fn arrived(&mut self, frame: &Arrived) -> bool {
        match frame {
            Arrived::EpisodeStart(start) => {
                if let Some(slot) = self.slot(start.slot) {
                    let step = start.observation.as_ref().map_or(0, |seen| seen.step);
                    *slot = SlotBuffer { received: Some((start.episode.clone(), step)), unanswered: None };
                }
            }
            Arrived::Observation(seen) => {
                return self.slot(seen.slot).is_none_or(|slot| slot.observed(&seen.episode, seen.step));
            }
            Arrived::EpisodeEnd(end) => {
                if let Some(slot) = self.slot(end.slot).filter(|slot| slot.has_episode(&end.episode)) {
                    *slot = SlotBuffer::default();
                }
            }
            // The refused frame changed nothing on the server and must not be resent.
            Arrived::Fault(v1::Fault { slot: Some(slot), recoverable: true, .. }) => {
                if let Some(slot) = self.slot(*slot) {
                    slot.unanswered = None;
                }
            }
            Arrived::RunEnd(_) => self.is_over = true,
            _ => {}
        }
        true
    }

    /// Returns the last received steps for Hello.
    pub(crate) fn known(&self) -> Vec<v1::SlotPosition> {
        let position = |(slot, buffer): (u32, &SlotBuffer)| {
            let (episode, step) = buffer.received.clone()?;
            Some(v1::SlotPosition { slot, episode, step })
        };
        (0..).zip(&self.slots).filter_map(position).collect()
    }

    /// Returns the frames to resend, given the server's slot positions.
    pub(crate) fn to_repeat(&self, resumed: &[v1::SlotPosition]) -> Vec<Sent> {
        let again = |(slot, buffer): (u32, &SlotBuffer)| {
            let there = resumed.iter().find(|position| position.slot == slot);
            buffer.unanswered.clone().filter(|frame| match (frame, there) {
                // With a position the episode has begun, and the server resends EpisodeStart itself.
                (Sent::Ready(_), there) => there.is_none(),
                // At a later step the action was taken, and the observation is on the way.
                (Sent::Act(act), Some(there)) => act.episode == there.episode && act.step == there.step + 1,
                // Without a position the episode has ended, and EpisodeEnd is on the way.
                (_, there) => there.is_some(),
            })
        };
        let goodbye = self.goodbye_sent.then_some(Sent::Goodbye(v1::Goodbye { pause: false }));
        (0..).zip(&self.slots).filter_map(again).chain(goodbye).collect()
    }

    /// Returns true if `fault` reports a lost episode.
    pub(crate) fn is_gone(&self, fault: &v1::Fault) -> bool {
        let slot = fault.slot.and_then(|slot| self.slots.get(slot as usize));
        fault.reason() == v1::Reason::EpisodeUnknown
            && slot.is_some_and(|slot| slot.has_episode(&fault.episode))
    }
}

impl SlotBuffer {
    fn has_episode(&self, episode: &str) -> bool {
        self.received.as_ref().is_some_and(|(known, _)| known == episode)
    }

    fn observed(&mut self, episode: &str, step: u32) -> bool {
        let Some((_, last)) = self.received.as_mut().filter(|(known, _)| known == episode) else {
            return true;
        };
        if step <= *last {
            return false;
        }
        *last = step;
        self.unanswered = None;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn act(step: u32) -> Sent {
        Sent::Act(v1::Act { slot: 0, episode: "ep_a".into(), step, action: 1 })
    }

    fn seen(step: u32) -> Arrived {
        Arrived::Observation(v1::Observation { episode: "ep_a".into(), step, ..v1::Observation::default() })
    }

    fn at(step: u32) -> Vec<v1::SlotPosition> {
        vec![v1::SlotPosition { slot: 0, episode: "ep_a".into(), step }]
    }

    fn begun() -> ResendBuffer {
        let mut buffer = ResendBuffer::new(2);
        buffer.sending(&Sent::Ready(v1::Ready { slot: 0 }));
        buffer.arrived(&Arrived::EpisodeStart(v1::EpisodeStart {
            episode: "ep_a".into(),
            ..v1::EpisodeStart::default()
        }));
        buffer
    }

    #[test]
    fn only_untaken_actions_are_resent() {
        let mut buffer = begun();
        assert!(buffer.to_repeat(&at(0)).is_empty());
        buffer.sending(&act(1));
        assert_eq!(buffer.to_repeat(&at(0)), [act(1)]);
        assert!(buffer.to_repeat(&at(1)).is_empty(), "its result is on its way");
        assert!(buffer.to_repeat(&[]).is_empty(), "the episode is over, and its end on its way");
        assert!(buffer.arrived(&seen(1)));
        assert!(buffer.to_repeat(&at(1)).is_empty());
        assert_eq!(buffer.known(), at(1));
    }

    #[test]
    fn duplicates_and_new_frames_are_distinguished() {
        let mut buffer = begun();
        assert!(!buffer.arrived(&seen(0)));
        assert!(buffer.arrived(&seen(1)));
        assert!(!buffer.arrived(&seen(1)));
    }

    #[test]
    fn ready_is_resent_without_episode_start() {
        let ready = Sent::Ready(v1::Ready { slot: 1 });
        let mut buffer = begun();
        buffer.sending(&ready);
        assert_eq!(buffer.to_repeat(&at(0)), [ready]);
        let both = [at(0), vec![v1::SlotPosition { slot: 1, episode: "ep_b".into(), step: 0 }]].concat();
        assert!(buffer.to_repeat(&both).is_empty());
    }

    #[test]
    fn goodbye_is_said_again() {
        let mut buffer = begun();
        buffer.sending(&Sent::Goodbye(v1::Goodbye { pause: false }));
        assert_eq!(buffer.to_repeat(&at(0)), [Sent::Goodbye(v1::Goodbye { pause: false })]);
    }
}
