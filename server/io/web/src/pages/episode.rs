//! Episode page, with the replay.

use super::{Page, PageShell, SiteSection, render};
use crate::{
    format::{self, url_encode},
    plot::{LEFT_PX, WIDTH_PX},
    replay::{ReplayView, SoundView, colour},
    replay_renderer::{EpisodeSound, MaybeRenderQueue, WINDOW_STEPS},
    request::{ReplayQuery, RequestContext, StrictQuery},
};
use askama::Template;
use avln_store::EpisodeView;
use axum::{Extension, extract::Path};
use std::{fmt, sync::Arc, time::Duration};
use tokio::time::timeout;

// Time limit for rendered sound; after it, the page is sent without levels.
const SOUND_TIMEOUT: Duration = Duration::from_secs(8);

#[derive(Template)]
#[template(path = "episode.html")]
struct EpisodePage {
    shell: PageShell,
    replay: Option<ReplayView>,
    view: EpisodeView,
    /// Requested storey, counted from 1.
    storey: Option<usize>,
    has_pictures: bool,
    /// Sound, if the agent requested it and the server renders it.
    sound: Option<SoundView>,
    query: ReplayQuery,
}

pub(super) async fn page(
    context: RequestContext,
    Path((run, ordinal)): Path<(String, String)>,
    Extension(queue): Extension<MaybeRenderQueue>,
    StrictQuery(query): StrictQuery<ReplayQuery>,
) -> Page {
    let view = context.episode(&run, &ordinal).await?;
    let sound = render_sound(&queue, &view, query).await;
    render(&EpisodePage::new(view, query, queue.is_some(), sound))
}

/// Returns the sound if the visitor requested levels and it is ready in time.
async fn render_sound(
    queue: &MaybeRenderQueue,
    view: &EpisodeView,
    query: ReplayQuery,
) -> Option<Arc<EpisodeSound>> {
    let queue = queue.clone().filter(|_| query.shows_levels())?;
    timeout(SOUND_TIMEOUT, queue.sound(view)).await.ok()?.ok()?
}

impl EpisodePage {
    fn new(
        view: EpisodeView,
        query: ReplayQuery,
        has_renderer: bool,
        sound: Option<Arc<EpisodeSound>>,
    ) -> Self {
        let run = &view.run;
        let title = format!("Episode {} of {}", view.ordinal + 1, run.episodes);
        let name = format!("{} {} by {}", run.method, run.version, run.team);
        let shell = PageShell::new(title, SiteSection::Runs)
            .below("Runs", "/runs")
            .below(name, format!("/runs/{}", run.run));
        let storey = query.storey.and_then(|number| number.checked_sub(1));
        let replay = ReplayView::new(&view, query.t, storey);
        let audible = view.replay.as_ref().filter(|replay| has_renderer && replay.hears);
        let sound = audible.zip(replay.as_ref()).map(|(facts, shown)| {
            SoundView::new(facts, &shown.moments, shown.step, sound, query.shows_levels())
        });
        Self { shell, replay, view, storey: query.storey, has_pictures: has_renderer, sound, query }
    }

    fn path(&self) -> String {
        format!("/runs/{}/episodes/{}", url_encode(&self.view.run.run), self.view.ordinal)
    }

    fn at(&self, replay: &ReplayView, step: &u32) -> String {
        self.address(replay, *step, self.storey, self.query.shows_levels())
    }

    fn with_levels(&self, replay: &ReplayView) -> String {
        self.address(replay, replay.step, self.storey, true)
    }

    fn on_storey(&self, replay: &ReplayView, number: &usize) -> String {
        self.address(replay, replay.step, Some(*number), self.query.shows_levels())
    }

    fn address(&self, replay: &ReplayView, step: u32, storey: Option<usize>, levels: bool) -> String {
        // The last step is the default.
        let step = (step < replay.last()).then(|| format!("t={step}"));
        let storey = storey.map(|number| format!("storey={number}"));
        let levels = levels.then(|| "ears=on".to_owned());
        let query = [step, storey, levels].into_iter().flatten().collect::<Vec<_>>().join("&");
        let mark = if query.is_empty() { "" } else { "?" };
        format!("{}{mark}{query}", self.path())
    }

    fn picture_address(&self, step: impl fmt::Display) -> String {
        format!("{}/eyes/{step}.png", self.path())
    }

    fn sound_address(&self, steps: impl fmt::Display) -> String {
        format!("{}/ears/{steps}.wav", self.path())
    }

    fn strip(&self) -> Vec<(usize, String)> {
        (0..12).map(|index| (index * 10, colour(index as f32 / 11.0))).collect()
    }
}
