//! Leaderboard pages: single order, all orders side by side, and embedded.

use super::{Page, PageShell, SiteSection, render};
use crate::{
    error::{RequestError, Result},
    format::{self, url_encode},
    leaderboard::{LeaderboardControls, LeaderboardParams, Orders, day},
    request::RequestContext,
};
use askama::Template;
use avln_scoring::{Direction, Key, Metric};
use avln_store::{LeaderboardRow, LeaderboardView, PhaseView, RunChoice, Visibility};
use axum::{
    extract::Path,
    response::{IntoResponse, Redirect, Response},
};
use std::collections::{BTreeMap, BTreeSet};

#[derive(Template)]
#[template(path = "leaderboard.html")]
struct LeaderboardPage {
    shell: PageShell,
    caption: String,
    view: LeaderboardView,
    columns: Vec<Key>,
    controls: LeaderboardControls,
    orders: Orders,
    /// The leader's run, before filtering.
    leader: Option<String>,
}

#[derive(Template)]
#[template(path = "embed.html")]
struct EmbeddedLeaderboard {
    title: String,
    caption: String,
    address: String,
    view: LeaderboardView,
    columns: Vec<Key>,
}

#[derive(Template)]
#[template(path = "leaderboard_orders.html")]
struct AllOrdersPage {
    shell: PageShell,
    caption: String,
    /// One leaderboard per order, filtered.
    views: Vec<LeaderboardView>,
    rows: Vec<MethodRow>,
    controls: LeaderboardControls,
    orders: Orders,
    columns: Vec<Key>,
}

/// A team's method with the entries in all orders.
struct MethodRow {
    /// Any entry, for the data shared by all.
    any: LeaderboardRow,
    /// Entries by order, as in the phase.
    entries: Vec<Option<OrderEntry>>,
}

struct OrderEntry {
    row: LeaderboardRow,
    position: usize,
    tied_with: Option<u32>,
}

pub(super) async fn page(
    context: RequestContext,
    Path(id): Path<String>,
    params: LeaderboardParams,
) -> Result<Response> {
    let phase = context.phase(&id).await?;
    // A form sends empty fields: redirect to the canonical address, which can be shared.
    if params.has_blanks {
        let address = format!("/leaderboard/{}{}", url_encode(&id), params.address(&phase));
        return Ok(Redirect::to(&address).into_response());
    }
    if params.shown_orders(&phase) == Orders::Both {
        return Ok(all_orders(&context, phase, params).await?.into_response());
    }
    let order = params.order(&phase)?;
    let view = params.read(&context, &phase, order).await?;
    Ok(render(&LeaderboardPage::new(view, &params))?.into_response())
}

pub(super) async fn embedded(
    context: RequestContext,
    Path(id): Path<String>,
    params: LeaderboardParams,
) -> Result<Response> {
    let phase = context.phase(&id).await?;
    let order = params.order(&phase)?;
    let page = LeaderboardPage::new(params.read(&context, &phase, order).await?, &params);
    let address = page.controls.path() + &page.controls.query_string();
    let LeaderboardPage { shell, caption, view, .. } = page;
    let page = EmbeddedLeaderboard { title: shell.title, caption, address, view, columns: headline_keys() };
    Ok(render(&page)?.into_response())
}

async fn all_orders(context: &RequestContext, phase: PhaseView, params: LeaderboardParams) -> Page {
    let views = params.read_all(context, &phase).await?;
    let title = format!("{}: all orders of goals", phase.title);
    let shell = PageShell::new(title, SiteSection::Leaderboards).below("Leaderboards", "/leaderboard");
    let Some(first) = views.first() else { return Err(RequestError::NoPage) };
    let mut controls = LeaderboardControls::new(&params, first);
    controls.teams.extend(views.iter().flat_map(|view| view.teams.iter().cloned()));
    let mut columns = headline_keys();
    columns.retain(|key| params.columns.is_empty() || params.columns.contains(key));
    render(&AllOrdersPage {
        shell,
        caption: orders_caption(&views, &controls),
        rows: method_rows(&views),
        views,
        controls,
        orders: Orders::Both,
        columns,
    })
}

/// Returns the methods, sorted by position in the first order, then in the next.
fn method_rows(views: &[LeaderboardView]) -> Vec<MethodRow> {
    let mut rows: BTreeMap<(&str, &str), MethodRow> = BTreeMap::new();
    for (order, view) in views.iter().enumerate() {
        for (position, row) in view.rows.iter().enumerate() {
            let method = rows.entry((&row.team, &row.method)).or_insert_with(|| MethodRow {
                any: row.clone(),
                entries: views.iter().map(|_| None).collect(),
            });
            let tied_with = tied_with(&view.rows, row);
            method.entries[order] = Some(OrderEntry { row: row.clone(), position, tied_with });
        }
    }
    let mut rows: Vec<MethodRow> = rows.into_values().collect();
    let positions = |row: &MethodRow| -> Vec<usize> {
        row.entries.iter().map(|entry| entry.as_ref().map_or(usize::MAX, |entry| entry.position)).collect()
    };
    rows.sort_by_key(positions);
    rows
}

