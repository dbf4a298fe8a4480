use super::{Frame, Organiser, Page, Tab, back, unknown, write};
use crate::{
    office::{Deed, Desk, Fields, Form},
    pages::{Part, Shell},
    trouble::Trouble,
    visit::now_unix_ms,
    words,
};
use askama::Template;
use avln_store::{PhaseView, Reader, TeamsView, Viewer};
use axum::{
    Extension,
    extract::State,
    response::{IntoResponse, Response},
};
use std::sync::Arc;

/// Most runs of one grant.
const MAX_RUNS: u32 = 1000;

#[derive(Template)]
#[template(path = "organise_teams.html")]
struct TeamsPage {
    shell: Shell,
    frame: Frame,
    tab: Tab,
    view: TeamsView,
    phases: Vec<PhaseView>,
    /// A token that was made just now.
    secret: Option<String>,
}

/// All teams.
pub(super) async fn page(
    organiser: Organiser,
    State(reader): State<Reader>,
    Extension(desk): Extension<Arc<Desk>>,
) -> Page {
    show(&reader, Frame::new(&desk, &organiser.0), None).await
}

/// Does what a form of the page asks for.
pub(super) async fn act(
    organiser: Organiser,
    State(reader): State<Reader>,
    Extension(desk): Extension<Arc<Desk>>,
    Form { by, fields }: Form,
) -> Result<Response, Trouble> {
    let (deed, reason) = deed(&fields)?;
    let done = desk.office.organise(organiser.because(reason), deed).await?;
    if done.secret.is_none() {
        return Ok(back(&desk, &by, done, Tab::Teams.href()));
    }
    let frame = Frame { said: Some(done.words), ..Frame::new(&desk, &by) };
    Ok(show(&reader, frame, done.secret).await?.into_response())
}

fn deed(fields: &Fields) -> Result<(Deed, String), Trouble> {
    let team = fields.name("team")?;
    let phase = || fields.name("phase");
    Ok(match fields.get("deed")? {
        "admit" => (Deed::Admit { team }, fields.maybe_reason()?),
        "grant" => {
            let runs = fields.number("runs", 1..=MAX_RUNS)?;
            (Deed::Grant { team, phase: phase()?, runs }, fields.reason()?)
        }
        "approve" => {
            let approved = fields.get("approved")? == "yes";
            (Deed::Approve { team, phase: phase()?, approved }, fields.maybe_reason()?)
        }
        other => return Err(unknown(other)),
    })
}

async fn show(reader: &Reader, frame: Frame, secret: Option<String>) -> Page {
    let now_unix_ms = now_unix_ms();
    let view = reader.teams(&Viewer::Organiser, now_unix_ms).await?;
    let phases = reader.phases(&Viewer::Organiser, now_unix_ms).await?;
    let tab = Tab::Teams;
    write(&TeamsPage { shell: tab.shell("Teams"), frame, tab, view, phases, secret })
}
