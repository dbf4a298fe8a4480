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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::RunState;

    /// Midnight of a day in 2026.
    fn midnight(month: u8, day: u8) -> i64 {
        calendar::unix_ms(2026, month, day, 0).expect("a date")
    }

    fn run(name: &str, state: RunState, created_unix_ms: i64) -> RunUse {
        let (scored, given_up, server_faults, in_progress) = (1, 0, 0, false);
        RunUse { run: name.to_owned(), state, created_unix_ms, scored, given_up, server_faults, in_progress }
    }

    /// Two runs of 15 July, one of them open; the first of July and the last of June; a failed run.
    fn runs() -> Vec<RunUse> {
        vec![
            run("june", RunState::Completed, midnight(7, 1) - 1),
            run("failed", RunState::Failed, midnight(7, 15)),
            run("july", RunState::Completed, midnight(7, 1)),
            run("today", RunState::Cancelled, midnight(7, 15)),
            run("open", RunState::Running, midnight(7, 16) - 1),
        ]
    }

    /// Returns the quotas at noon on 15 July, by window.
    fn at_noon(limits: &QuotaLimits, grants: &[RunGrant]) -> Vec<Quota> {
        let opens_unix_ms = Some(midnight(5, 1));
        let schedule = Schedule { opens_unix_ms, ..Schedule::default() };
        quotas("val", limits, &schedule, &runs(), grants, midnight(7, 15) + 12 * 3_600_000)
    }

    fn limited() -> QuotaLimits {
        QuotaLimits { day: Some(5), month: Some(7), total: Some(9), concurrent: Some(3), uncharged: Some(4) }
    }

    #[test]
    fn each_window_counts_its_own_runs() {
        let names = |quota: &Quota| quota.charges.iter().map(|charge| charge.run.clone()).collect::<Vec<_>>();
        let found: Vec<_> = at_noon(&limited(), &[])
            .iter()
            .map(|quota| (quota.window, quota.limit, quota.remaining, names(quota).join(" ")))
            .collect();
        let expected = [
            (QuotaWindow::Total, 9, 5, "june july today open"),
            (QuotaWindow::Uncharged, 4, 3, "failed"),
            (QuotaWindow::Month, 7, 4, "july today open"),
            (QuotaWindow::Day, 5, 3, "today open"),
            (QuotaWindow::Concurrent, 3, 2, "open"),
        ];
        let expected =
            expected.map(|(window, limit, left, runs)| (window, Some(limit), Some(left), runs.to_owned()));
        assert_eq!(found, expected);
    }

    #[test]
    fn days_and_months_refill_at_their_end() {
        let times = |quota: &Quota| (quota.window_start_unix_ms, quota.next_increase_unix_ms);
        let [total, uncharged, month, day, concurrent] = at_noon(&limited(), &[]).try_into().expect("five");
        for never in [total, uncharged, concurrent] {
            assert_eq!(times(&never), (midnight(5, 1), None));
        }
        assert_eq!(times(&month), (midnight(7, 1), Some(midnight(8, 1))));
        assert_eq!(times(&day), (midnight(7, 15), Some(midnight(7, 16))));

        let unused = quotas("val", &limited(), &Schedule::default(), &[], &[], midnight(7, 15));
        assert!(unused.iter().all(|quota| quota.used == 0 && quota.next_increase_unix_ms.is_none()));
        assert_eq!(unused[0].window_start_unix_ms, 0);
    }

    #[test]
    fn grants_count_in_their_window_and_never_for_parallel_runs() {
        let grant = |runs, granted_unix_ms| RunGrant { runs, granted_unix_ms };
        let grants = [
            grant(1, midnight(7, 1) - 1),
            grant(2, midnight(7, 1)),
            grant(4, midnight(7, 15)),
            grant(8, midnight(7, 16)),
        ];
        let limits: Vec<_> = at_noon(&limited(), &grants).iter().map(|quota| quota.limit).collect();
        assert_eq!(limits, [Some(9 + 15), Some(4 + 15), Some(7 + 14), Some(5 + 4), Some(3)]);
        let most = [grant(u32::MAX, midnight(7, 15)), grant(1, midnight(7, 15))];
        assert_eq!(at_noon(&limited(), &most)[3].limit, Some(u32::MAX));
    }

    #[test]
    fn free_failures_are_bounded_where_runs_are() {
        let windows = |limits: &QuotaLimits| {
            at_noon(limits, &[]).iter().map(|quota| (quota.window, quota.limit)).collect::<Vec<_>>()
        };
        let none = QuotaLimits::default();
        assert_eq!(windows(&none), [(QuotaWindow::Total, None)]);
        assert_eq!(at_noon(&none, &[])[0].remaining, None);
        let concurrent = QuotaLimits { concurrent: Some(1), ..none };
        assert_eq!(windows(&concurrent), [(QuotaWindow::Total, None), (QuotaWindow::Concurrent, Some(1))]);
        let uncharged = (QuotaWindow::Uncharged, Some(QuotaLimits::DEFAULT_UNCHARGED));
        for limits in [
            QuotaLimits { day: Some(1), ..none },
            QuotaLimits { month: Some(1), ..none },
            QuotaLimits { total: Some(1), ..none },
        ] {
            assert_eq!(windows(&limits)[1], uncharged);
        }
        let own = QuotaLimits { day: Some(1), uncharged: Some(2), ..none };
        assert_eq!(windows(&own)[1], (QuotaWindow::Uncharged, Some(2)));
    }

    #[test]
    fn the_latest_200_runs_are_listed() {
        let runs: Vec<_> =
            (0..201).map(|number| run(&number.to_string(), RunState::Completed, midnight(7, 15))).collect();
        let day = QuotaLimits { day: Some(300), ..QuotaLimits::default() };
        let quotas = quotas("val", &day, &Schedule::default(), &runs, &[], midnight(7, 15));
        let day = quotas.last().expect("a window");
        assert_eq!((day.used, day.remaining, day.charges.len()), (201, Some(99), Charge::MAX_LISTED));
        assert_eq!(day.charges[0].run, "1");
    }
}
