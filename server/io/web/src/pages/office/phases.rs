use super::{Frame, Organiser, Page, Tab, back, segment, unknown, write};
use crate::{
    office::{Deed, Desk, Fields, Form},
    pages::{Part, Shell, phase},
    trouble::Trouble,
    visit::Visit,
    words,
};
use askama::Template;
use avln_store::{PhaseState, PhaseView, Viewer};
use axum::{Extension, extract::Path, response::Response};
use std::sync::Arc;

#[derive(Template)]
#[template(path = "organise.html")]
struct PhasesPage {
    shell: Shell,
    frame: Frame,
    tab: Tab,
    phases: Vec<PhaseView>,
}

#[derive(Template)]
#[template(path = "organise_phase.html")]
struct PhasePage {
    shell: Shell,
    frame: Frame,
    tab: Tab,
    phase: PhaseView,
}

/// All phases.
pub(super) async fn list(
    Organiser(by): Organiser,
    visit: Visit,
    Extension(desk): Extension<Arc<Desk>>,
) -> Page {
    let phases = visit.reader.phases(&Viewer::Organiser, visit.now_unix_ms).await?;
    let tab = Tab::Phases;
    write(&PhasesPage { shell: tab.shell("Organise"), frame: Frame::new(&desk, &by), tab, phases })
}

/// One phase.
pub(super) async fn one(
    Organiser(by): Organiser,
    visit: Visit,
    Extension(desk): Extension<Arc<Desk>>,
    Path(id): Path<String>,
) -> Page {
    let phase = phase(&visit, &id).await?;
    let tab = Tab::Phases;
    let shell = tab.shell(phase.title.clone()).below("Organise", tab.href());
    write(&PhasePage { shell, frame: Frame::new(&desk, &by), tab, phase })
}

/// Does what a form of the page of a phase asks for.
pub(super) async fn act(
    organiser: Organiser,
    Extension(desk): Extension<Arc<Desk>>,
    Path(id): Path<String>,
    Form { by, fields }: Form,
) -> Result<Response, Trouble> {
    let (deed, reason) = deed(&id, &fields)?;
    let done = desk.office.organise(organiser.because(reason), deed).await?;
    Ok(back(&desk, &by, done, &format!("/organise/phases/{}", segment(&id))))
}

/// What is asked for, and why. What cannot be taken back wants the phase typed.
fn deed(id: &str, fields: &Fields) -> Result<(Deed, String), Trouble> {
    let phase = id.to_owned();
    Ok(match fields.get("deed")? {
        "pause" => (Deed::Pause(phase), fields.reason()?),
        "resume" => (Deed::Resume(phase), fields.maybe_reason()?),
        "close" => {
            fields.confirm(id)?;
            (Deed::Close(phase), fields.reason()?)
        }
        "reveal" => {
            fields.confirm(id)?;
            (Deed::Reveal(phase), fields.maybe_reason()?)
        }
        other => return Err(unknown(other)),
    })
}

impl PhasePage {
    /// Whether runs may start again by hand.
    fn may_resume(&self) -> bool {
        matches!(self.phase.state, PhaseState::Paused | PhaseState::Closed)
    }

    /// Whether there is something to publish.
    fn may_reveal(&self) -> bool {
        let promise = self.phase.promise.as_ref();
        self.phase.state == PhaseState::Closed && promise.is_some_and(|promise| promise.revealed.is_none())
    }
}
