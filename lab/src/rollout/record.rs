//! One episode: the oracle plays it, and all of it is written into an archive.

use super::{
    M_PER_MM, RolloutOptions, Sense,
    archive::{Archive, Array},
};
use crate::suite::Oracle;
use avln_arena::{Failure, FailureKind};
use avln_dataset::EpisodeSpec;
use avln_episode::{Action, EndReason, Feedback, GoalCue, Mission, Observation, Order, Rules, Sensors};
use avln_referee::Referee;
use avln_scoring::{Metrics, score};
use avln_world::SceneAssets;
use serde::Serialize;
use std::{io, sync::Arc};

/// An episode as it is written.
pub(super) struct Recorded {
    pub(super) bytes: Vec<u8>,
    /// True if every goal was found.
    pub(super) is_complete: bool,
}

/// Content of `episode.json`.
#[derive(Serialize)]
struct EpisodeFacts<'a> {
    episode: &'a str,
    scene: &'a str,
    order: Order,
    goals: Vec<Goal<'a>>,
    end: EndReason,
    steps: u32,
    found: u32,
    path_m: f64,
    reference_m: f64,
}

#[derive(Serialize)]
#[serde(rename_all = "snake_case")]
enum Goal<'a> {
    Category(&'a str),
    Description(&'a str),
    /// Name of the array that holds the picture.
    Image(String),
}

/// Plays an episode to its end.
pub(super) fn record(
    plan: &RolloutOptions,
    assets: &Arc<SceneAssets>,
    episode: &EpisodeSpec,
) -> Result<Recorded, Failure> {
    let mission = episode.mission(assets, &plan.rules, plan.order);
    let (truth, rules) = (episode.truth(plan.order), plan.rules.clone());
    let failed = |error| Failure::new(FailureKind::Scene, format!("mission {}: {error}", episode.id));
    let mut oracle = Oracle::new(truth.clone(), &rules);
    let mut referee =
        Referee::new(assets.clone(), mission.clone(), truth, rules, plan.sensors(), &plan.audio)
            .map_err(failed)?;
    let mut tape = Tape::new(plan);
    let mut seen = referee.start();
    loop {
        let action = oracle.choose(&referee);
        tape.note(&seen, action).map_err(unwritable)?;
        let outcome = referee.step(action).map_err(failed)?;
        if outcome.end.is_some() {
            break;
        }
        seen = outcome.observation;
    }
    let (truth, record) = referee.into_record();
    let metrics = score(&truth, &record, &plan.rules);
    let facts = facts(episode, &mission, record.end, &metrics);
    let bytes = tape.finish(&facts, &mission).map_err(unwritable)?;
    Ok(Recorded { bytes, is_complete: metrics.found == metrics.goals })
}

fn facts<'a>(
    episode: &'a EpisodeSpec,
    mission: &'a Mission,
    end: EndReason,
    metrics: &Metrics,
) -> EpisodeFacts<'a> {
    let goal = |(index, cue): (usize, &'a GoalCue)| match cue {
        GoalCue::Category(label) => Goal::Category(label),
        GoalCue::Description(sentence) => Goal::Description(sentence),
        GoalCue::Image(_) => Goal::Image(picture_name(index)),
    };
    EpisodeFacts {
        episode: &episode.id,
        scene: &episode.scene,
        order: mission.order,
        goals: mission.goals.iter().enumerate().map(goal).collect(),
        end,
        steps: metrics.steps,
        found: metrics.found,
        path_m: metrics.path_m,
        reference_m: metrics.reference_m,
    }
}

fn picture_name(goal: usize) -> String {
    format!("goal_{goal}_rgb")
}

/// The arrays of an episode while it is played: an entry each for every action, with what was sensed before it.
struct Tape {
    action: Array,
    feedback: Array,
    rgb: Option<Array>,
    depth: Option<Array>,
    pose: Option<Array>,
    audio: Option<Array>,
    /// Millimetres in what the depth sensor says.
    mm_per_depth: f32,
}

impl Tape {
    fn new(plan: &RolloutOptions) -> Self {
        let side = plan.side_px as usize;
        let wanted = |sense: Sense, name: &str, kind: &'static str, item: &[usize]| {
            plan.senses.contains(&sense).then(|| Array::new(name, kind, item))
        };
        let samples = ear_samples(&plan.rules);
        Self {
            action: Array::new("action", "|u1", &[]),
            feedback: Array::new("feedback", "|u1", &[]),
            rgb: wanted(Sense::Rgb, "rgb", "|u1", &[side, side, 3]),
            depth: wanted(Sense::Depth, "depth_mm", "<u2", &[side, side]),
            pose: wanted(Sense::Pose, "pose", "<f4", &[4]),
            audio: wanted(Sense::Audio, "audio", "<f4", &[Sensors::AUDIO_CHANNELS as usize, samples]),
            mm_per_depth: plan.rules.depth_divisor / M_PER_MM,
        }
    }

    /// Notes what was sensed, and what was done then.
    fn note(&mut self, seen: &Observation, action: Action) -> io::Result<()> {
        self.action.push(&[action.index()])?;
        self.feedback.push(&[number_of(seen.feedback)])?;
        if let (Some(array), Some(rgb)) = (&mut self.rgb, &seen.rgb) {
            array.push(rgb)?;
        }
        if let (Some(array), Some(depth)) = (&mut self.depth, &seen.depth) {
            let mm = |depth: &f32| ((depth * self.mm_per_depth).round() as u16).to_le_bytes();
            array.push(&depth.iter().flat_map(mm).collect::<Vec<_>>())?;
        }
        if let Some(array) = &mut self.pose {
            let place = seen.pose.position;
            array.push_f32(&[place.x, place.y, place.z, seen.pose.heading_rad])?;
        }
        if let (Some(array), Some(audio)) = (&mut self.audio, &seen.audio) {
            array.push_f32(audio)?;
        }
        Ok(())
    }

    fn finish(self, facts: &EpisodeFacts, mission: &Mission) -> io::Result<Vec<u8>> {
        let mut archive = Archive::default();
        archive.add_file("episode.json", &serde_json::to_vec_pretty(facts)?)?;
        for (index, goal) in mission.goals.iter().enumerate() {
            if let GoalCue::Image(picture) = goal {
                let row = [picture.width as usize, 3];
                let mut array = Array::new(picture_name(index), "|u1", &row);
                picture.pixels.chunks(row[0] * row[1]).try_for_each(|row| array.push(row))?;
                archive.add(array)?;
            }
        }
        archive.add(self.action)?;
        archive.add(self.feedback)?;
        let senses = [self.rgb, self.depth, self.pose, self.audio];
        senses.into_iter().flatten().try_for_each(|array| archive.add(array))?;
        archive.finish()
    }
}

/// The number of feedback in files: as on the wire, with the verdict told apart.
fn number_of(feedback: Feedback) -> u8 {
    match feedback {
        Feedback::None => 0,
        Feedback::Accepted => 1,
        Feedback::Verdict(true) => 2,
        Feedback::Verdict(false) => 3,
    }
}

/// Samples of each ear in an observation.
fn ear_samples(rules: &Rules) -> usize {
    rules.audio_samples.max(rules.samples_per_step()) as usize
}

fn unwritable(error: io::Error) -> Failure {
    Failure::new(FailureKind::Internal, error)
}
