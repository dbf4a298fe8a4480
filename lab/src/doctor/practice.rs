//! Practice episodes with the random agent: they measure the run speed.

use super::{DoctorOptions, DoctorReport, Spread, ms};
use avln_baselines::RandomAgent;
use avln_client::{Action, Agent, Client, Error, Observation, Phase, Quota, Run, RunOptions};
use std::time::Instant;

const METHOD: &str = "doctor";

/// Plays practice episodes if they are free, and estimates the run's duration.
pub(super) async fn check(
    report: &mut DoctorReport,
    options: &DoctorOptions,
    client: &Client,
    phase: &Phase,
    quotas: &[Quota],
) {
    let name = options.practice.as_deref().unwrap_or(&phase.id);
    if quotas.iter().any(|quota| quota.phase == name && quota.is_counted()) {
        let found = format!("no practice in phase '{name}', which counts runs");
        return report.skipped("practice", found, "name a phase without quotas with --practice PHASE");
    }
    let known = client.phases().await.map(|phases| phases.into_iter().find(|known| known.id == name));
    let played = match known {
        Ok(Some(place)) if place.episodes < 2 => {
            let found = format!("no practice in phase '{name}', whose only episode would complete a run");
            return report.skipped("practice", found, "name another phase with --practice PHASE");
        }
        Ok(Some(place)) => play(options, client, &place).await,
        Ok(None) => {
            return report.failed("practice", format!("there is no phase '{name}'"), "see --practice");
        }
        Err(error) => Err(error),
    };
    match played {
        Ok(played) => summarise(report, phase, played),
        Err(error) => report.failed("practice", error, "the same error would stop a run"),
    }
}

/// Measurements during practice. Times are seconds.
#[derive(Debug, Default)]
struct PracticeResult {
    begins_s: Vec<f64>,
    steps_s: Vec<f64>,
    observation_bytes: usize,
    max_steps: u32,
}

/// Plays the first episodes of a run, and always cancels the run.
async fn play(options: &DoctorOptions, client: &Client, place: &Phase) -> Result<PracticeResult, Error> {
    let order = place.orders.first().copied().unwrap_or_default();
    let run = RunOptions::new(&place.id, METHOD).method_version(env!("CARGO_PKG_VERSION")).order(order);
    let run = client.start_run(run).await?;
    let played = play_episodes(options, client, &run).await;
    let cancelled = client.cancel_run(&run.id).await;
    let played = played?;
    cancelled.map(|_| played)
}

async fn play_episodes(options: &DoctorOptions, client: &Client, run: &Run) -> Result<PracticeResult, Error> {
    let mut play = client.play(run, options.sensors.clone()).await?;
    let task = play.task().clone();
    let steps = options.steps.min(task.max_steps.saturating_sub(1));
    let mut agent = RandomAgent::new(0);
    let mut played = PracticeResult { max_steps: task.max_steps, ..PracticeResult::default() };
    // The last episode is never played: a complete run would appear on leaderboards.
    for _ in 0..options.episodes.min(run.episodes.saturating_sub(1)) {
        let before = Instant::now();
        let Some(mut episode) = play.next_episode().await? else { break };
        played.begins_s.push(before.elapsed().as_secs_f64());
        played.observation_bytes = sensor_bytes(episode.observation());
        agent.begin(&task, episode.mission());
        for step in 1..=steps {
            let action = match agent.act(episode.observation()) {
                _ if step == steps => Action::Stop,
                // A final Submit or an early Stop would end the measurement.
                Action::Submit | Action::Stop => Action::TurnLeft,
                action => action,
            };
            let before = Instant::now();
            episode.step(action).await?;
            played.steps_s.push(before.elapsed().as_secs_f64());
        }
    }
    Ok(played)
}

/// Returns an observation's uncompressed size.
fn sensor_bytes(seen: &Observation) -> usize {
    let rgb = seen.rgb.as_ref().map_or(0, |image| 3 * image.width as usize * image.height as usize);
    let depth = seen.depth.as_ref().map_or(0, |depth| 4 * depth.metres.len());
    let audio = seen.audio.as_ref().map_or(0, |audio| 4 * (audio.left.len() + audio.right.len()));
    rgb + depth + audio
}

fn summarise(report: &mut DoctorReport, phase: &Phase, played: PracticeResult) {
    let PracticeResult { begins_s, steps_s, observation_bytes, max_steps } = played;
    let sum_s: f64 = steps_s.iter().sum();
    let (Some(begin), Some(step)) = (Spread::of(begins_s), Spread::of(steps_s)) else {
        return report.failed("practice", "the server assigned no episode", "see --practice");
    };
    let per_s = step.count as f64 / sum_s.max(f64::EPSILON);
    let kib = observation_bytes as f64 / 1024.0;
    report.ok("practice", format!("{} episodes with {} steps, no errors", begin.count, step.count));
    report.ok(
        "speed",
        format!(
            "{per_s:.1} steps/s in one slot; median step {}, p95 {}; {kib:.0} KiB per observation",
            ms(step.median),
            ms(step.p95)
        ),
    );
    let longest_s = f64::from(phase.episodes) * (begin.median + f64::from(max_steps) / per_s);
    // More slots than episodes stay idle.
    let slots = phase.max_slots.min(phase.episodes).max(1);
    let shared_s = longest_s / f64::from(slots);
    report.ok(
        "run time",
        format!(
            "at most {} with one slot, {} at best with {slots}, plus the agent's own time",
            duration(longest_s),
            duration(shared_s)
        ),
    );
    let measured = &mut report.measured;
    measured.begin_s = Some(begin);
    measured.step_s = Some(step);
    measured.steps_per_s = Some(per_s);
    measured.observation_bytes = Some(observation_bytes);
    measured.longest_run_s = Some(longest_s);
}

/// Formats a duration in seconds, minutes or hours.
fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_have_fitting_units() {
        assert_eq!([7.4, 119.0, 150.0, 7300.0].map(duration), ["7 s", "119 s", "2 min", "2.0 h"]);
    }
}
