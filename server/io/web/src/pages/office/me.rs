use super::{Frame, Page, Part, Shell, back, unknown, write};
use crate::{
    office::{Desk, Fields, Form, SignedIn, TeamDeed},
    trouble::Trouble,
    visit::now_unix_ms,
    words,
};
use askama::Template;
use avln_store::{Quota, Reader, RunLine, TokenLine, Viewer};
use axum::{
    Extension,
    extract::State,
    response::{IntoResponse, Redirect, Response},
};
use std::sync::Arc;

/// Runs in the list.
const RUNS_TOLD: u32 = 100;
/// Most days that a token can be given.
const MAX_DAYS: u32 = 3650;

#[derive(Template)]
#[template(path = "me.html")]
struct MyPage {
    shell: Shell,
    frame: Frame,
    by: SignedIn,
    team: String,
    /// A token that was made just now.
    secret: Option<String>,
    tokens: Vec<TokenLine>,
    quotas: Vec<Quota>,
    runs: Vec<RunLine>,
    now_unix_ms: i64,
}

/// What a team has here: tokens, quotas, runs. The organiser has other pages.
pub(super) async fn page(
    State(reader): State<Reader>,
    Extension(desk): Extension<Arc<Desk>>,
    by: SignedIn,
) -> Result<Response, Trouble> {
    if by.holder.viewer == Viewer::Organiser {
        return Ok(Redirect::to("/organise").into_response());
    }
    Ok(show(&reader, &desk, by, None).await?.into_response())
}

/// Does what a form of the page asks for.
pub(super) async fn act(
    State(reader): State<Reader>,
    Extension(desk): Extension<Arc<Desk>>,
    Form { by, fields }: Form,
) -> Result<Response, Trouble> {
    let done = desk.office.act(by.member()?, deed(&fields)?).await?;
    match done.secret {
        None => Ok(back(&desk, &by, done, "/me")),
        secret => Ok(show(&reader, &desk, by, secret).await?.into_response()),
    }
}

fn deed(fields: &Fields) -> Result<TeamDeed, Trouble> {
    Ok(match fields.get("deed")? {
        "issue" => TeamDeed::IssueToken {
            name: fields.name("name")?,
            looks_only: fields.get("kind")? == "read_only",
            days: fields.maybe_number("days", 1..=MAX_DAYS)?,
        },
        "revoke" => TeamDeed::RevokeToken { id: fields.name("id")? },
        "cancel" => TeamDeed::CancelRun { run: fields.name("run")? },
        other => return Err(unknown(other)),
    })
}

async fn show(reader: &Reader, desk: &Desk, by: SignedIn, secret: Option<String>) -> Page {
    let viewer = &by.holder.viewer;
    let Viewer::Team(team) = viewer.clone() else { return Err(Trouble::NoPage) };
    let now_unix_ms = now_unix_ms();
    write(&MyPage {
        shell: Shell::new("My page", Part::Own),
        frame: Frame::new(desk, &by),
        tokens: reader.own_tokens(viewer).await?,
        quotas: reader.quotas(viewer, now_unix_ms).await?,
        runs: reader.own_runs(viewer, RUNS_TOLD).await?,
        team,
        secret,
        now_unix_ms,
        by,
    })
}

impl MyPage {
    /// Whether the visitor may change something.
    fn may_act(&self) -> bool {
        !self.by.holder.read_only
    }

    fn is_own(&self, token: &TokenLine) -> bool {
        token.id == self.by.holder.token
    }

    /// What a token is worth now.
    fn state(&self, token: &TokenLine) -> &'static str {
        match (token.revoked_ms, token.expires_ms) {
            (Some(_), _) => "taken back",
            (None, Some(moment)) if moment <= self.now_unix_ms => "expired",
            _ => "holds",
        }
    }

    fn holds(&self, token: &TokenLine) -> bool {
        self.state(token) == "holds"
    }
}
