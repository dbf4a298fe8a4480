//! Limits of connections, messages, queues and times (pings, handshakes), with reasons; and the pace of the calls on a connection,
//! so that a flood of cheap calls takes little processor time.

use avln_episode::{Encodings, Sensors};
use avln_proto::v1::play_service_server::SERVICE_NAME as PLAY_SERVICE;
use hyper::header::HeaderMap;
use parking_lot::Mutex;
use std::time::Duration;
use tokio::time::{Instant, sleep_until};

/// gRPC server limits. The defaults suit a public server.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Open connections. A connection costs a file descriptor and some tens of kilobytes.
    pub max_connections: usize,
    /// Open connections per address, so that no host can use all. An address also never holds more than half of the places
    /// that the others leave.
    pub max_connections_per_address: usize,
    /// Sessions. A session occupies the memory of at least one scene. A team may hold half of those that the others leave.
    pub max_sessions: usize,
    /// Calls of WatchRun in progress, shared like sessions. A watched run is looked up once per second.
    pub max_watchers: usize,
    /// Simulation threads. More threads than processor cores only slow every step down. Without threads, steps block the calling
    /// task: for simulations of the server, which must repeat.
    pub max_simulations: usize,
    /// Slots over all sessions, shared between active teams, at least one each. An episode takes about 10 MiB without the scene.
    pub max_slots: u32,
    /// Hanging simulations at which new runs are refused. A hanging simulation occupies a thread, memory and maybe a core.
    pub max_hanging: usize,
    /// Longest simulator step; typical are milliseconds. A longer step counts as hanging: the episode restarts.
    pub step: Duration,
    /// Longest first observation, including scene preparation for rendering and acoustics.
    pub preparation: Duration,
    /// Bytes per agent message. Actions take tens of bytes.
    pub decode_bytes: usize,
    /// Bytes per message to an agent: the largest observation and mission, see [`Limits::frame_bytes`].
    pub encode_bytes: usize,
    /// Bytes of an HTTP/2 header block: a token and metadata.
    pub header_bytes: u32,
    /// Bytes of an HTTP/2 frame that an agent may send.
    pub http2_frame_bytes: u32,
    /// Concurrent calls per connection.
    pub http2_streams: u32,
    /// Calls per second and connection, beyond those that play: further calls wait. Clients make a few per run.
    pub calls_per_s: u32,
    /// Time from connecting to the first complete request. Later, keepalive supervises the connection.
    pub first_request: Duration,
    /// Silence after which the transport sends an HTTP/2 ping.
    pub keepalive_interval: Duration,
    /// Time to answer an HTTP/2 ping. The transport of a busy agent answers for it.
    pub keepalive_timeout: Duration,
    /// Time from opening a Play stream to Hello.
    pub hello: Duration,
    /// Time between Pings. They measure the round trip and keep proxies from closing silent streams.
    pub ping_interval: Duration,
    /// Longest round trip that is not charged to an agent. The client takes part in the measurement and could stretch it.
    pub wire: Duration,
    /// Time between searches for expired runs.
    pub overdue_interval: Duration,
    /// Time after which a client with an unread message counts as disconnected.
    pub reader_stall: Duration,
    /// Consecutive timeouts after which the agent counts as hanging and the run ends.
    pub timeouts_in_a_row: u32,
    /// Silence after which a unary client counts as disconnected.
    pub unary_idle: Duration,
    /// Time that a new connection waits for the previous session to store open episodes.
    pub handover: Duration,
    /// Time to end sessions, and the same time to close connections, when the server stops.
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
            calls_per_s: 50,
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
    /// Slots per session, whatever the phase allows.
    pub const MAX_SLOTS: u32 = 64;
    /// Longest bearer token, bytes.
    pub const MAX_TOKEN_BYTES: usize = 512;
    /// Longest name, version or id from an agent, bytes.
    pub const MAX_TEXT_BYTES: usize = 200;
    /// Space in a frame for the cues of a mission: 4 pictures of 1 MiB.
    const MISSION_BYTES: u64 = 4 << 20;
    /// Space in a frame for field tags, ids and texts.
    const ENVELOPE_BYTES: u64 = 64 << 10;

    /// Shortens a text from an agent for use in a message.
    pub(crate) fn shorten(text: &str) -> &str {
        let end = text.floor_char_boundary(Self::MAX_TEXT_BYTES);
        &text[..end]
    }

    /// Returns the largest frame size with these sensors, bytes. `audio_samples` is per ear.
    pub fn frame_bytes(sensors: &Sensors, audio_samples: u32) -> u64 {
        let pixels = u64::from(sensors.width) * u64::from(sensors.height);
        let rgb = if sensors.rgb { pixels * 3 } else { 0 };
        let depth = if sensors.depth { pixels * 4 } else { 0 };
        let audio = if sensors.audio { u64::from(audio_samples) * 2 * 4 } else { 0 };
        let senses = match sensors.encodings {
            encodings if encodings == Encodings::default() => rgb + depth + audio,
            _ => avln_proto::wire::most_bytes(rgb) + avln_proto::wire::most_bytes(depth) + audio,
        };
        senses + Self::MISSION_BYTES + Self::ENVELOPE_BYTES
    }
}

