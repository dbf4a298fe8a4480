use avln_episode::{Encodings, Sensors};
use std::time::Duration;

/// Every limit of the agents' door. The defaults suit a public server; each field says what it protects.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Open connections at once: each costs a file descriptor and some tens of kilobytes.
    pub max_connections: usize,
    /// Open connections at once from one address, so that one host cannot take all places.
    pub max_connections_per_address: usize,
    /// Play sessions at once: each holds at least one scene alive.
    pub max_sessions: usize,
    /// Runs watched at once through WatchRun: each is looked up once a second.
    pub max_watchers: usize,
    /// Steps simulated at once: more than there are processor cores only makes every step slower.
    pub max_simulations: usize,
    /// Slots of all sessions together, shared out among the teams that play: each holds an episode, some 10 MiB beside its
    /// scene. A session has one at least.
    pub max_slots: u32,
    /// Simulations that may hang before no run starts any more: each has taken a thread, its memory and maybe a core.
    pub max_hanging: usize,
    /// Longest step of the simulator; a usual one takes milliseconds. One that takes longer hangs: its episode is played again.
    pub step: Duration,
    /// Longest first observation, which may have to prepare what a scene is seen and heard by.
    pub preparation: Duration,
    /// Bytes in one message of an agent: actions take tens of bytes.
    pub decode_bytes: usize,
    /// Bytes in one message to an agent: the largest observation and mission, see [`Limits::frame_bytes`].
    pub encode_bytes: usize,
    /// Bytes of an HTTP/2 header block: a token and some metadata.
    pub header_bytes: u32,
    /// Bytes of an HTTP/2 frame that an agent may send.
    pub http2_frame_bytes: u32,
    /// Calls at once on one connection.
    pub http2_streams: u32,
    /// Time from connecting to the first whole request; afterwards keepalive judges the connection.
    pub first_request: Duration,
    /// Silence after which the transport asks whether the peer still lives.
    pub keepalive_interval: Duration,
    /// Time to answer that; the transport of a busy agent answers for it.
    pub keepalive_timeout: Duration,
    /// Time from opening a Play stream to its Hello.
    pub hello: Duration,
    /// Time between two Pings: they measure the wire, and keep proxies from cutting silent streams.
    pub ping_interval: Duration,
    /// Most time on the wire, there and back, that is not charged to an agent: a client measures it together with the server and
    /// could stretch it.
    pub wire: Duration,
    /// Time between two looks for runs whose time is over.
    pub overdue_interval: Duration,
    /// Time for which an agent may leave a message unread before it counts as gone.
    pub reader_stall: Duration,
    /// Episodes in a row that may run out of time before the run ends: the agent hangs.
    pub timeouts_in_a_row: u32,
    /// Silence after which a run that is played by unary calls counts as gone.
    pub unary_idle: Duration,
    /// Time that a new Play stream waits for the one it supersedes to put its episodes away.
    pub handover: Duration,
    /// Time for running episodes to be put away and connections to close when the server stops.
    pub drain: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        let seconds = Duration::from_secs;
        Self {
            max_connections: 1024,
            max_connections_per_address: 256,
            max_sessions: 256,
            max_watchers: 256,
            max_simulations: std::thread::available_parallelism().map_or(2, usize::from),
            max_slots: 256,
            max_hanging: 4,
            step: seconds(120),
            preparation: seconds(600),
            decode_bytes: 64 << 10,
            encode_bytes: 16 << 20,
            header_bytes: 16 << 10,
            http2_frame_bytes: 256 << 10,
            http2_streams: 128,
            first_request: seconds(10),
            keepalive_interval: seconds(30),
            keepalive_timeout: seconds(20),
            hello: seconds(10),
            ping_interval: seconds(15),
            wire: seconds(1),
            overdue_interval: seconds(1),
            reader_stall: seconds(30),
            timeouts_in_a_row: 20,
            unary_idle: seconds(120),
            handover: seconds(30),
            drain: seconds(20),
        }
    }
}

impl Limits {
    /// Most slots on one Play stream, whatever a phase allows.
    pub const MAX_SLOTS: u32 = 64;
    /// Longest bearer token, bytes.
    pub const MAX_TOKEN_BYTES: usize = 512;
    /// Longest name, version or id that an agent may send, bytes.
    pub const MAX_TEXT_BYTES: usize = 200;
    /// Room in one frame for the cues of a mission: 4 pictures of 1 MiB.
    const MISSION_BYTES: u64 = 4 << 20;
    /// Room in one frame for field tags, ids and texts.
    const ENVELOPE_BYTES: u64 = 64 << 10;

    /// What is left of a text of an agent when it is repeated to it.
    pub(crate) fn shorten(text: &str) -> &str {
        let end = text.floor_char_boundary(Self::MAX_TEXT_BYTES);
        &text[..end]
    }

    /// Size of the largest frame that an agent with these sensors can be sent, bytes.
    ///
    /// `audio_samples` counts one ear.
    pub fn frame_bytes(sensors: &Sensors, audio_samples: u32) -> u64 {
        let pixels = u64::from(sensors.width) * u64::from(sensors.height);
        let rgb = if sensors.rgb { pixels * 3 } else { 0 };
        let depth = if sensors.depth { pixels * 4 } else { 0 };
        let audio = if sensors.audio { u64::from(audio_samples) * 2 * 4 } else { 0 };
        let senses = match sensors.encodings {
            encodings if encodings == Encodings::default() => rgb + depth + audio,
            _ => avln_codec::most_bytes(rgb) + avln_codec::most_bytes(depth) + audio,
        };
        senses + Self::MISSION_BYTES + Self::ENVELOPE_BYTES
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_episode::Encoding;

    #[test]
    fn the_largest_frame_is_the_sum_of_its_tensors_and_fits_the_encode_limit() {
        let sensors = Sensors::all(256, 256);
        let overhead = (4 << 20) + (64 << 10);
        assert_eq!(Limits::frame_bytes(&sensors, 4000), 196_608 + 262_144 + 32_000 + overhead);
        let silent = Sensors { audio: false, depth: false, ..sensors };
        assert_eq!(Limits::frame_bytes(&silent, 4000), 196_608 + overhead);
        let largest = Sensors::all(Sensors::MAX_SIDE, Sensors::MAX_SIDE);
        assert!(Limits::frame_bytes(&largest, 16_000) <= Limits::default().encode_bytes as u64);
        let packed = Encodings { rgb: Encoding::Png, depth: Encoding::Packed, ..Encodings::default() };
        let packed = Sensors { encodings: packed, ..largest };
        assert!(Limits::frame_bytes(&packed, 16_000) <= Limits::default().encode_bytes as u64);
    }
}
