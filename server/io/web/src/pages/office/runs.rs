use super::{Frame, Organiser, Page, Tab, back, segment, unknown, write};
use crate::{
    office::{Deed, Desk, Fields, Form},
    pages::{Part, Shell},
    trouble::Trouble,
    visit::{Asked, RunsQuery, Visit},
    words,
};
use askama::Template;
use avln_scoring::Key;
use avln_store::{RunLine, RunList, RunView, Viewer};
use axum::{Extension, extract::Path, response::Response};
use std::sync::Arc;

#[derive(Template)]
#[template(path = "organise_runs.html")]
struct RunsPage {
    shell: Shell,
    frame: Frame,
    tab: Tab,
    runs: Vec<RunLine>,
    /// The run after which the list goes on.
    next: Option<String>,
    query: RunsQuery,
    limit: u32,
}

#[derive(Template)]
#[template(path = "organise_run.html")]
struct RunPage {
    shell: Shell,
    frame: Frame,
    tab: Tab,
    view: RunView,
}

/// The latest runs.
pub(super) async fn list(
    Organiser(by): Organiser,
    visit: Visit,
    Extension(desk): Extension<Arc<Desk>>,
    Asked(query): Asked<RunsQuery>,
) -> Page {
    let limit = query.limit()?;
    let RunList { runs, next } = query.list(&visit.reader, &Viewer::Organiser).await?;
    let (tab, frame) = (Tab::Runs, Frame::new(&desk, &by));
    write(&RunsPage { shell: tab.shell("Rule on runs"), frame, tab, runs, next, query, limit })
}

/// One run.
pub(super) async fn one(
    Organiser(by): Organiser,
    visit: Visit,
    Extension(desk): Extension<Arc<Desk>>,
    Path(id): Path<String>,
) -> Page {
    let view = visit.reader.run(&Viewer::Organiser, &id).await?;
    let view = view.ok_or(Trouble::Unknown { what: "run", name: id })?;
    let tab = Tab::Runs;
    let title = format!("Rule on {} {} by {}", view.line.method, view.line.version, view.line.team);
    let shell = tab.shell(title).below("Runs", tab.href());
    write(&RunPage { shell, frame: Frame::new(&desk, &by), tab, view })
}

/// Does what a form of the page of a run asks for.
pub(super) async fn act(
    organiser: Organiser,
    Extension(desk): Extension<Arc<Desk>>,
    Path(id): Path<String>,
    Form { by, fields }: Form,
) -> Result<Response, Trouble> {
    let deed = deed(&id, &fields)?;
    let done = desk.office.organise(organiser.because(fields.reason()?), deed).await?;
    Ok(back(&desk, &by, done, &format!("/organise/runs/{}", segment(&id))))
}

fn deed(id: &str, fields: &Fields) -> Result<Deed, Trouble> {
    let run = id.to_owned();
    Ok(match fields.get("deed")? {
        "verify" => Deed::Verify { run, verified: true },
        "unverify" => Deed::Verify { run, verified: false },
        "disqualify" => Deed::Disqualify(run),
        "reinstate" => Deed::Reinstate(run),
        other => return Err(unknown(other)),
    })
}

impl RunPage {
    fn line(&self) -> &RunLine {
        &self.view.line
    }
}
