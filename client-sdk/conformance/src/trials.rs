//! Faults injected into a client run.

/// Episode fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Trick {
    Nothing,
    /// A Notice and a Ping come before an observation.
    Interrupt,
    /// A frame unknown to all clients with this version.
    Mumble,
    /// An observation comes late.
    Dawdle,
    /// The stream breaks after an observation.
    Cut,
    /// The stream ends after an observation, without a word.
    Hush,
    /// The stream breaks after an observation, and the server is unreachable at first.
    Leave,
    /// The stream breaks before EpisodeStart.
    LoseStart,
    /// The stream breaks before the observation that answers an action.
    LoseAnswer,
    /// The stream breaks before EpisodeEnd.
    LoseEnd,
    /// The simulator fails: a Fault and EpisodeEnd come instead of an observation.
    Break,
}

/// An episode with the expected client behaviour.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Trial {
    pub(crate) trick: Trick,
    pub(crate) rule: &'static str,
}

const fn trial(trick: Trick, rule: &'static str) -> Trial {
    Trial { trick, rule }
}

/// In run order.
pub(crate) const TRIALS: [Trial; 12] = [
    trial(Trick::Nothing, "an episode is played to its end"),
    trial(Trick::Interrupt, "Ping is answered by Pong with its nonce, and Notice changes nothing"),
    trial(Trick::Mumble, "a frame that the client does not know changes nothing"),
    trial(Trick::Dawdle, "an observation that takes three seconds is waited for"),
    trial(Trick::Cut, "after a broken stream the client comes back with Hello.resume and what it knows"),
    trial(Trick::Hush, "a stream that ends without RunEnd is a broken stream"),
    trial(Trick::Leave, "a server that is not there at first is dialled again"),
    trial(Trick::LoseStart, "an EpisodeStart that was lost comes after Welcome, without another Ready"),
    trial(Trick::LoseAnswer, "an action whose answer was lost is not another action when it is sent again"),
    trial(Trick::LoseEnd, "an EpisodeEnd that was lost comes after Welcome"),
    trial(Trick::Break, "an episode that the server's fault ends is followed by the next"),
    trial(Trick::Nothing, "the run is played to its RunEnd"),
];
