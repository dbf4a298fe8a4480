//! The metrics as Prometheus reads them: text exposition format 0.0.4. They name no team, method, run or scene.

use crate::Arena;
use avln_grpc::{Histogram, Snapshot};
use avln_store::Census;
use std::fmt::{Display, Write};

/// All metrics.
pub(super) fn text(arena: &Arena, census: &Census) -> String {
    let seen = arena.control().snapshot();
    let mut page = Page::default();
    page.family("avln_info", "gauge", "Version of the server.");
    page.line("avln_info", &format!("version=\"{}\"", env!("CARGO_PKG_VERSION")), 1);
    page.family("avln_draining", "gauge", "Whether the server is about to stop.");
    page.line("avln_draining", "", u8::from(arena.control().draining().is_some()));
    stored(&mut page, census);
    played(&mut page, &seen);
    page.family("avln_scene_bytes", "gauge", "Memory of scenes that are ready.");
    page.line("avln_scene_bytes", "", arena.scene_bytes());
    let watchdog = arena.control().watchdog();
    page.family("avln_hanging", "gauge", "Threads that were given up and still simulate.");
    page.line("avln_hanging", "", watchdog.hanging());
    page.family("avln_given_up_total", "counter", "Simulations that were given up since the server started.");
    page.line("avln_given_up_total", "", watchdog.given_up());
    page.family(
        "avln_faults_total",
        "counter",
        "Failures of the server's own, such as of its database, since it started.",
    );
    page.line("avln_faults_total", "", crate::fault_count());
    page.0
}

fn stored(page: &mut Page, census: &Census) {
    page.family("avln_runs", "gauge", "Runs in the database by state.");
    for (state, count) in &census.runs {
        page.line("avln_runs", &format!("state=\"{state}\""), count);
    }
    page.family("avln_episodes", "gauge", "Episodes in the database by state and end reason.");
    for (state, end, count) in &census.episodes {
        page.line(
            "avln_episodes",
            &format!("state=\"{state}\",end=\"{}\"", end.as_deref().unwrap_or("")),
            count,
        );
    }
}

fn played(page: &mut Page, seen: &Snapshot) {
    let mut runs: Vec<&str> = seen.slots.iter().map(|slot| slot.run.as_str()).collect();
    runs.dedup();
    page.family("avln_sessions", "gauge", "Runs with an open episode.");
    page.line("avln_sessions", "", runs.len());
    page.family("avln_open_episodes", "gauge", "Slots that hold an episode.");
    page.line("avln_open_episodes", "", seen.slots.len());
    page.family("avln_steps_total", "counter", "Steps since the server started.");
    page.line("avln_steps_total", "", seen.steps);
    page.family(
        "avln_episodes_ended_total",
        "counter",
        "Episodes that ended since the server started, by end reason.",
    );
    for (end, count) in &seen.ends {
        page.line("avln_episodes_ended_total", &format!("end=\"{end}\""), count);
    }
    page.family("avln_step_seconds", "histogram", "What a step took, by part.");
    for (part, histogram) in &seen.parts {
        page.histogram("avln_step_seconds", part, histogram);
    }
}

#[derive(Default)]
struct Page(String);

impl Page {
    fn family(&mut self, name: &str, kind: &str, help: &str) {
        // Writing to a string cannot fail.
        let _ = write!(self.0, "# HELP {name} {help}\n# TYPE {name} {kind}\n");
    }

    fn line(&mut self, name: &str, labels: &str, value: impl Display) {
        let _ = match labels {
            "" => writeln!(self.0, "{name} {value}"),
            labels => writeln!(self.0, "{name}{{{labels}}} {value}"),
        };
    }

    fn histogram(&mut self, name: &str, part: &str, histogram: &Histogram) {
        let limits = Histogram::LIMITS_S.map(|limit| limit.to_string());
        let limits = limits.iter().map(String::as_str).chain(["+Inf"]);
        let mut sum = 0;
        for (limit, count) in limits.zip(histogram.counts) {
            sum += count;
            self.line(&format!("{name}_bucket"), &format!("part=\"{part}\",le=\"{limit}\""), sum);
        }
        self.line(&format!("{name}_sum"), &format!("part=\"{part}\""), histogram.sum_s);
        self.line(&format!("{name}_count"), &format!("part=\"{part}\""), sum);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buckets_are_cumulative_and_end_with_all() {
        let mut histogram = Histogram::default();
        (histogram.counts[0], histogram.counts[3], histogram.counts[15]) = (1, 2, 4);
        histogram.sum_s = 250.5;
        let mut page = Page::default();
        page.histogram("t", "queue", &histogram);
        assert!(page.0.starts_with("t_bucket{part=\"queue\",le=\"0.0001\"} 1\n"), "{}", page.0);
        assert!(page.0.contains("t_bucket{part=\"queue\",le=\"0.001\"} 3\n"), "{}", page.0);
        assert!(page.0.contains("t_bucket{part=\"queue\",le=\"60\"} 3\n"), "{}", page.0);
        assert!(
            page.0.ends_with("le=\"+Inf\"} 7\nt_sum{part=\"queue\"} 250.5\nt_count{part=\"queue\"} 7\n"),
            "{}",
            page.0
        );
    }
}
