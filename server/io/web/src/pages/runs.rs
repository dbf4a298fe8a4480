use super::{Page, Part, Shell, segment, write};
use crate::{
    live::{Hub, Live},
    plot,
    trouble::Trouble,
    visit::{Asked, Nothing, RunsQuery, Visit},
    words,
};
use askama::Template;
use avln_episode::EndReason;
use avln_scoring::Key;
use avln_store::{EpisodeLine, GroupView, RunLine, RunList, RunView, TimeAccount};
use axum::{Extension, extract::Path};
use std::sync::Arc;

#[derive(Template)]
#[template(path = "runs.html")]
struct RunsPage {
    shell: Shell,
    /// Those that are under way.
    live: Vec<Live>,
    runs: Vec<RunLine>,
    /// The run after which the list goes on.
    next: Option<String>,
    query: RunsQuery,
    limit: u32,
}

impl RunsPage {
    /// The same for programs, in a file that ends so.
    fn twin(&self, end: &str) -> String {
        format!("/api/v1/runs{end}?{}", self.query.address(self.query.before.as_deref()))
    }
}

#[derive(Template)]
#[template(path = "run.html")]
pub(super) struct RunPage {
    shell: Shell,
    view: RunView,
    /// How far it is, while it is not over.
    live: Option<Live>,
    keys: [Key; 10],
}

/// The latest runs.
pub(super) async fn list(
    visit: Visit,
    Extension(hub): Extension<Arc<Hub>>,
    Asked(query): Asked<RunsQuery>,
) -> Page {
    let limit = query.limit()?;
    let mut live = hub.runs(&visit).await?;
    live.retain(|live| query.phase.as_ref().is_none_or(|phase| live.run.line.phase == *phase));
    let RunList { runs, next } = query.list(&visit.reader, &visit.viewer).await?;
    write(&RunsPage { shell: Shell::new("Runs", Part::Runs), live, runs, next, query, limit })
}

/// One run.
pub(super) async fn one(
    visit: Visit,
    Path(id): Path<String>,
    Extension(hub): Extension<Arc<Hub>>,
    _: Asked<Nothing>,
) -> Page {
    let view = visit.reader.run(&visit.viewer, &id).await?;
    let view = view.ok_or_else(|| Trouble::Unknown { what: "run", name: id.clone() })?;
    let live = if view.line.state.is_open() { hub.run(&visit, &id).await? } else { None };
    write(&RunPage::new(view, live))
}

impl RunPage {
    fn new(view: RunView, live: Option<Live>) -> Self {
        let line = &view.line;
        let title = format!("{} {} by {}", line.method, line.version, line.team);
        let shell = Shell::new(title, Part::Runs)
            .below("Runs", "/runs")
            .below(line.phase.clone(), format!("/leaderboard/{}?order={}", segment(&line.phase), line.order));
        Self { shell, view, live, keys: Key::ALL }
    }

    /// Tables of episodes that have something in common, each with its name.
    fn groupings(&self) -> impl Iterator<Item = (&'static str, &[GroupView])> {
        let all =
            [("number of goals", self.view.by_goals.as_slice()), ("scene", self.view.by_scene.as_slice())];
        all.into_iter().filter(|(_, groups)| !groups.is_empty())
    }

    /// Why episodes ended, as a bar.
    fn ends_bar(&self) -> String {
        let counts: Vec<u32> = words::ends(&self.view.health).iter().map(|(count, _)| *count).collect();
        plot::stacked(&counts)
    }

    /// Episodes that did not end as the rules end them: agents that went away, gave up or thought for too long, and faults of
    /// the server.
    fn failures(&self) -> Vec<&EpisodeLine> {
        let is_failure = |end: EndReason| match end {
            EndReason::TimeBudget
            | EndReason::Abandoned
            | EndReason::Disconnected
            | EndReason::ServerFault => true,
            EndReason::Stopped | EndReason::FinalSubmit | EndReason::StepLimit => false,
        };
        self.view.episodes.iter().filter(|episode| episode.end.is_some_and(is_failure)).collect()
    }

    /// Steps of all scored episodes; `None` when scores are hidden.
    fn steps(&self) -> Option<f64> {
        let summary = self.view.summary.as_ref()?;
        Some(summary.steps * f64::from(summary.episodes)).filter(|&steps| steps > 0.0)
    }

    /// Where the time went: the words, how long, how long a step, and which share of all; empty when nothing was measured.
    fn times(&self) -> Vec<(&'static str, String, String, String)> {
        let TimeAccount { simulation_s, encoding_s, queue_s, thinking_s } = self.view.time;
        let parts = [
            ("Agent thinking, and the wire", thinking_s),
            ("Simulating motion, sight and sound", simulation_s),
            ("Encoding observations", encoding_s),
            ("Waiting for a free core", queue_s),
        ];
        let all: f64 = parts.iter().map(|(_, seconds)| seconds).sum();
        if all <= 0.0 {
            return vec![];
        }
        let of_all = |seconds| words::share(&(seconds / all));
        let a_step = |seconds| self.steps().map(|steps| 1e3 * seconds / steps);
        let row = |&(name, seconds)| {
            (name, words::duration(&seconds), words::maybe_milliseconds(a_step(seconds)), of_all(seconds))
        };
        parts.iter().map(row).collect()
    }
}
