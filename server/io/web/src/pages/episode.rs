use super::{Page, Part, Shell, segment, write};
use crate::{
    onlooker::{MaybeDesk, Sound, WINDOW_STEPS, size_px},
    plot::curves::{LEFT_PX, WIDTH_PX},
    replay::{EarsView, ReplayView, colour},
    trouble::Trouble,
    visit::{self, Asked, ReplayQuery, Visit},
    words,
};
use askama::Template;
use avln_store::{EpisodeView, TargetView};
use axum::{Extension, extract::Path};
use std::{fmt, sync::Arc, time::Duration};
use tokio::time::timeout;

/// How long a page waits for an episode to be heard again; it goes on without levels then.
const PATIENCE: Duration = Duration::from_secs(8);

#[derive(Template)]
#[template(path = "episode.html")]
pub(super) struct EpisodePage {
    shell: Shell,
    replay: Option<ReplayView>,
    view: EpisodeView,
    /// The storey that the visitor asked for, from 1.
    asked_storey: Option<usize>,
    /// Whether somebody can look into the scene.
    has_pictures: bool,
    /// What the agent was sent to hear, where it was and somebody can listen.
    ears: Option<EarsView>,
    query: ReplayQuery,
}

/// One episode of a run.
pub(super) async fn page(
    visit: Visit,
    Path((run, place)): Path<(String, String)>,
    Extension(desk): Extension<MaybeDesk>,
    Asked(query): Asked<ReplayQuery>,
) -> Page {
    let ordinal = visit::ordinal(&place)?;
    let view = visit.reader.episode(&visit.viewer, &run, ordinal).await?;
    let unknown = || Trouble::Unknown { what: "episode", name: format!("{place} of run {run}") };
    let view = view.ok_or_else(unknown)?;
    let sound = listen(&desk, &view, query).await;
    write(&EpisodePage::new(view, query, desk.is_some(), sound))
}

/// The sound of an episode, where the visitor asks for it and it is there soon.
async fn listen(desk: &MaybeDesk, view: &EpisodeView, query: ReplayQuery) -> Option<Arc<Sound>> {
    let desk = desk.clone().filter(|_| query.listens())?;
    timeout(PATIENCE, desk.sound(view)).await.ok()?.ok()?
}

impl EpisodePage {
    fn new(view: EpisodeView, query: ReplayQuery, has_desk: bool, sound: Option<Arc<Sound>>) -> Self {
        let run = &view.run;
        let title = format!("Episode {} of {}", view.ordinal + 1, run.episodes);
        let name = format!("{} {} by {}", run.method, run.version, run.team);
        let shell =
            Shell::new(title, Part::Runs).below("Runs", "/runs").below(name, format!("/runs/{}", run.run));
        let storey = query.storey.and_then(|number| number.checked_sub(1));
        let replay = ReplayView::new(&view, query.t, storey);
        let ears = view.replay.as_ref().filter(|replay| has_desk && replay.hears).zip(replay.as_ref());
        let ears = ears
            .map(|(facts, shown)| EarsView::new(facts, &shown.moments, shown.step, sound, query.listens()));
        Self { shell, replay, view, asked_storey: query.storey, has_pictures: has_desk, ears, query }
    }

    /// Where this page is.
    fn path(&self) -> String {
        format!("/runs/{}/episodes/{}", segment(&self.view.run.run), self.view.ordinal)
    }

    /// The same page at another step; what is usual is left out.
    fn at(&self, replay: &ReplayView, step: &u32) -> String {
        let step = (*step < replay.last()).then(|| format!("t={step}"));
        self.with([step, self.asked_storey.map(|number| format!("storey={number}")), self.listening()])
    }

    /// The same moment with levels of what there was to hear.
    fn with_levels(&self, replay: &ReplayView) -> String {
        let step = (replay.step < replay.last()).then(|| format!("t={}", replay.step));
        let storey = self.asked_storey.map(|number| format!("storey={number}"));
        self.with([step, storey, Some("ears=on".to_owned())])
    }

    fn listening(&self) -> Option<String> {
        self.query.listens().then(|| "ears=on".to_owned())
    }

    /// The same moment with another storey in front.
    fn on_storey(&self, replay: &ReplayView, number: &usize) -> String {
        let step = (replay.step < replay.last()).then(|| format!("t={}", replay.step));
        self.with([step, Some(format!("storey={number}")), self.listening()])
    }

    fn with(&self, parts: [Option<String>; 3]) -> String {
        let query = parts.into_iter().flatten().collect::<Vec<_>>().join("&");
        let mark = if query.is_empty() { "" } else { "?" };
        format!("{}{mark}{query}", self.path())
    }

    /// Where the picture of a step is.
    fn picture(&self, step: impl fmt::Display) -> String {
        format!("{}/eyes/{step}.png", self.path())
    }

    /// Where the sound of some steps is.
    fn sound(&self, steps: impl fmt::Display) -> String {
        format!("{}/ears/{steps}.wav", self.path())
    }

    /// Pixels of a picture.
    fn picture_px(&self) -> [u32; 2] {
        self.view.replay.as_ref().map_or([1, 1], size_px)
    }

    /// How far depth is told.
    fn depth_max_m(&self) -> f32 {
        self.view.replay.as_ref().map_or(0.0, |replay| replay.rules.depth_max_m)
    }

    /// Simulated time of a step.
    fn step_s(&self) -> f32 {
        self.view.replay.as_ref().map_or(0.0, |replay| replay.rules.step_s)
    }

    /// The targets in the order of the mission.
    fn targets(&self) -> &[TargetView] {
        self.view.replay.as_ref().map_or(&[], |replay| &replay.targets)
    }

    /// Colours of the legend's strip, from the start to the end.
    fn strip(&self) -> Vec<(usize, String)> {
        (0..12).map(|index| (index * 10, colour(index as f32 / 11.0))).collect()
    }
}
