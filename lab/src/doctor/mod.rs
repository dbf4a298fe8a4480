//! The check before a counted run: reachability, permissions and expected duration.

use avln_arena::{BENCHMARK_VERSION, now_unix_ms};
use avln_client::{
    Client, ConnectOptions, Error, Phase, PhaseState, Quota, QuotaWindow, Sensors, ServerInfo,
};
use avln_store::calendar::rfc3339;
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

mod practice;

const ROUND_TRIPS: usize = 20;
/// Clock difference for a warning, seconds.
const CLOCK_S: f64 = 2.0;
/// Remaining token lifetime for a warning, seconds.
const SOON_S: i64 = 7 * 86_400;
const LOST: &str = "the connection was lost: check the network";

/// Check settings.
#[derive(Clone, Debug)]
pub struct DoctorOptions {
    /// gRPC server URL.
    pub server: String,
    /// PEM file with trusted authorities, instead of the system's.
    pub ca: Option<PathBuf>,
    /// Account token.
    pub token: String,
    /// Planned phase; empty for the practice phase.
    pub phase: String,
    /// Phase for practice; `phase` if `None`.
    pub practice: Option<String>,
    /// Practice episodes.
    pub episodes: u32,
    /// Action limit per practice episode.
    pub steps: u32,
    /// Sensors in practice.
    pub sensors: Sensors,
}

/// All results.
#[derive(Clone, Debug, Default, Serialize)]
pub struct DoctorReport {
    /// Checks, in execution order.
    pub checks: Vec<Check>,
    /// Measurements.
    pub measured: Measured,
}

/// A check.
#[derive(Clone, Debug, Serialize)]
pub struct Check {
    /// Subject.
    pub name: &'static str,
    /// Outcome.
    pub verdict: Verdict,
    /// Finding, as text.
    pub found: String,
    /// Advice; may be empty.
    pub next: String,
}

/// A check's outcome.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// No problem.
    Ok,
    /// A run is possible, with a possible problem.
    Warning,
    /// A run would fail.
    Failed,
    /// Not checked.
    Skipped,
}

impl Verdict {
    /// Returns the word for tables.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Warning => "warning",
            Self::Failed => "FAILED",
            Self::Skipped => "skipped",
        }
    }
}

/// Measurements. Times are seconds.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Measured {
    /// Request to answer.
    pub round_trip_s: Option<Spread>,
    /// Server clock minus local clock.
    pub clock_ahead_s: Option<f64>,
    /// Episode request to first observation.
    pub begin_s: Option<Spread>,
    /// Action to observation.
    pub step_s: Option<Spread>,
    /// Steps per second in one slot, without the agent's own time.
    pub steps_per_s: Option<f64>,
    /// Uncompressed sensor bytes per observation.
    pub observation_bytes: Option<usize>,
    /// Longest run in one slot, without the agent's own time.
    pub longest_run_s: Option<f64>,
}

/// A measurement's distribution.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Median.
    pub median: f64,
    /// 95th percentile.
    pub p95: f64,
    /// Maximum.
    pub max: f64,
    /// Count.
    pub count: usize,
}

impl Spread {
    /// Summarises values; `None` without values.
    pub fn of(mut values: Vec<f64>) -> Option<Self> {
        values.sort_by(f64::total_cmp);
        let at = |share: f64| values.get((share * (values.len().saturating_sub(1)) as f64).round() as usize);
        let (&median, &p95, &max) = (at(0.5)?, at(0.95)?, values.last()?);
        Some(Self { median, p95, max, count: values.len() })
    }
}

impl DoctorReport {
    /// Returns `true` if no check failed.
    pub fn is_well(&self) -> bool {
        self.checks.iter().all(|check| check.verdict != Verdict::Failed)
    }

    fn add(&mut self, name: &'static str, verdict: Verdict, found: impl ToString, next: &str) {
        self.checks.push(Check { name, verdict, found: found.to_string(), next: next.to_owned() });
    }

