use super::{Page, Part, Shell, segment, write};
use crate::{
    plot,
    trouble::Trouble,
    visit::{Asked, Nothing, RunsQuery, Visit},
    words,
};
use askama::Template;
use avln_scoring::Key;
use avln_store::{GroupView, RunLine, RunView, TimeAccount};
use axum::extract::Path;

#[derive(Template)]
#[template(path = "runs.html")]
struct RunsPage {
    shell: Shell,
    runs: Vec<RunLine>,
    limit: u32,
}

#[derive(Template)]
#[template(path = "run.html")]
pub(super) struct RunPage {
    shell: Shell,
    view: RunView,
    keys: [Key; 10],
}

/// The latest runs.
pub(super) async fn list(visit: Visit, Asked(query): Asked<RunsQuery>) -> Page {
    let limit = query.limit()?;
    let runs = visit.reader.runs(&visit.viewer, query.phase.as_deref(), limit).await?;
    write(&RunsPage { shell: Shell::new("Runs", Part::Runs), runs, limit })
}

/// One run.
pub(super) async fn one(visit: Visit, Path(id): Path<String>, _: Asked<Nothing>) -> Page {
    let view = visit.reader.run(&visit.viewer, &id).await?;
    write(&RunPage::new(view.ok_or(Trouble::Unknown { what: "run", name: id })?))
}

impl RunPage {
    pub(super) fn new(view: RunView) -> Self {
        let line = &view.line;
        let title = format!("{} {} by {}", line.method, line.version, line.team);
        let shell = Shell::new(title, Part::Runs)
            .below("Runs", "/runs")
            .below(line.phase.clone(), format!("/leaderboard/{}?order={}", segment(&line.phase), line.order));
        Self { shell, view, keys: Key::ALL }
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

    /// Where the time went: the words, how long, and which share of all; empty when nothing was measured.
    fn times(&self) -> Vec<(&'static str, String, String)> {
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
        parts.iter().map(|&(name, seconds)| (name, words::duration(&seconds), of_all(seconds))).collect()
    }
}