/// Delays a connection's calls above a rate. Unary calls that play pass, unless they are refused: most of them simulate, in the
/// share of their team.
#[derive(Debug)]
pub(crate) struct CallPace {
    gap: Duration,
    /// Time at which the next call is due at the permitted rate.
    due: Mutex<Instant>,
}

impl CallPace {
    /// Permits `calls_per_s` calls per second, and as many at once.
    pub(crate) fn new(calls_per_s: u32, now: Instant) -> Self {
        Self { gap: Duration::from_secs(1) / calls_per_s.max(1), due: Mutex::new(now) }
    }

    /// Waits before a call of `path`. A call that is cancelled meanwhile counts: otherwise, cancelled calls would have no limit.
    pub(crate) async fn wait(&self, path: &str) {
        let now = Instant::now();
        let gap = if plays(path) { Duration::ZERO } else { self.gap };
        let turn = self.turn(now, gap);
        if turn > now {
            sleep_until(turn).await;
        }
    }

    /// Counts a call of `path` that plays, if its reply is a refusal.
    pub(crate) fn answered(&self, path: &str, reply: &HeaderMap) {
        if plays(path) && is_refused(reply) {
            self.turn(Instant::now(), self.gap);
        }
    }

    /// Moves the due time by `gap`, and returns the time of the call.
    fn turn(&self, now: Instant, gap: Duration) -> Instant {
        let mut due = self.due.lock();
        *due = (*due).max(now) + gap;
        // A second earlier: as many calls as are permitted per second may come at once.
        (*due).checked_sub(Duration::from_secs(1)).map_or(now, |turn| turn.max(now))
    }
}

/// Returns whether a call steps, begins or ends an episode. `Play` only opens a stream.
fn plays(path: &str) -> bool {
    let mut names = path.split('/').skip(1);
    names.next() == Some(PLAY_SERVICE) && names.next() != Some("Play")
}

/// Returns whether a call failed at once: then its status is in the headers.
fn is_refused(headers: &HeaderMap) -> bool {
    headers.get("grpc-status").is_some_and(|status| status != "0")
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_episode::Encoding;

    #[test]
    fn the_largest_frame_fits_the_encode_limit() {
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

    const STEP: &str = "/avln.v1.PlayService/Step";

    #[test]
    fn calls_keep_the_rate_after_a_burst() {
        let now = Instant::now();
        let pace = CallPace::new(10, now);
        let turns: Vec<_> = (0..30).map(|_| pace.turn(now, pace.gap) - now).collect();
        assert!(turns[..10].iter().all(Duration::is_zero), "{turns:?}");
        assert_eq!(turns[10], Duration::from_millis(100));
        assert_eq!(turns[29], Duration::from_secs(2));
        let later = now + Duration::from_secs(4);
        assert_eq!(pace.turn(later, pace.gap), later);
    }

    #[tokio::test(start_paused = true)]
    async fn steps_pass_until_one_is_refused_often() {
        let pace = CallPace::new(1, Instant::now());
        let mut refusal = HeaderMap::new();
        refusal.insert("grpc-status", "16".parse().unwrap());
        let begun = Instant::now();
        for _ in 0..100 {
            pace.wait(STEP).await;
            pace.answered(STEP, &HeaderMap::new());
        }
        assert_eq!(begun.elapsed(), Duration::ZERO);
        for _ in 0..4 {
            pace.answered(STEP, &refusal);
        }
        pace.wait(STEP).await;
        assert_eq!(begun.elapsed(), Duration::from_secs(3));
        for path in ["/avln.v1.InfoService/GetServerInfo", "/avln.v1.PlayService/Play"] {
            pace.wait(path).await;
        }
        assert_eq!(begun.elapsed(), Duration::from_secs(5));
    }

    #[tokio::test(start_paused = true)]
    async fn cancelled_calls_count() {
        let pace = CallPace::new(1, Instant::now());
        let begun = Instant::now();
        for _ in 0..3 {
            let _ = tokio::time::timeout(Duration::from_millis(1), pace.wait("/grpc.health.v1.Health/Check"))
                .await;
        }
        pace.wait("/grpc.health.v1.Health/Check").await;
        assert_eq!(begun.elapsed(), Duration::from_secs(3));
    }
}