    fn ok(&mut self, name: &'static str, found: impl ToString) {
        self.add(name, Verdict::Ok, found, "");
    }

    fn failed(&mut self, name: &'static str, found: impl ToString, next: &str) {
        self.add(name, Verdict::Failed, found, next);
    }

    fn skipped(&mut self, name: &'static str, found: impl ToString, next: &str) {
        self.add(name, Verdict::Skipped, found, next);
    }

    /// Adds a warning with advice, or `ok` if all is well.
    fn warn_unless(&mut self, is_well: bool, name: &'static str, found: impl ToString, next: &str) {
        if is_well {
            self.ok(name, found);
        } else {
            self.add(name, Verdict::Warning, found, next);
        }
    }
}

/// Runs the checks; a failed check may skip later ones.
pub async fn examine(options: &DoctorOptions) -> DoctorReport {
    let mut report = DoctorReport::default();
    let link = ConnectOptions { ca: options.ca.clone(), ..ConnectOptions::default() };
    let connected = match Client::connect_with(&options.server, "", &link).await {
        Ok(client) => client.server_info().await.map(|info| (client, info)),
        Err(error) => Err(error),
    };
    match connected {
        Ok((client, info)) => {
            report.ok("server", format!("{} answers at {}", info.name, options.server));
            versions(&mut report, &info);
            if let Err(error) = round_trips(&mut report, &client).await {
                report.failed("round trip", error, LOST);
            }
            account(&mut report, options, &link).await;
        }
        Err(error) => report.failed(
            "server",
            error,
            "check --server: by default agents connect to http://HOST:50051 or https://HOST:50051",
        ),
    }
    report
}

fn versions(report: &mut DoctorReport, info: &ServerInfo) {
    let own = env!("CARGO_PKG_VERSION");
    let found = format!(
        "server {} with benchmark {}, this program {own} with {BENCHMARK_VERSION}",
        info.version, info.benchmark
    );
    let next = "scores of this program may differ from the server's";
    report.warn_unless(info.benchmark == BENCHMARK_VERSION, "versions", found, next);
    if info.draining {
        let found = format!("the server is shutting down and begins no runs: {}", info.notice);
        report.failed("state", found, "wait until the server is back");
    } else if !info.notice.is_empty() {
        report.add("state", Verdict::Warning, format!("notice from the organiser: {}", info.notice), "");
    } else {
        report.ok("state", "up");
    }
}

async fn round_trips(report: &mut DoctorReport, client: &Client) -> Result<(), Error> {
    let mut trips = Vec::with_capacity(ROUND_TRIPS);
    let mut fastest = f64::INFINITY;
    let mut ahead = 0.0;
    for _ in 0..ROUND_TRIPS {
        let (sent, before) = (now_unix_ms(), Instant::now());
        let info = client.server_info().await?;
        let trip = before.elapsed().as_secs_f64();
        if trip < fastest {
            fastest = trip;
            // The server read the clock about half a round trip after the request; the fastest trip has the least error.
            ahead = (info.time_unix_ms - sent) as f64 / 1000.0 - trip / 2.0;
        }
        trips.push(trip);
    }
    let spread = Spread::of(trips);
    if let Some(spread) = spread {
        report.ok("round trip", format!("{}, p95 {}", ms(spread.median), ms(spread.p95)));
    }
    let side = if ahead < 0.0 { "behind" } else { "ahead of" };
    let found = format!("the server's clock is {:.3} s {side} this machine's", ahead.abs());
    let next = "the server's clock decides when phases and tokens expire";
    report.warn_unless(ahead.abs() <= CLOCK_S, "clock", found, next);
    report.measured.round_trip_s = spread;
    report.measured.clock_ahead_s = Some(ahead);
    Ok(())
}

fn ms(seconds: f64) -> String {
    format!("{:.1} ms", seconds * 1000.0)
}

