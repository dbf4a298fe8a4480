//! What visitors may do: teams to what is their own, the organiser to everything. Whoever wires this door hands in who does it;
//! here stands who may ask for it.

mod attempts;
mod form;
mod menu;
mod sessions;
mod signed;

pub(crate) use attempts::{Attempts, Peer};
pub(crate) use form::{Fields, Form, MAX_FORM_BYTES, SignInForm};
pub(crate) use menu::Menu;
pub(crate) use sessions::Sessions;
pub(crate) use signed::{Organiser, SignedIn, cookie, has_cookie, is_ours, no_cookie, recognised};

use std::{fmt, future::Future, pin::Pin, sync::Arc};

/// A team's token with which somebody asks for something.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Member {
    /// The team.
    pub team: String,
    /// The letters by which lists name the token.
    pub token: String,
    /// From when the token is void, milliseconds since 1970-01-01 UTC; `None` for never.
    pub expires_unix_ms: Option<i64>,
}

/// What a team may do to what is its own.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TeamDeed {
    /// Makes a token, which holds no longer than the one with which it is asked for.
    IssueToken {
        /// What to call it; may be empty.
        name: String,
        /// Whether it is for looking alone.
        looks_only: bool,
        /// For how many days it holds; `None` for as long as may be.
        days: Option<u32>,
    },
    /// Takes back a token.
    RevokeToken {
        /// The letters by which lists name it.
        id: String,
    },
    /// Gives up a run.
    CancelRun {
        /// Its id.
        run: String,
    },
}

/// By which organiser's token something is asked for, and why.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Because {
    /// The letters by which lists name the token.
    pub token: String,
    /// Why; may be empty where the deed says nothing else.
    pub reason: String,
}

/// What the organiser may do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Deed {
    /// Admits a team, or an admitted one again, and makes an account token for it.
    Admit {
        /// Its public name.
        team: String,
    },
    /// Lets a team play in a phase that asks for approval, or no more.
    Approve {
        /// The team.
        team: String,
        /// The phase.
        phase: String,
        /// Whether it may.
        approved: bool,
    },
    /// Gives a team runs beyond its quota; has a reason.
    Grant {
        /// The team.
        team: String,
        /// The phase.
        phase: String,
        /// How many, at least 1.
        runs: u32,
    },
    /// Lets no run start in a phase for now; has a reason, which everybody reads.
    Pause(String),
    /// Lets runs start again in a phase that was paused or closed by hand.
    Resume(String),
    /// Lets no more runs start in a phase.
    Close(String),
    /// Publishes what a closed phase had committed to.
    Reveal(String),
    /// Marks a run as verified, or no more.
    Verify {
        /// The run.
        run: String,
        /// Whether it is.
        verified: bool,
    },
    /// Takes a run off all boards, for the reason, which everybody reads.
    Disqualify(String),
    /// Puts a run back that was taken off the boards.
    Reinstate(String),
}

/// Something was done.
#[derive(Clone, Default, PartialEq, Eq)]
pub struct Done {
    /// What, for whoever asked for it.
    pub words: String,
    /// A token that was made. It is shown once and kept by nobody.
    pub secret: Option<String>,
}

impl fmt::Debug for Done {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Done").field("words", &self.words).finish_non_exhaustive()
    }
}

/// Why something was not done.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Undone {
    /// It cannot be done: the words are for whoever asked.
    #[error("{0}")]
    Refused(String),
    /// The server failed: the words are for its log.
    #[error("{0}")]
    Failed(String),
}

/// What comes later.
pub type Doing = Pin<Box<dyn Future<Output = Result<Done, Undone>> + Send>>;

/// What is going on in the server.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Health {
    /// Whether the server is about to stop, and why.
    pub draining: Option<String>,
    /// What is announced; empty: nothing.
    pub notice: String,
    /// Slots that hold an episode: the run, the number of the slot, steps taken.
    pub slots: Vec<(String, u32, u32)>,
    /// Steps since the server started.
    pub steps: u64,
    /// Bytes of scenes that are ready.
    pub scene_bytes: usize,
    /// Threads that simulate something without end.
    pub hanging: usize,
    /// Failures of the server's own since it started.
    pub faults: u64,
}

/// Who does what visitors may ask for. Every deed leaves a line in the audit list.
pub trait Office: fmt::Debug + Send + Sync {
    /// Does something for a team, to what is that team's own and nothing else.
    fn act(&self, member: Member, deed: TeamDeed) -> Doing;

    /// Does something for the organiser.
    fn organise(&self, because: Because, deed: Deed) -> Doing;

    /// What is going on.
    fn health(&self) -> Health;
}

/// The office of this door, with those who are signed in.
#[derive(Debug)]
pub(crate) struct Desk {
    pub(crate) office: Arc<dyn Office>,
    pub(crate) sessions: Sessions,
    pub(crate) attempts: Attempts,
    /// Whether the door speaks TLS.
    pub(crate) is_secure: bool,
}

impl Desk {
    pub(crate) fn new(office: Arc<dyn Office>, is_secure: bool) -> Self {
        Self { office, sessions: Sessions::default(), attempts: Attempts::default(), is_secure }
    }
}
