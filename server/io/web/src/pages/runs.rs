//! Run pages: list, single run, comparison, badge; episode page, with the replay.

use super::{Page, PageShell, SiteSection, render};
use crate::{
    error::Result,
    format::{self, NOTHING, url_encode},
    leaderboard::LeaderboardParams,
    live::{LiveFeed, LiveRunView},
    plot::{self, LEFT_PX, WIDTH_PX},
    replay::{ReplayView, SoundView, colour},
    replay_renderer::{EpisodeSound, MaybeRenderQueue, WINDOW_STEPS},
    request::{CompareQuery, Menu, PathOnly, ReplayQuery, RequestContext, RunsQuery, StrictQuery},
};
use askama::Template;
use avln_challenge::MethodInfo;
use avln_episode::EndReason;
use avln_scoring::{Key, Summary};
use avln_store::{
    CompareView, EpisodeLine, EpisodeView, GroupView, PairView, PhaseView, RunLine, RunList, RunView,
    TimeAccount,
};
use axum::{
    Extension,
    extract::Path,
    http::header,
    response::{IntoResponse, Response},
};
use std::{fmt, sync::Arc, time::Duration};
use tokio::time::timeout;

#[derive(Template)]
#[template(path = "runs.html")]
struct RunsPage {
    shell: PageShell,
    live: Vec<LiveRunView>,
    list: RunList,
    query: RunsQuery,
    limit: u32,
}

impl RunsPage {
    fn api_address(&self, suffix: &str) -> String {
        format!("/api/v1/runs{suffix}?{}", self.query.address(self.query.before.as_deref()))
    }
}

pub(super) async fn list(
    context: RequestContext,
    Extension(feed): Extension<Arc<LiveFeed>>,
    StrictQuery(query): StrictQuery<RunsQuery>,
) -> Page {
    let limit = query.limit()?;
    let mut live = feed.runs(&context).await?;
    live.retain(|live| query.phase.as_ref().is_none_or(|phase| live.run.line.phase == *phase));
    let list = query.list(&context.reader, &context.viewer).await?;
    render(&RunsPage { shell: PageShell::new("Runs", SiteSection::Runs), live, list, query, limit })
}