async fn account(report: &mut DoctorReport, options: &DoctorOptions, link: &ConnectOptions) {
    let known = match Client::connect_with(&options.server, options.token.as_str(), link).await {
        Ok(client) => client.whoami().await.map(|account| (client, account)),
        Err(error) => Err(error),
    };
    let (client, account) = match known {
        Ok(known) => known,
        Err(error) => {
            return report.failed("token", error, "ask the organiser for a token of your team's account");
        }
    };
    let left_s = account.expires_unix_s - now_unix_ms() / 1000;
    let left = match account.expires_unix_s {
        0 => "without expiry".to_owned(),
        _ if left_s > SOON_S => format!("valid for {} days", left_s / 86_400),
        _ => format!("valid for {} hours", left_s / 3600),
    };
    let is_well = account.expires_unix_s == 0 || left_s > SOON_S;
    let found = format!("of team '{}', {left}", account.team);
    report.warn_unless(is_well, "token", found, "ask the organiser for a new token in time");
    match phase(report, options, &client).await {
        Ok(Some((phase, quotas))) => practice::check(report, options, &client, &phase, &quotas).await,
        Ok(None) => {}
        Err(error @ Error::Phase { .. }) => report.failed("phase", error, ""),
        Err(error) => report.failed("phase", error, LOST),
    }
}

/// Checks the planned phase; returns it with the quotas of all phases.
async fn phase(
    report: &mut DoctorReport,
    options: &DoctorOptions,
    client: &Client,
) -> Result<Option<(Phase, Vec<Quota>)>, Error> {
    let wanted = match options.phase.as_str() {
        "" => client.practice_phase().await?,
        named => named.to_owned(),
    };
    let phases = client.phases().await?;
    let Some(phase) = phases.iter().find(|phase| phase.id == wanted).cloned() else {
        let known: Vec<_> = phases.iter().map(|phase| phase.id.as_str()).collect();
        let found = format!("the team sees no phase '{wanted}'");
        report.failed("phase", found, &format!("choose one of: {}", known.join(", ")));
        return Ok(None);
    };
    let found = format!(
        "{}: {} episodes by {}, up to {} slots",
        phase.id, phase.episodes, phase.rules, phase.max_slots
    );
    if phase.state == PhaseState::Open {
        report.ok("phase", found);
    } else {
        let state = format!("{:?}", phase.state).to_lowercase();
        let found = format!("{found}; the phase is {state} {}", phase.state_reason);
        report.failed("phase", found.trim_end(), "runs start only in open phases");
    }
    let quotas = client.quota().await?;
    check_quota(report, &phase.id, &quotas);
    Ok(Some((phase, quotas)))
}

/// Windows from the shortest to the longest.
const WINDOWS: [QuotaWindow; 6] = [
    QuotaWindow::Day,
    QuotaWindow::Month,
    QuotaWindow::Total,
    QuotaWindow::Uncharged,
    QuotaWindow::Concurrent,
    QuotaWindow::Other,
];

/// Checks that every limited window of the phase has a run left.
fn check_quota(report: &mut DoctorReport, phase: &str, quotas: &[Quota]) {
    let limited = move |window: QuotaWindow| {
        quotas
            .iter()
            .filter(move |quota| quota.phase == phase && quota.window == window && quota.limit.is_some())
    };
    let limited: Vec<&Quota> = WINDOWS.into_iter().flat_map(limited).collect();
    if limited.is_empty() {
        return report.ok("quota", "unlimited runs");
    }
    let left: Vec<String> = limited.iter().map(|quota| left_in(quota)).collect();
    let found = format!("runs left: {}", left.join(", "));
    // Waiting does not help against the longest window, so its advice comes first.
    let used_up = limited.iter().filter(|quota| quota.remaining == Some(0));
    match used_up.max_by_key(|quota| lasting(quota.window)) {
        Some(quota) => report.failed("quota", found, &advice(quota)),
        None => report.ok("quota", found),
    }
}

