//! Team quotas.

use crate::{
    calendar,
    phase::Schedule,
    run::{Charge, RunUse},
    words,
};
use serde::{Deserialize, Serialize};

/// Run limits per team in a phase; `None` for no limit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct QuotaLimits {
    /// Charged runs in a UTC day.
    pub day: Option<u32>,
    /// Charged runs in a UTC month.
    pub month: Option<u32>,
    /// Charged runs in the phase.
    pub total: Option<u32>,
    /// Runs open at the same time.
    pub concurrent: Option<u32>,
    /// Uncharged runs in the phase. Bounds free failures. Without a value, 20 in a phase that limits charged runs.
    pub uncharged: Option<u32>,
}

impl QuotaLimits {
    /// Uncharged runs in a phase with a limit by day, month or in total, if `uncharged` is not set.
    pub const DEFAULT_UNCHARGED: u32 = 20;

    /// Returns the limit of uncharged runs; `None` for no limit.
    fn most_uncharged(&self) -> Option<u32> {
        let counts_runs = [self.day, self.month, self.total].iter().any(Option::is_some);
        self.uncharged.or(counts_runs.then_some(Self::DEFAULT_UNCHARGED))
    }

    /// Returns a window's limit; `None` if the window is not reported. The total is always reported.
    pub fn of(&self, window: QuotaWindow) -> Option<Option<u32>> {
        match window {
            QuotaWindow::Day => self.day.map(Some),
            QuotaWindow::Month => self.month.map(Some),
            QuotaWindow::Total => Some(self.total),
            QuotaWindow::Concurrent => self.concurrent.map(Some),
            QuotaWindow::Uncharged => self.most_uncharged().map(Some),
        }
    }
}

/// The runs counted by a quota, and the refilling event.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum QuotaWindow {
    /// Charged runs in a UTC day; refilled at midnight.
    Day,
    /// Charged runs in a UTC month; refilled on the first.
    Month,
    /// Charged runs in the phase; never refilled.
    Total,
    /// Open runs; refilled when one ends.
    Concurrent,
    /// Uncharged runs in the phase; never refilled.
    Uncharged,
}
words!(QuotaWindow, "quota window", {
    Day => "day", Month => "month", Total => "total", Concurrent => "concurrent", Uncharged => "uncharged",
});

/// A team's used and remaining runs in a window. Times are milliseconds since 1970-01-01 UTC.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, utoipa::ToSchema)]
pub struct Quota {
    /// Phase id.
    pub phase: String,
    /// The window.
    pub window: QuotaWindow,
    /// Granted runs; `None` for no limit.
    pub limit: Option<u32>,
    /// Counted runs.
    pub used: u32,
    /// Remaining runs; `None` for no limit.
    pub remaining: Option<u32>,
    /// Window start.
    pub window_start_unix_ms: i64,
    /// Next refill; `None` if waiting does not help.
    pub next_increase_unix_ms: Option<i64>,
    /// The counted runs, oldest first; at most the latest 200.
    pub charges: Vec<Charge>,
}

/// Runs granted by the organiser beyond the quota.
#[derive(Clone, Copy, Debug)]
pub struct RunGrant {
    /// Run count.
    pub runs: u32,
    /// Grant time, milliseconds since 1970-01-01 UTC.
    pub granted_unix_ms: i64,
}

/// A window's start and end; `None` for no end.
#[derive(Clone, Copy)]
struct Span {
    start: i64,
    end: Option<i64>,
}

impl Span {
    fn contains(self, unix_ms: i64) -> bool {
        self.end.is_none_or(|end| (self.start..end).contains(&unix_ms))
    }
}

/// Returns a team's quotas in all limited windows and the whole phase. `runs` are the team's runs there, oldest first.
pub fn quotas(
    phase: &str,
    limits: &QuotaLimits,
    schedule: &Schedule,
    runs: &[RunUse],
    grants: &[RunGrant],
    now_unix_ms: i64,
) -> Vec<Quota> {
    // The window that lasts longest comes first, so that a refusal names it.
    let windows = [
        QuotaWindow::Total,
        QuotaWindow::Uncharged,
        QuotaWindow::Month,
        QuotaWindow::Day,
        QuotaWindow::Concurrent,
    ];
    let quota = |window| {
        let (start, end) = match window {
            QuotaWindow::Month => calendar::month_around(now_unix_ms),
            QuotaWindow::Day => calendar::day_around(now_unix_ms),
            _ => (schedule.opens_unix_ms.unwrap_or(0), i64::MAX),
        };
        let end = Some(end).filter(|_| matches!(window, QuotaWindow::Month | QuotaWindow::Day));
        let span = Span { start, end };
        let limit = limits.of(window)?.map(|limit| limit.saturating_add(granted(window, span, grants)));
        Some(quota_of(phase, window, limit, span, runs))
    };
    windows.into_iter().filter_map(quota).collect()
}

/// Counts runs granted in a window. Grants never raise the limit for parallel runs.
fn granted(window: QuotaWindow, span: Span, grants: &[RunGrant]) -> u32 {
    if window == QuotaWindow::Concurrent {
        return 0;
    }
    // A grant counts in the window in which it was given, so that it expires with this window.
    let inside = grants.iter().filter(|grant| span.contains(grant.granted_unix_ms));
    inside.fold(0, |sum, grant| sum.saturating_add(grant.runs))
}

fn quota_of(phase: &str, window: QuotaWindow, limit: Option<u32>, span: Span, runs: &[RunUse]) -> Quota {
    let counts = |run: &&RunUse| match window {
        QuotaWindow::Concurrent => run.state.is_open(),
        QuotaWindow::Uncharged => !run.charge().charged,
        _ => run.charge().charged && span.contains(run.created_unix_ms),
    };
    let counted: Vec<&RunUse> = runs.iter().filter(counts).collect();
    let used = counted.len() as u32;
    let listed = &counted[counted.len().saturating_sub(Charge::MAX_LISTED)..];
    Quota {
        phase: phase.to_owned(),
        window,
        limit,
        used,
        remaining: limit.map(|limit| limit.saturating_sub(used)),
        window_start_unix_ms: span.start,
        next_increase_unix_ms: span.end.filter(|_| used > 0),
        charges: listed.iter().map(|run| run.charge()).collect(),
    }
}
