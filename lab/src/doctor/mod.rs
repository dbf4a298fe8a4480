//! The check before a counted run: reachability, permissions and expected duration.

mod practice;
mod report;

pub use report::{Check, DoctorReport, Measured, Spread, Verdict};

use avln_arena::{BENCHMARK_VERSION, now_unix_ms};
use avln_client::{Client, ConnectOptions, Error, Order, Phase, PhaseState, Quota, Sensors, ServerInfo};
use std::{path::PathBuf, time::Instant};

/// Number of requests for the round-trip time.
const ROUND_TRIPS: usize = 20;
/// Clock difference for a warning, seconds.
const CLOCK_S: f64 = 2.0;
/// Remaining lifetime of a token for a warning, seconds.
const SOON_S: i64 = 7 * 86_400;

/// Settings of the check.
#[derive(Clone, Debug)]
pub struct DoctorOptions {
    /// URL of the gRPC server.
    pub server: String,
    /// File of trusted authorities, instead of those of the system.
    pub ca: Option<PathBuf>,
    /// Token of an account.
    pub token: String,
    /// The phase that is to be played; empty: the one to practise in.
    pub phase: String,
    /// Practice phase; the phase itself for `None`.
    pub practice: Option<String>,
    /// Episodes to practise.
    pub episodes: u32,
    /// Actions in each, at most.
    pub steps: u32,
    /// Sensors of the practice run.
    pub sensors: Sensors,
}

