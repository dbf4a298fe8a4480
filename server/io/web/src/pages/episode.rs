use super::{Page, Part, Shell, write};
use crate::{
    map::{MapView, colour},
    trouble::Trouble,
    visit::{self, Asked, Nothing, Visit},
    words,
};
use askama::Template;
use avln_store::EpisodeView;
use axum::extract::Path;

#[derive(Template)]
#[template(path = "episode.html")]
pub(super) struct EpisodePage {
    shell: Shell,
    map: Option<MapView>,
    view: EpisodeView,
}

/// One episode of a run.
pub(super) async fn page(
    visit: Visit,
    Path((run, place)): Path<(String, String)>,
    _: Asked<Nothing>,
) -> Page {
    let ordinal = visit::ordinal(&place)?;
    let view = visit.reader.episode(&visit.viewer, &run, ordinal).await?;
    let unknown = || Trouble::Unknown { what: "episode", name: format!("{place} of run {run}") };
    write(&EpisodePage::new(view.ok_or_else(unknown)?))
}

impl EpisodePage {
    pub(super) fn new(view: EpisodeView) -> Self {
        let run = &view.run;
        let title = format!("Episode {} of {}", view.ordinal + 1, run.episodes);
        let name = format!("{} {} by {}", run.method, run.version, run.team);
        let shell =
            Shell::new(title, Part::Runs).below("Runs", "/runs").below(name, format!("/runs/{}", run.run));
        let map = view.replay.as_ref().map(|replay| MapView::new(replay, view.mission.as_ref()));
        Self { shell, map, view }
    }

    /// Colours of the legend's strip, from the start to the end.
    fn strip(&self) -> Vec<(usize, String)> {
        (0..12).map(|index| (index * 10, colour(index as f32 / 11.0))).collect()
    }

    /// What a claim was worth, for each claim: step and words.
    fn claims(&self) -> Vec<(u32, String)> {
        let submits = self.view.replay.iter().flat_map(|replay| &replay.submits);
        let words = |completed: Option<u8>| match completed {
            Some(goal) => format!("right: completed goal {}", u32::from(goal) + 1),
            None => "wrong: completed nothing".to_owned(),
        };
        submits.map(|submit| (submit.step, words(submit.completed))).collect()
    }
}
