//! Pages for those who sign in: a team's own, and the organiser's.

mod audit;
mod health;
mod me;
mod phases;
mod runs;
mod sign_in;
mod teams;

use super::{Page, Part, Shell, segment, write};
use crate::{
    office::{Desk, Done, Organiser, SignedIn},
    trouble::Trouble,
};
use avln_store::Reader;
use axum::{
    Router,
    response::{IntoResponse, Redirect, Response},
    routing::{get, post},
};

/// Where the pages are.
pub(crate) fn router() -> Router<Reader> {
    Router::new()
        .route("/sign-in", get(sign_in::page).post(sign_in::enter))
        .route("/sign-out", post(sign_in::leave).get(async || Redirect::to("/sign-in")))
        .route("/me", get(me::page).post(me::act))
        .route("/organise", get(phases::list))
        .route("/organise/phases/{phase}", get(phases::one).post(phases::act))
        .route("/organise/teams", get(teams::page).post(teams::act))
        .route("/organise/runs", get(runs::list))
        .route("/organise/runs/{run}", get(runs::one).post(runs::act))
        .route("/organise/audit", get(audit::page))
        .route("/organise/health", get(health::page))
}

/// What stands on every page of somebody who is signed in.
struct Frame {
    /// What its forms carry.
    key: String,
    /// What was done last.
    said: Option<String>,
}

impl Frame {
    fn new(desk: &Desk, by: &SignedIn) -> Self {
        Self { key: by.form_key(), said: desk.sessions.said(&by.id) }
    }
}

/// The organiser's pages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Tab {
    Phases,
    Teams,
    Runs,
    Audit,
    Health,
}

impl Tab {
    const ALL: [Self; 5] = [Self::Phases, Self::Teams, Self::Runs, Self::Audit, Self::Health];

    fn name(self) -> &'static str {
        match self {
            Self::Phases => "Phases",
            Self::Teams => "Teams",
            Self::Runs => "Runs",
            Self::Audit => "Audit",
            Self::Health => "Health",
        }
    }

    fn href(self) -> &'static str {
        match self {
            Self::Phases => "/organise",
            Self::Teams => "/organise/teams",
            Self::Runs => "/organise/runs",
            Self::Audit => "/organise/audit",
            Self::Health => "/organise/health",
        }
    }

    /// Each page and whether it is this one, as `aria-current` has it.
    fn tabs(self) -> [(&'static str, &'static str, &'static str); 5] {
        Self::ALL.map(|tab| (tab.name(), tab.href(), if tab == self { "page" } else { "false" }))
    }

    /// What stands around this page.
    fn shell(self, title: impl Into<String>) -> Shell {
        let shell = Shell::new(title, Part::Own);
        if self == Self::Phases { shell } else { shell.below("Organise", Self::Phases.href()) }
    }
}

/// Notes what was done and leads back to a page, so that to load that again does nothing again.
fn back(desk: &Desk, by: &SignedIn, done: Done, to: &str) -> Response {
    desk.sessions.say(&by.id, done.words);
    Redirect::to(to).into_response()
}

/// What a form asks for that this page does not do.
fn unknown(deed: &str) -> Trouble {
    Trouble::Invalid(format!("'{deed}' is nothing that can be done here"))
}
