//! Scenarios of client checks: injected faults with the expected behaviour.

/// Scenario of a hosted run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scenario {
    /// Faults after which the client plays on.
    #[default]
    Faults,
    /// End of the run while the client is disconnected.
    Ended,
    /// Takeover of the run by another connection.
    Superseded,
}

/// An episode with its fault and the expected behaviour.
pub(crate) type Trial = (InjectedFault, &'static str);

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
    /// The server stops after an observation and returns.
    Draining,
    /// The stream breaks after an observation, and the server cannot restore the episode.
    Reissued,
    /// The stream breaks after an observation, and the run ends.
    EndedAway,
    /// Another connection takes over the run after an observation.
    Superseded,
}

use InjectedFault as F;

const FAULTS: [Trial; 14] = [
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
    (F::Draining, "after DRAINING the client sends Hello.resume with its last step"),
    (F::Reissued, "after EPISODE_UNKNOWN the client sends Ready and drops the old handle"),
    (F::None, "the run is played to its RunEnd"),
];

const ENDED: [Trial; 2] = [
    FAULTS[0],
    (F::EndedAway, "the client accepts EpisodeEnd and RunEnd instead of Welcome and opens no other stream"),
];

const SUPERSEDED: [Trial; 2] =
    [FAULTS[0], (F::Superseded, "after SUPERSEDED the client makes no call for five seconds")];

impl Scenario {
    /// Returns the episodes in run order.
    pub(crate) fn trials(self) -> &'static [Trial] {
        match self {
            Self::Faults => &FAULTS,
            Self::Ended => &ENDED,
            Self::Superseded => &SUPERSEDED,
        }
    }
}

impl InjectedFault {
    /// Returns true if the client has to resume after it.
    pub(crate) fn needs_resume(self) -> bool {
        let broken =
            matches!(self, Self::BrokenStream | Self::SilentEnd | Self::Unreachable | Self::Draining);
        let lost = matches!(self, Self::LostStart | Self::LostObservation | Self::LostEnd | Self::Reissued);
        broken || lost
    }

    /// Returns true if it has no equivalent in unary calls.
    pub(crate) fn needs_stream(self) -> bool {
        let frames = matches!(self, Self::NoticeAndPing | Self::UnknownFrame);
        let ends = matches!(self, Self::BrokenStream | Self::SilentEnd | Self::Draining | Self::EndedAway);
        frames || ends
    }

    /// Returns true if the client must not play after it.
    pub(crate) fn finishes_client(self) -> bool {
        matches!(self, Self::EndedAway | Self::Superseded)
    }

    /// Returns true if the fault is due at a certain step.
    pub(crate) fn needs_steps(self) -> bool {
        !matches!(self, Self::None | Self::LostStart | Self::LostEnd)
    }
}