fn left_in(quota: &Quota) -> String {
    let window = match quota.window {
        QuotaWindow::Day => "today (UTC)",
        QuotaWindow::Month => "this month (UTC)",
        QuotaWindow::Total => "in all",
        QuotaWindow::Concurrent => "at the same time",
        QuotaWindow::Uncharged => "without charge",
        QuotaWindow::Other => "in a window unknown to this program",
    };
    format!("{} of {} {window}", quota.remaining.unwrap_or_default(), quota.limit.unwrap_or_default())
}

/// Ranks windows by the time until a run is possible again.
fn lasting(window: QuotaWindow) -> u8 {
    match window {
        QuotaWindow::Concurrent => 0,
        QuotaWindow::Day => 1,
        QuotaWindow::Month => 2,
        QuotaWindow::Total | QuotaWindow::Uncharged | QuotaWindow::Other => 3,
    }
}

fn advice(quota: &Quota) -> String {
    match quota.window {
        QuotaWindow::Concurrent => "finish or cancel the open run".to_owned(),
        QuotaWindow::Day | QuotaWindow::Month if quota.next_increase_unix_s > 0 => {
            format!("wait until {}", rfc3339(quota.next_increase_unix_s.saturating_mul(1000)))
        }
        _ => "ask the organiser for more runs".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    #[test]
    fn spread_has_median_percentile_and_maximum() {
        let spread = Spread::of((1..=101).rev().map(f64::from).collect()).unwrap();
        assert_eq!(spread, Spread { median: 51.0, p95: 96.0, max: 101.0, count: 101 });
        assert_eq!(Spread::of(vec![]), None);
        assert_eq!(Spread::of(vec![2.0]).unwrap().p95, 2.0);
    }

    #[test]
    fn only_failures_make_a_report_unwell() {
        let mut report = DoctorReport::default();
        report.add("clock", Verdict::Warning, "2 s ahead", "set it");
        assert!(report.is_well());
        report.failed("token", "refused", "ask for another");
        assert!(!report.is_well());
    }

    fn quota(window: QuotaWindow, remaining: u32, limit: u32) -> Quota {
        Quota {
            phase: "finals".to_owned(),
            window,
            limit: Some(limit),
            used: limit - remaining,
            remaining: Some(remaining),
            next_increase_unix_s: if window == QuotaWindow::Day { 86_400 } else { 0 },
            charges: vec![],
        }
    }

    fn checked(quotas: &[Quota]) -> Check {
        let mut report = DoctorReport::default();
        check_quota(&mut report, "finals", quotas);
        report.checks.remove(0)
    }

    #[test]
    fn every_limited_window_is_listed() {
        let unlimited = Quota { limit: None, remaining: None, ..quota(QuotaWindow::Month, 0, 0) };
        let elsewhere = Quota { phase: "practice".to_owned(), ..quota(QuotaWindow::Day, 0, 1) };
        let total = quota(QuotaWindow::Total, 3, 3);
        let concurrent = quota(QuotaWindow::Concurrent, 1, 1);
        let well = checked(&[total, unlimited, elsewhere, quota(QuotaWindow::Day, 1, 2), concurrent]);
        assert_eq!(well.verdict, Verdict::Ok);
        assert_eq!(well.found, "runs left: 1 of 2 today (UTC), 3 of 3 in all, 1 of 1 at the same time");
        assert_eq!(checked(&[]).found, "unlimited runs");
    }

    #[test]
    fn used_up_window_fails_with_its_advice() {
        let [total, day, concurrent] =
            [QuotaWindow::Total, QuotaWindow::Day, QuotaWindow::Concurrent].map(|window| quota(window, 0, 1));
        for (quotas, advice) in [
            (vec![concurrent.clone(), quota(QuotaWindow::Day, 1, 2)], "finish or cancel the open run"),
            (vec![concurrent.clone(), day.clone()], "wait until 1970-01-02T00:00:00Z"),
            (vec![total, day, concurrent], "ask the organiser for more runs"),
        ] {
            let check = checked(&quotas);
            assert_eq!((check.verdict, check.next.as_str()), (Verdict::Failed, advice), "{}", check.found);
        }
    }
}