/// A time table row: activity, total, time per step, share.
type TimeRow = (&'static str, String, String, String);

#[derive(Template)]
#[template(path = "run.html")]
struct RunPage {
    shell: PageShell,
    view: RunView,
    live: Option<LiveRunView>,
    keys: [Key; 10],
}

pub(super) async fn one(
    context: RequestContext,
    PathOnly(id): PathOnly<String>,
    Extension(feed): Extension<Arc<LiveFeed>>,
) -> Page {
    let view = context.run(&id).await?;
    let live = if view.line.state.is_open() { feed.run(&context, &id).await? } else { None };
    render(&RunPage::new(view, live))
}

impl RunPage {
    fn new(view: RunView, live: Option<LiveRunView>) -> Self {
        let line = &view.line;
        let title = format!("{} {} by {}", line.method, line.version, line.team);
        let shell = PageShell::new(title, SiteSection::Runs)
            .below("Runs", "/runs")
            .below(line.phase.clone(), leaderboard_address(line));
        Self { shell, view, live, keys: Key::ALL }
    }

    fn method_facts(&self) -> Vec<(&'static str, &str)> {
        let MethodInfo {
            method_type, description, code_url, paper_url, weights_licence, external_data, ..
        } = &self.view.method;
        let all = [
            ("Type", method_type.as_ref().map_or("", format::method_type)),
            ("Method", description.as_str()),
            ("Code", code_url),
            ("Paper", paper_url),
            ("Licence of the weights", weights_licence),
            ("Other training data", external_data),
        ];
        all.into_iter().filter(|(_, text)| !text.is_empty()).collect()
    }

    fn groupings(&self) -> impl Iterator<Item = (&'static str, &[GroupView])> {
        let all =
            [("number of goals", self.view.by_goals.as_slice()), ("scene", self.view.by_scene.as_slice())];
        all.into_iter().filter(|(_, groups)| !groups.is_empty())
    }

    fn rescores_note(&self) -> String {
        let mut summaries = self.view.rescores.iter().filter_map(|rescore| rescore.summary.as_ref());
        format::few_scenes_note(summaries.any(Summary::has_few_scenes))
    }

    fn ends_bar(&self) -> String {
        let counts: Vec<u32> = format::ends(&self.view.health).iter().map(|(count, _)| *count).collect();
        plot::stacked(&counts)
    }

    /// Returns the episodes that ended against the task's rules.
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

    /// Returns the total step count; `None` if scores are hidden.
    fn steps(&self) -> Option<f64> {
        let summary = self.view.summary.as_ref()?;
        Some(summary.steps * f64::from(summary.episodes)).filter(|&steps| steps > 0.0)
    }

    fn times(&self) -> Vec<TimeRow> {
        let TimeAccount { simulation_s, encoding_s, queue_s, thinking_s } = self.view.time;
        let parts = [
            ("Agent and network", thinking_s),
            ("Simulation of motion, vision and sound", simulation_s),
            ("Encoding of observations", encoding_s),
            ("Wait for a free core", queue_s),
        ];
        let total: f64 = parts.iter().map(|(_, seconds)| seconds).sum();
        if total <= 0.0 {
            return vec![];
        }
        let row = |&(name, seconds): &(&'static str, f64)| {
            let per_step = self.steps().map(|steps| format!("{:.2} ms", 1e3 * seconds / steps));
            let share = format::share(&(seconds / total));
            (name, format::duration(&seconds), per_step.unwrap_or_else(|| NOTHING.to_owned()), share)
        };
        parts.iter().map(row).collect()
    }
}

fn leaderboard_address(line: &RunLine) -> String {
    format!("/leaderboard/{}?order={}", url_encode(&line.phase), line.order)
}

#[derive(Template)]
#[template(path = "compare.html")]
struct ComparePage {
    shell: PageShell,
    view: CompareView,
    /// Episodes by success: both, only the first, only the second, neither.
    groups: [OutcomeGroup; 4],
}

struct OutcomeGroup {
    anchor: &'static str,
    heading: &'static str,
    pairs: Vec<PairView>,
}

pub(super) async fn compare(context: RequestContext, StrictQuery(query): StrictQuery<CompareQuery>) -> Page {
    let view = query.view(&context).await?;
    let [first, second] = [&view.first, &view.second].map(|line| format!("{} {}", line.method, line.version));
    let shell = PageShell::new(format!("{first} and {second}"), SiteSection::Leaderboards)
        .below("Leaderboards", "/leaderboard")
        .below(view.first.phase.clone(), leaderboard_address(&view.first));
    let groups = outcome_groups(&view.episodes);
    render(&ComparePage { shell, view, groups })
}

impl ComparePage {
    fn api_address(&self, suffix: &str) -> String {
        let [first, second] = [&self.view.first, &self.view.second].map(|line| url_encode(&line.run));
        format!("/api/v1/compare{suffix}?first={first}&second={second}")
    }
}

fn outcome_groups(pairs: &[PairView]) -> [OutcomeGroup; 4] {
    // An episode's SR is 0 or 1.
    let all_found = |pair: &PairView| [pair.first.sr, pair.second.sr].map(|sr| sr > 0.5);
    let group = |anchor, heading, outcome: [bool; 2]| {
        let pairs = pairs.iter().filter(|pair| all_found(pair) == outcome).cloned().collect();
        OutcomeGroup { anchor, heading, pairs }
    };
    [
        group("both", "Both found all goals", [true, true]),
        group("first", "Only the first found all goals", [true, false]),
        group("second", "Only the second found all goals", [false, true]),
        group("neither", "Neither found all goals", [false, false]),
    ]
}

const LETTER_PX: u32 = 7;
const MARGIN_PX: u32 = 8;

#[derive(Template)]
#[template(path = "badge.svg")]
struct Badge {
    subject: BadgeLabel,
    standing: BadgeLabel,
}

struct BadgeLabel {
    text: String,
    text_px: u32,
    width_px: u32,
}

pub(super) async fn badge(context: RequestContext, PathOnly(id): PathOnly<String>) -> Result<Response> {
    let view = context.run(&id).await?;
    let phase = context.phase(&view.line.phase).await?;
    let subject = format!("{}, {}", phase.title, format::order(&view.line.order).to_lowercase());
    let standing = standing_text(&context, &phase, &view).await?;
    let badge = Badge { subject: BadgeLabel::new(subject), standing: BadgeLabel::new(standing) };
    Ok(([(header::CONTENT_TYPE, "image/svg+xml")], badge.render()?).into_response())
}

/// Returns score and rank by the phase's ranking, or the reason for a missing rank.
async fn standing_text(context: &RequestContext, phase: &PhaseView, view: &RunView) -> Result<String> {
    let line = &view.line;
    let summary = match &view.summary {
        _ if line.disqualified.is_some() => return Ok("disqualified".to_owned()),
        _ if !view.scores_visible => return Ok("scores are hidden".to_owned()),
        Some(summary) if view.eligible => summary,
        _ if line.state.is_open() => return Ok(format!("{} of {} episodes", line.done, line.episodes)),
        _ => return Ok("not ranked".to_owned()),
    };
    let rows = LeaderboardParams::default().read(context, phase, line.order).await?.rows;
    let standing = rows.iter().find(|row| row.run == line.run).and_then(|row| row.standing);
    let ranked = rows.iter().filter(|row| row.standing.is_some()).count();
    let rank = standing.map_or(String::new(), |standing| format!(", rank {} of {ranked}", standing.rank));
    Ok(score_text(phase.ranking.key, summary) + &rank)
}

fn score_text(key: Key, summary: &Summary) -> String {
    let name = format::metric(&key);
    match key.metric().estimate_of(summary) {
        Some(estimate) => {
            let [low, high] = [estimate.low, estimate.high].map(|share| format::number(&(100.0 * share)));
            format!("{name} {} ({low} to {high})", format::share(&estimate.value))
        }
        None => format!("{name} {}", format::number(&key.mean_of(summary))),
    }
}

impl BadgeLabel {
    fn new(text: String) -> Self {
        let text_px =
            LETTER_PX * u32::try_from(text.chars().count()).unwrap_or(u32::MAX / LETTER_PX / 4).min(400);
        Self { text, text_px, width_px: text_px + 2 * MARGIN_PX }
    }
}

impl Badge {
    fn width_px(&self) -> u32 {
        self.subject.width_px + self.standing.width_px
    }
}

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

pub(super) async fn episode(
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
