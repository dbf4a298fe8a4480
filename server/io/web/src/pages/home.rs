//! Home page, and leaderboard index.

use super::{Page, PageShell, SiteSection, render};
use crate::{
    format,
    leaderboard::LeaderboardParams,
    request::{GrpcAddress, NoParameters, RequestContext, StrictQuery},
};
use askama::Template;
use avln_scoring::Key;
use avln_store::{LeaderboardView, PhaseState, PhaseView};

/// Entries per leaderboard on the home page.
const TOP_ENTRIES: usize = 3;

#[derive(Template)]
#[template(path = "home.html")]
struct HomePage {
    shell: PageShell,
    phases: Vec<PhaseView>,
    grpc_address: GrpcAddress,
    /// Phase id for the example command.
    example: String,
    leaderboards: Vec<LeaderboardView>,
    columns: [Key; 4],
}

#[derive(Template)]
#[template(path = "leaderboard_index.html")]
struct LeaderboardIndexPage {
    shell: PageShell,
    phases: Vec<PhaseView>,
}

pub(super) async fn home(
    context: RequestContext,
    grpc_address: GrpcAddress,
    _: StrictQuery<NoParameters>,
) -> Page {
    let phases = context.reader.phases(&context.viewer, context.now_unix_ms).await?;
    let mut leaderboards = Vec::new();
    for phase in &phases {
        for &order in &phase.orders {
            let query = LeaderboardParams::default().query(phase, order, context.now_unix_ms);
            leaderboards.extend(context.reader.leaderboard(&context.viewer, &query).await?);
        }
    }
    leaderboards.retain(|leaderboard| !leaderboard.rows.is_empty());
    leaderboards.iter_mut().for_each(|leaderboard| leaderboard.rows.truncate(TOP_ENTRIES));
    let example = phases.iter().find(|phase| phase.state == PhaseState::Open);
    let example = example.map_or_else(|| "PHASE".to_owned(), |phase| phase.id.clone());
    render(&HomePage {
        shell: PageShell::new("LH-AVLN Arena", SiteSection::Home),
        phases,
        grpc_address,
        example,
        leaderboards,
        columns: [Key::Sr, Key::Isr, Key::Spl, Key::SoftSpl],
    })
}

pub(super) async fn leaderboards(context: RequestContext, _: StrictQuery<NoParameters>) -> Page {
    let phases = context.reader.phases(&context.viewer, context.now_unix_ms).await?;
    let shell = PageShell::new("Leaderboards", SiteSection::Leaderboards);
    render(&LeaderboardIndexPage { shell, phases })
}
