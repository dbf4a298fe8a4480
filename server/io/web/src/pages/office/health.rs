use super::{Frame, Organiser, Page, Tab, write};
use crate::{
    office::{Desk, Health},
    pages::{Part, Shell},
    visit::{Asked, Nothing, Visit},
};
use askama::Template;
use avln_store::Census;
use axum::Extension;
use std::sync::Arc;

#[derive(Template)]
#[template(path = "organise_health.html")]
struct HealthPage {
    shell: Shell,
    frame: Frame,
    tab: Tab,
    health: Health,
    census: Census,
}

/// What is going on.
pub(super) async fn page(
    Organiser(by): Organiser,
    visit: Visit,
    Extension(desk): Extension<Arc<Desk>>,
    _: Asked<Nothing>,
) -> Page {
    let census = visit.reader.census().await?;
    let tab = Tab::Health;
    let health = desk.office.health();
    write(&HealthPage { shell: tab.shell("Health"), frame: Frame::new(&desk, &by), tab, health, census })
}

impl HealthPage {
    /// Memory of scenes, MiB.
    fn scene_mib(&self) -> usize {
        self.health.scene_bytes >> 20
    }
}
