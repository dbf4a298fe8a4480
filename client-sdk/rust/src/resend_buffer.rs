//! Sent and received frames per slot, for resuming after a lost connection.

use avln_proto::v1::{self, play_request::Frame as Sent, play_response::Frame as Arrived};

/// A run's slots from the client's perspective.
#[derive(Debug, Default)]
pub(crate) struct ResendBuffer {
    slots: Vec<SlotBuffer>,
    /// Goodbye was said.
    goodbye: bool,
    /// RunEnd was received: the run is complete.
    over: bool,
}

#[derive(Debug, Default)]
struct SlotBuffer {
    /// Open episode, and the step of the last received observation.
    holds: Option<(String, u32)>,
    /// Unanswered frame.
    open: Option<Sent>,
}

impl ResendBuffer {
    pub(crate) fn new(slots: u32) -> Self {
        Self { slots: (0..slots).map(|_| SlotBuffer::default()).collect(), goodbye: false, over: false }
    }

    fn slot(&mut self, slot: u32) -> Option<&mut SlotBuffer> {
        self.slots.get_mut(usize::try_from(slot).ok()?)
    }

    /// Notes a frame that is about to be sent.
    pub(crate) fn sending(&mut self, frame: &Sent) {
        let slot = match frame {
            Sent::Ready(ready) => ready.slot,
            Sent::Act(act) => act.slot,
            Sent::Abandon(abandon) => abandon.slot,
            Sent::Goodbye(_) => {
                self.goodbye = true;
                return;
            }
            Sent::Hello(_) | Sent::Pong(_) => return,
        };
        if let Some(slot) = self.slot(slot) {
            slot.open = Some(frame.clone());
        }
    }

    /// Notes a frame that arrived; false when it had arrived before.
    pub(crate) fn arrived(&mut self, frame: &Arrived) -> bool {
        match frame {
            Arrived::EpisodeStart(start) => {
                let Some(slot) = self.slot(start.slot) else { return true };
                let step = start.observation.as_ref().map_or(0, |seen| seen.step);
                *slot = SlotBuffer { holds: Some((start.episode.clone(), step)), open: None };
                true
            }
            Arrived::Observation(seen) => {
                let Some(slot) = self.slot(seen.slot) else { return true };
                slot.observed(&seen.episode, seen.step)
            }
            Arrived::EpisodeEnd(end) => {
                if let Some(slot) = self.slot(end.slot).filter(|slot| slot.holds_episode(&end.episode)) {
                    *slot = SlotBuffer::default();
                }
                true
            }
            Arrived::Fault(v1::Fault { slot: Some(slot), recoverable: true, .. }) => {
                if let Some(slot) = self.slot(*slot) {
                    slot.open = None;
                }
                true
            }
            Arrived::RunEnd(_) => {
                self.over = true;
                true
            }
            _ => true,
        }
    }

    /// Returns true if the run has ended.
    pub(crate) fn is_over(&self) -> bool {
        self.over
    }

    /// Last received steps for Hello.
    pub(crate) fn known(&self) -> Vec<v1::SlotPosition> {
        let position = |(slot, buffer): (u32, &SlotBuffer)| {
            let (episode, step) = buffer.holds.clone()?;
            Some(v1::SlotPosition { slot, episode, step })
        };
        (0..).zip(&self.slots).filter_map(position).collect()
    }

    /// Frames to resend, given the server's slot positions.
    pub(crate) fn to_repeat(&self, resumed: &[v1::SlotPosition]) -> Vec<Sent> {
        let again = |(slot, buffer): (u32, &SlotBuffer)| {
            let there = resumed.iter().find(|position| position.slot == slot);
            buffer.open.clone().filter(|open| match (open, there) {
                (Sent::Ready(_), there) => there.is_none(),
                (Sent::Act(act), Some(there)) => act.episode == there.episode && act.step == there.step + 1,
                (_, there) => there.is_some(),
            })
        };
        let goodbye = self.goodbye.then_some(Sent::Goodbye(v1::Goodbye { pause: false }));
        (0..).zip(&self.slots).filter_map(again).chain(goodbye).collect()
    }

    /// Returns true if `fault` reports a slot's lost episode.
    pub(crate) fn is_gone(&self, fault: &v1::Fault) -> bool {
        let slot = fault.slot.and_then(|slot| self.slots.get(slot as usize));
        fault.reason() == v1::Reason::EpisodeUnknown
            && slot.is_some_and(|slot| slot.holds_episode(&fault.episode))
    }
}

impl SlotBuffer {
    fn holds_episode(&self, episode: &str) -> bool {
        self.holds.as_ref().is_some_and(|(held, _)| held == episode)
    }

    fn observed(&mut self, episode: &str, step: u32) -> bool {
        let Some((held, last)) = &mut self.holds else { return true };
        if held != episode {
            return true;
        }
        if step <= *last {
            return false;
        }
        *last = step;
        self.open = None;
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
    fn an_action_is_sent_again_only_where_it_was_not_taken() {
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
    fn what_arrived_before_is_told_from_what_is_new() {
        let mut buffer = begun();
        assert!(!buffer.arrived(&seen(0)));
        assert!(buffer.arrived(&seen(1)));
        assert!(!buffer.arrived(&seen(1)));
    }

    #[test]
    fn ready_is_sent_again_where_no_episode_began() {
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
