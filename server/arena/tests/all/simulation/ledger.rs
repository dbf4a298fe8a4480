//! Quotas by the rules of `PROTOCOL.md`, computed from the rows of the database.

use super::{
    database::{EpisodeRow, GrantRow, PhaseRow, Rows, RunRow},
    setting::PhaseSetting,
};
use avln_challenge::QuotaLimits;
use avln_proto::v1::{self, QuotaWindow, Reason};
use std::collections::BTreeSet;

const DAY_MS: i64 = 86_400_000;

/// A team's runs in a phase.
pub(crate) struct Ledger<'a> {
    team: &'a str,
    phase: &'a PhaseSetting,
    rows: &'a Rows,
    now_unix_ms: i64,
}

/// A window's limit and counted runs.
pub(crate) struct Account {
    window: QuotaWindow,
    limit: Option<u32>,
    counted: BTreeSet<String>,
}

impl Account {
    fn is_used_up(&self) -> bool {
        self.limit.is_some_and(|limit| self.counted.len() as u32 >= limit)
    }
}

impl<'a> Ledger<'a> {
    pub(crate) fn new(team: &'a str, phase: &'a PhaseSetting, rows: &'a Rows, now_unix_ms: i64) -> Self {
        Self { team, phase, rows, now_unix_ms }
    }

    fn runs(&self) -> impl Iterator<Item = &'a RunRow> {
        let (team, phase) = (self.team, self.phase.id);
        self.rows.runs.iter().filter(move |run| run.team == team && run.phase == phase)
    }

    fn grants(&self) -> impl Iterator<Item = &'a GrantRow> {
        let (team, phase) = (self.team, self.phase.id);
        self.rows.grants.iter().filter(move |grant| grant.team == team && grant.phase == phase)
    }

    /// Returns the windows that the phase reports.
    pub(crate) fn accounts(&self) -> Vec<Account> {
        let QuotaLimits { day, month, total, concurrent, .. } = self.phase.quotas;
        let day_of = |unix_ms: i64| unix_ms.div_euclid(DAY_MS);
        let today = |unix_ms| day_of(unix_ms) == day_of(self.now_unix_ms);
        let this_month = |unix_ms| month_of(day_of(unix_ms)) == month_of(day_of(self.now_unix_ms));
        let charged = |within: &dyn Fn(i64) -> bool| {
            let counts = |run: &&RunRow| is_charged(run, self.rows) && within(run.created_ms);
            self.runs().filter(counts).map(|run| run.id.clone()).collect()
        };
        let granted = |within: &dyn Fn(i64) -> bool| -> u32 {
            self.grants().filter(|grant| within(grant.granted_ms)).map(|grant| grant.runs).sum()
        };
        let mut accounts = vec![Account {
            window: QuotaWindow::Total,
            limit: total.map(|limit| limit + granted(&|_| true)),
            counted: charged(&|_| true),
        }];
        if let Some(limit) = uncharged_limit(&self.phase.quotas) {
            let free = self.runs().filter(|run| !is_charged(run, self.rows));
            let counted = free.map(|run| run.id.clone()).collect();
            let limit = Some(limit + granted(&|_| true));
            accounts.push(Account { window: QuotaWindow::Uncharged, limit, counted });
        }
        if let Some(limit) = month {
            let (limit, counted) = (Some(limit + granted(&this_month)), charged(&this_month));
            accounts.push(Account { window: QuotaWindow::Month, limit, counted });
        }
        if let Some(limit) = day {
            let (limit, counted) = (Some(limit + granted(&today)), charged(&today));
            accounts.push(Account { window: QuotaWindow::Day, limit, counted });
        }
        if concurrent.is_some() {
            let open = self.runs().filter(|run| run.is_open()).map(|run| run.id.clone());
            let counted = open.collect();
            accounts.push(Account { window: QuotaWindow::Concurrent, limit: concurrent, counted });
        }
        accounts
    }

    /// Returns the reason for which a new run is refused.
    pub(crate) fn refusal(&self) -> Option<Reason> {
        let phase = self.rows.phases.iter().find(|phase| phase.id == self.phase.id)?;
        if let Some(reason) = closed(phase, self.now_unix_ms) {
            return Some(reason);
        }
        let accounts = self.accounts();
        let used_up = accounts.iter().find(|account| account.is_used_up())?;
        Some(match used_up.window {
            QuotaWindow::Day => Reason::QuotaDay,
            QuotaWindow::Month => Reason::QuotaMonth,
            QuotaWindow::Concurrent => Reason::QuotaConcurrent,
            _ => Reason::QuotaTotal,
        })
    }

    /// Compares the quotas that the server reports.
    pub(crate) fn check(&self, reported: &[v1::Quota]) -> Result<(), String> {
        let accounts = self.accounts();
        if accounts.len() != reported.len() {
            return Err(format!("{} quotas instead of {}", reported.len(), accounts.len()));
        }
        for (account, quota) in accounts.iter().zip(reported) {
            let charges: BTreeSet<_> = quota.charges.iter().map(|charge| charge.run.clone()).collect();
            let used = account.counted.len() as u32;
            let remaining = account.limit.map(|limit| limit.saturating_sub(used));
            let is_equal = account.window == quota.window()
                && (account.limit, used, remaining) == (quota.limit, quota.used, quota.remaining)
                && account.counted == charges;
            if !is_equal {
                return Err(format!(
                    "team {} in phase {}: the ledger has {:?} {used} of {:?}, {:?}; the server reports {quota:?}",
                    self.team, self.phase.id, account.window, account.limit, account.counted
                ));
            }
        }
        Ok(())
    }
}

fn closed(phase: &PhaseRow, now_unix_ms: i64) -> Option<Reason> {
    if phase.state == "closed" || phase.closes_ms.is_some_and(|closes| closes <= now_unix_ms) {
        return Some(Reason::PhaseClosed);
    }
    phase.paused.is_some().then_some(Reason::PhasePaused)
}

fn uncharged_limit(quotas: &QuotaLimits) -> Option<u32> {
    let counts = quotas.day.is_some() || quotas.month.is_some() || quotas.total.is_some();
    quotas.uncharged.or(counts.then_some(20))
}

/// Returns whether a run counts: "An open run counts. After its end, a run counts if all episodes were played, or if an episode
/// began. It does not count if the server failed, lost an episode for good, or lost every episode that began."
pub(crate) fn is_charged(run: &RunRow, rows: &Rows) -> bool {
    let mut episodes = rows.episodes_of(&run.id).iter();
    if run.is_open() {
        return true;
    }
    let lost = |episode: &EpisodeRow| episode.state == "infra";
    if run.state == "failed" || episodes.clone().any(lost) {
        return false;
    }
    run.state == "completed" || episodes.any(|episode| episode.is_scored() || episode.state == "running")
}

/// Returns a number for the calendar month of a day since 1970-01-01 (Howard Hinnant, `civil_from_days`).
fn month_of(day: i64) -> i64 {
    let shifted = day + 719_468;
    let era = shifted.div_euclid(146_097);
    let of_era = shifted.rem_euclid(146_097);
    let year = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year + year / 4 - year / 100);
    // From March on, so that the leap day is the last of the year.
    let month = (5 * of_year + 2) / 153;
    (era * 400 + year) * 12 + month
}
