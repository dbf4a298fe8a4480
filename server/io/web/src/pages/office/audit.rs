use super::{Frame, Organiser, Page, Tab, write};
use crate::{
    office::Desk,
    pages::{Part, Shell},
    visit::{Asked, Visit},
    words,
};
use askama::Template;
use avln_store::{AuditLine, Viewer};
use axum::Extension;
use serde::Deserialize;
use std::sync::Arc;

/// Lines of a page.
const LINES: u32 = 100;

#[derive(Template)]
#[template(path = "organise_audit.html")]
struct AuditPage {
    shell: Shell,
    frame: Frame,
    tab: Tab,
    lines: Vec<AuditLine>,
    /// The last line of this page, where there are more.
    older_than: Option<i64>,
    is_newest: bool,
}

/// Which lines are wanted: those before this one, or the newest.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AuditQuery {
    before: Option<i64>,
}

/// What was changed, by whom and why, the newest first.
pub(super) async fn page(
    Organiser(by): Organiser,
    visit: Visit,
    Extension(desk): Extension<Arc<Desk>>,
    Asked(query): Asked<AuditQuery>,
) -> Page {
    let mut lines = visit.reader.audit(&Viewer::Organiser, query.before, LINES + 1).await?;
    let has_more = lines.len() > LINES as usize;
    lines.truncate(LINES as usize);
    let older_than = lines.last().map(|line| line.id).filter(|_| has_more);
    let tab = Tab::Audit;
    let frame = Frame::new(&desk, &by);
    write(&AuditPage {
        shell: tab.shell("Audit"),
        frame,
        tab,
        lines,
        older_than,
        is_newest: query.before.is_none(),
    })
}

impl AuditPage {
    /// Which lines these are.
    fn range(&self) -> String {
        let id = |line: Option<&AuditLine>| line.map_or(0, |line| line.id);
        format!("Lines {} to {}", id(self.lines.first()), id(self.lines.last()))
    }
}
