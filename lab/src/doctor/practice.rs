//! Some episodes of practice with an agent that does not think, to measure what a run takes.

use super::{DoctorOptions, DoctorReport, Spread, Verdict, is_free, ms, order};
use avln_baselines::RandomAgent;
use avln_client::{Action, Agent, Client, Error, Observation, Phase, Quota, RunOptions};
use std::time::Instant;

/// The name under which practice runs are shown.
const METHOD: &str = "doctor";

/// Plays, unless that would cost the team a run, and says how long the phase will take.
pub(super) async fn check(
    report: &mut DoctorReport,
    options: &DoctorOptions,
    arena: &Client,
    phase: &Phase,
    quotas: &[Quota],
) {
    let place = options.practice.as_deref().unwrap_or(&phase.id);
    if !is_free(place, quotas) {
        let found = format!("phase '{place}' counts runs, and none is spent on practice");
        let next = "name a phase without quotas with --practice PHASE";
        return report.add("practice", Verdict::Skipped, found, next);
    }
    let known = arena.phases().await.map(|phases| phases.into_iter().find(|known| known.id == place));
    let played = match known {
        Ok(Some(place)) if place.episodes < 2 => {
            let found = format!("phase '{}' has one episode, which a run would complete", place.id);
            return report.add(
                "practice",
                Verdict::Skipped,
                found,
                "name another phase with --practice PHASE",
            );
        }
        Ok(Some(place)) => play(options, arena, &place).await,
        Ok(None) => {
            return report.failed("practice", format!("there is no phase '{place}'"), "see --practice");
        }
        Err(error) => Err(error),
    };
    match played {
        Ok(played) => tell(report, phase, played),
        Err(error) => report.failed("practice", error, "what stops practice stops a run"),
    }
}

/// Measurements of some episodes. Times are seconds.
#[derive(Debug, Default)]
struct PracticeResult {
    begins_s: Vec<f64>,
    steps_s: Vec<f64>,
    observation_bytes: usize,
    max_steps: u32,
}

/// Plays the first episodes of a run and gives the run up, whatever happens.
async fn play(options: &DoctorOptions, arena: &Client, place: &Phase) -> Result<PracticeResult, Error> {
    let run =
        RunOptions::new(&place.id, METHOD).method_version(env!("CARGO_PKG_VERSION")).order(order(place));
    let run = arena.start_run(run).await?;
    let played = play_some(options, arena, &run).await;
    let given_up = arena.cancel_run(&run.id).await;
    played.and_then(|played| given_up.map(|_| played))
}

async fn play_some(
    options: &DoctorOptions,
    arena: &Client,
    run: &avln_client::Run,
) -> Result<PracticeResult, Error> {
    let mut play = arena.play(run, options.sensors.clone()).await?;
    let task = play.task().clone();
    let steps = options.steps.min(task.max_steps.saturating_sub(1));
    let mut agent = RandomAgent::new(0);
    let mut played = PracticeResult { max_steps: task.max_steps, ..PracticeResult::default() };
    // One is always left, so that the run is never complete: practice stands on no board.
    for _ in 0..options.episodes.min(run.episodes.saturating_sub(1)) {
        let before = Instant::now();
        let Some(mut episode) = play.next_episode().await? else { break };
        played.begins_s.push(before.elapsed().as_secs_f64());
        played.observation_bytes = bytes(episode.observation());
        agent.begin(&task, episode.mission());
        for step in 1..=steps {
            let action = match agent.act(episode.observation()) {
                _ if step == steps => Action::Stop,
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

/// Length of what the sensors say, unpacked.
fn bytes(seen: &Observation) -> usize {
    let rgb = seen.rgb.as_ref().map_or(0, |image| 3 * image.width as usize * image.height as usize);
    let depth = seen.depth.as_ref().map_or(0, |depth| 4 * depth.metres.len());
    let audio = seen.audio.as_ref().map_or(0, |audio| 4 * (audio.left.len() + audio.right.len()));
    rgb + depth + audio
}

fn tell(report: &mut DoctorReport, phase: &Phase, played: PracticeResult) {
    let PracticeResult { begins_s, steps_s, observation_bytes, max_steps } = played;
    let sum_s: f64 = steps_s.iter().sum();
    let (Some(begin), Some(step)) = (Spread::of(begins_s), Spread::of(steps_s)) else {
        return report.failed("practice", "there was no episode to play", "see --practice");
    };
    let per_s = step.count as f64 / sum_s.max(f64::EPSILON);
    let kib = observation_bytes as f64 / 1024.0;
    report.ok("practice", format!("{} episodes with {} steps, without a fault", begin.count, step.count));
    report.ok(
        "speed",
        format!(
            "{per_s:.1} steps/s in one slot; a step takes {}, p95 {}; an observation has {kib:.0} KiB",
            ms(step.median),
            ms(step.p95)
        ),
    );
    let longest_s = f64::from(phase.episodes) * (begin.median + f64::from(max_steps) / per_s);
    report.ok(
        "run time",
        format!(
            "at most {} with one slot, {} at best with {}; what the agent thinks comes on top",
            span(longest_s),
            span(longest_s / f64::from(phase.max_slots.max(1))),
            phase.max_slots
        ),
    );
    let measured = &mut report.measured;
    (measured.begin_s, measured.step_s) = (Some(begin), Some(step));
    measured.steps_per_s = Some(per_s);
    measured.observation_bytes = Some(observation_bytes);
    measured.longest_run_s = Some(longest_s);
}

/// A length of time as people say it.
fn span(seconds: f64) -> String {
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
    fn spans_are_told_in_units_that_fit() {
        assert_eq!([7.4, 119.0, 150.0, 7300.0].map(span), ["7 s", "119 s", "2 min", "2.0 h"]);
    }
}