impl LeaderboardPage {
    fn new(view: LeaderboardView, params: &LeaderboardParams) -> Self {
        let title = format!("{}: {} goals", view.phase.title, format::order(&view.order).to_lowercase());
        let shell = PageShell::new(title, SiteSection::Leaderboards).below("Leaderboards", "/leaderboard");
        let controls = LeaderboardControls::new(params, &view);
        let leader = view.leader.clone();
        let columns = params.shown_columns(view.key);
        let orders = Orders::One(view.order);
        Self { shell, caption: caption(&view), columns, controls, orders, leader, view }
    }

    fn embedded(&self) -> String {
        format!("/embed/{}{}", url_encode(&self.view.phase.id), self.controls.query_string())
    }

    /// Returns the comparison with the leader, if single episodes are public.
    fn against_leader(&self, row: &LeaderboardRow) -> Option<String> {
        let leader = self.leader.as_ref().filter(|leader| **leader != row.run)?;
        let is_public = self.view.phase.replays == Visibility::Public;
        is_public.then(|| format!("/compare?first={}&second={}", url_encode(&row.run), url_encode(leader)))
    }

    fn aria_sort(&self, key: &Key) -> &'static str {
        match key.direction() {
            _ if self.view.key != *key => "none",
            Direction::Higher => "descending",
            Direction::Lower => "ascending",
        }
    }
}

impl AllOrdersPage {
    fn is_partial(&self) -> bool {
        self.views.iter().any(|view| !view.complete)
    }
}

fn headline_keys() -> Vec<Key> {
    Metric::headlines().filter_map(|metric| metric.key).collect()
}

/// Returns the rank at the top of a row's tie group, unless the row is at the top.
fn tied_with(rows: &[LeaderboardRow], row: &LeaderboardRow) -> Option<u32> {
    let group = |row: &LeaderboardRow| row.standing.map(|standing| standing.tie_group);
    let own = group(row)?;
    let first = rows.iter().find(|other| group(other) == Some(own))?;
    first.standing.filter(|_| first.run != row.run).map(|standing| standing.rank)
}

fn caption(view: &LeaderboardView) -> String {
    format!(
        "{} over {} in {}, ranked by {} ({}); each method is represented by its {} run{}.{}{}",
        entry_count(view),
        format::plural(&view.phase.episodes, "episode"),
        format::plural(&view.phase.scenes, "scene"),
        format::metric(&view.key),
        format::better(&view.direction),
        view.pick,
        as_of(view),
        scorers(&view.rows),
        format::rows_note(&view.rows),
    )
}

fn orders_caption(views: &[LeaderboardView], controls: &LeaderboardControls) -> String {
    let counts: Vec<String> =
        views.iter().map(|view| format!("{}: {}", format::order(&view.order), entry_count(view))).collect();
    let has_few_scenes = views.iter().flat_map(|view| &view.rows).any(|row| row.summary.has_few_scenes());
    format!(
        "{}. Ranked by {} ({}) in each order; each method is represented by its {} run{}.{}",
        counts.join("; "),
        format::metric(&controls.key),
        format::better(&controls.key.direction()),
        controls.pick,
        views.first().map_or_else(String::new, as_of),
        format::few_scenes_note(has_few_scenes),
    )
}

fn entry_count(view: &LeaderboardView) -> String {
    let all = format::plural(&view.entries, "method");
    let shown = view.rows.len() as u32;
    if shown == view.entries { all } else { format!("{shown} of {all}, ranked among all of them,") }
}

fn as_of(view: &LeaderboardView) -> String {
    view.as_of_unix_ms.map_or_else(String::new, |moment| format!(", as of the end of {} UTC", day(moment)))
}

/// Returns a sentence with the benchmark versions that scored the entries.
fn scorers(rows: &[LeaderboardRow]) -> String {
    let versions: BTreeSet<&str> =
        rows.iter().map(|row| row.scorer.as_str()).filter(|version| !version.is_empty()).collect();
    let listed = versions.iter().copied().collect::<Vec<_>>().join(", ");
    match versions.len() {
        0 => String::new(),
        1 => format!(" Scored by benchmark {listed}."),
        _ => format!(" Scored by benchmarks {listed}: see each run."),
    }
}