/// Makes all checks, as far as one can be made after the other.
pub async fn examine(options: &DoctorOptions) -> DoctorReport {
    let mut report = DoctorReport::default();
    let link = ConnectOptions { ca: options.ca.clone(), ..ConnectOptions::default() };
    let connected = match Client::connect_with(&options.server, "", &link).await {
        Ok(arena) => arena.server_info().await.map(|info| (arena, info)),
        Err(error) => Err(error),
    };
    match connected {
        Ok((arena, info)) => {
            report.ok("server", format!("{} answers at {}", info.name, options.server));
            versions(&mut report, &info);
            let reached = round_trips(&mut report, &arena).await;
            if let Err(error) = reached {
                report.failed("round trip", error, "the connection does not hold: look at the network");
            }
            account(&mut report, options, &link).await;
        }
        Err(error) => report.failed(
            "server",
            error,
            "--server is where agents connect, http://HOST:50051 or https://HOST:50051 unless the organiser says otherwise",
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
    match info.benchmark == BENCHMARK_VERSION {
        true => report.ok("versions", found),
        false => report.add(
            "versions",
            Verdict::Warning,
            found,
            "what this program scores may differ from the server's scores",
        ),
    }
    if info.draining {
        let found = format!("the server is about to stop and begins no runs: {}", info.notice);
        report.failed("state", found, "wait until it is back");
    } else if !info.notice.is_empty() {
        report.add("state", Verdict::Warning, format!("the organiser announces: {}", info.notice), "");
    } else {
        report.ok("state", "up");
    }
}

async fn round_trips(report: &mut DoctorReport, arena: &Client) -> Result<(), Error> {
    let mut trips = Vec::with_capacity(ROUND_TRIPS);
    let mut best = (f64::INFINITY, 0.0);
    for _ in 0..ROUND_TRIPS {
        let (sent, before) = (now_unix_ms(), Instant::now());
        let info = arena.server_info().await?;
        let trip = before.elapsed().as_secs_f64();
        if trip < best.0 {
            // Its clock was read half a round trip after the question was sent.
            best = (trip, (info.time_unix_ms - sent) as f64 / 1000.0 - trip / 2.0);
        }
        trips.push(trip);
    }
    let (spread, (_, ahead)) = (Spread::of(trips), best);
    if let Some(spread) = spread {
        report.ok("round trip", format!("{}, p95 {}", ms(spread.median), ms(spread.p95)));
    }
    let found = format!(
        "the server's is {:.3} s {} this machine's",
        ahead.abs(),
        if ahead < 0.0 { "behind" } else { "ahead of" }
    );
    match ahead.abs() <= CLOCK_S {
        true => report.ok("clock", found),
        false => report.add(
            "clock",
            Verdict::Warning,
            found,
            "dates of phases and tokens go by the server's clock",
        ),
    }
    (report.measured.round_trip_s, report.measured.clock_ahead_s) = (spread, Some(ahead));
    Ok(())
}

/// A time as people read it.
fn ms(seconds: f64) -> String {
    format!("{:.1} ms", seconds * 1000.0)
}

async fn account(report: &mut DoctorReport, options: &DoctorOptions, link: &ConnectOptions) {
    let known = match Client::connect_with(&options.server, options.token.as_str(), link).await {
        Ok(arena) => arena.whoami().await.map(|account| (arena, account)),
        Err(error) => Err(error),
    };
    let (arena, account) = match known {
        Ok(known) => known,
        Err(error) => {
            return report.failed("token", error, "ask the organiser for a token of your team's account");
        }
    };
    let left_s = account.expires_unix_s - now_unix_ms() / 1000;
    match account.expires_unix_s {
        0 => report.ok("token", format!("of team '{}', for ever", account.team)),
        _ if left_s > SOON_S => {
            report.ok("token", format!("of team '{}', for {} days", account.team, left_s / 86_400))
        }
        _ => report.add(
            "token",
            Verdict::Warning,
            format!("of team '{}', for {} hours", account.team, left_s / 3600),
            "ask the organiser for a new one in time",
        ),
    }
    match phase(report, options, &arena).await {
        Ok(Some((phase, quotas))) => practice::check(report, options, &arena, &phase, &quotas).await,
        Ok(None) => {}
        Err(error @ Error::Phase { .. }) => report.failed("phase", error, ""),
        Err(error) => report.failed("phase", error, "the connection does not hold: look at the network"),
    }
}

/// The phase that is to be played, and what is left in all phases.
async fn phase(
    report: &mut DoctorReport,
    options: &DoctorOptions,
    arena: &Client,
) -> Result<Option<(Phase, Vec<Quota>)>, Error> {
    let wanted = match options.phase.as_str() {
        "" => arena.practice_phase().await?,
        named => named.to_owned(),
    };
    let phases = arena.phases().await?;
    let Some(phase) = phases.iter().find(|phase| phase.id == wanted).cloned() else {
        let known: Vec<_> = phases.iter().map(|phase| phase.id.as_str()).collect();
        let found = format!("there is no phase '{wanted}' that the team may see");
        report.failed("phase", found, &format!("choose one of: {}", known.join(", ")));
        return Ok(None);
    };
    let found = format!(
        "{}: {} episodes by {}, up to {} slots",
        phase.id, phase.episodes, phase.rules, phase.max_slots
    );
    match phase.state {
        PhaseState::Open => report.ok("phase", found),
        state => {
            let found =
                format!("{found}; it is {} {}", format!("{state:?}").to_lowercase(), phase.state_reason);
            report.failed("phase", found.trim_end(), "runs start while a phase is open");
        }
    }
    let quotas = arena.quota().await?;
    quota(report, &phase, &quotas);
    Ok(Some((phase, quotas)))
}

fn quota(report: &mut DoctorReport, phase: &Phase, quotas: &[Quota]) {
    let limited = quotas.iter().filter(|quota| quota.phase == phase.id && quota.limit.is_some());
    let scarcest = limited.min_by_key(|quota| quota.remaining);
    let Some(scarcest) = scarcest else { return report.ok("quota", "any number of runs") };
    let window = format!("{:?}", scarcest.window).to_lowercase();
    let (left, limit) = (scarcest.remaining.unwrap_or_default(), scarcest.limit.unwrap_or_default());
    let found = format!("{left} of {limit} runs are left ({window})");
    match left {
        0 => report.failed("quota", found, "wait for the next window, or ask the organiser for more"),
        _ => report.ok("quota", found),
    }
}

/// True if a run of the phase does not count against the quota of the team.
fn is_free(phase: &str, quotas: &[Quota]) -> bool {
    !quotas.iter().any(|quota| quota.phase == phase && quota.is_counted())
}

/// The order in which a phase is tried: the first that it allows.
fn order(phase: &Phase) -> Order {
    phase.orders.first().copied().unwrap_or(Order::Unordered)
}
