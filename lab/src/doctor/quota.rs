//! The remaining runs in every limited window of a phase.

use super::DoctorReport;
use avln_client::{Quota, QuotaWindow};
use avln_store::calendar::rfc3339;

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
pub(super) fn check(report: &mut DoctorReport, phase: &str, quotas: &[Quota]) {
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
    use crate::doctor::{Check, Verdict};

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
        check(&mut report, "finals", quotas);
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
