//! What is played in a phase: tables made from its rules.

use super::{
    Page, Part, Shell,
    missions::{Statistic, scenes, statistics},
    phase, segment, write,
};
use crate::{
    visit::{Asked, Host, Nothing, Visit},
    words,
};
use askama::Template;
use avln_episode::{
    DistanceRule, FeedbackRule, PoseFrame, Rules, Sensors, SoundClip, SoundingRule, WrongSubmit,
};
use avln_store::{MissionsView, PhaseView, QuotaLimits};
use axum::extract::Path;

#[derive(Template)]
#[template(path = "phase.html")]
struct PhasePage {
    shell: Shell,
    host: Host,
    phase: PhaseView,
    /// What its missions are like, where everybody may see their replays.
    missions: Option<MissionsView>,
}

/// A row of a table: what, and what about it.
type Row = (&'static str, String);

/// One phase.
pub(super) async fn page(visit: Visit, host: Host, Path(id): Path<String>, _: Asked<Nothing>) -> Page {
    let phase = phase(&visit, &id).await?;
    let shell = Shell::new(phase.title.clone(), Part::Boards).below("Leaderboards", "/leaderboard");
    let missions = visit.reader.missions(&visit.viewer, &phase.id).await?;
    write(&PhasePage { shell, host, phase, missions })
}

impl PhasePage {
    /// What an agent may do.
    fn actions(&self) -> [Row; 4] {
        let Rules { forward_m, turn_deg, wrong_submit, .. } = self.phase.rules;
        let wrong = match wrong_submit {
            WrongSubmit::KeepsGoal => "in ordered missions the goal stays next after a wrong one",
            WrongSubmit::SkipsGoal => "in ordered missions a wrong one skips the goal",
        };
        [
            ("MoveForward", format!("{forward_m} m ahead, sliding along what is in the way")),
            ("TurnLeft, TurnRight", format!("{turn_deg}° in place")),
            (
                "Submit",
                format!(
                    "claims that a goal is here; as many as there are goals, the last of which ends the episode; {wrong}"
                ),
            ),
            ("Stop", "ends the episode; may complete the last goal that is left".to_owned()),
        ]
    }

    /// What an agent is shown.
    fn observations(&self) -> Vec<Row> {
        let (rules, sensors) = (&self.phase.rules, &self.phase.sensors);
        let Sensors { width, height, .. } = sensors;
        let pose = match rules.pose_frame {
            PoseFrame::Start => "position (metres) and heading (radians) relative to the start",
            PoseFrame::World => "position (metres) and heading (radians) in the frame of the scene",
        };
        let sound = format!(
            "two ears at {} m, {} samples each at {} kHz for every step of {} s",
            rules.ear_height_m,
            rules.audio_samples,
            Sensors::SAMPLE_RATE_HZ / 1000,
            rules.step_s
        );
        let picture =
            format!("up to {width} × {height} pixels from {} m above the floor", rules.camera_height_m);
        let all = [
            (sensors.rgb, "Colours", format!("{picture}, red, green and blue from 0 to 255")),
            (
                sensors.depth,
                "Depth",
                format!("{picture}, metres up to {}, 0 where nothing was hit", rules.depth_max_m),
            ),
            (sensors.audio, "Sound", sound),
            (true, "Pose", pose.to_owned()),
            (true, "Budget", "steps and Submits that are left, and time".to_owned()),
        ];
        all.into_iter().filter(|(is_there, ..)| *is_there).map(|(_, name, words)| (name, words)).collect()
    }

    /// How an episode is judged.
    fn judgement(&self) -> [Row; 5] {
        let rules = &self.phase.rules;
        let radius_m = rules.success_radius_m;
        let success = match rules.success_distance {
            DistanceRule::CameraToBox => format!(
                "within {radius_m} m of the target's surface, on its floor, with a line of sight to it"
            ),
            DistanceRule::BaseToViewpoint => {
                format!("within {radius_m} m of a viewpoint along the floor, with the target in the picture")
            }
        };
        let sounding = match rules.sounding {
            SoundingRule::UnfinishedInDrawnOrder => format!(
                "targets that are not found sound in turn, {} steps each, in an order that is drawn; a found one falls silent",
                rules.sounding_window_steps
            ),
            SoundingRule::AllInGoalOrder => {
                format!("all targets in the order of the goals, {} steps each", rules.sounding_window_steps)
            }
        };
        let clip = match rules.sound_clip {
            SoundClip::Anonymous => "one clip for the whole episode, drawn without regard to its targets",
            SoundClip::Distinct => "a clip of its own for each target, drawn without regard to it",
            SoundClip::ByCategory => "a clip by the category of the target",
        };
        let feedback = match self.phase.feedback {
            FeedbackRule::None => "nothing",
            FeedbackRule::Accepted => "that it was counted",
            FeedbackRule::Verdict => "whether it completed a goal",
        };
        [
            ("A goal is found", success),
            ("What sounds", sounding),
            ("How it sounds", clip.to_owned()),
            ("What a Submit tells", feedback.to_owned()),
            ("Length", format!("{} actions at most", rules.max_steps)),
        ]
    }

    /// What a team may spend.
    fn budgets(&self) -> Vec<Row> {
        let (time, seconds) = (&self.phase.time, |ms: u32| words::duration(&(f64::from(ms) / 1000.0)));
        let bank = if time.bank_ms > 0 {
            format!(", and {} an episode beyond that", seconds(time.bank_ms))
        } else {
            String::new()
        };
        let run = match time.run_s {
            0 => "until the phase ends".to_owned(),
            run_s => words::duration(&f64::from(run_s)),
        };
        vec![
            ("Time to think", format!("{} an action{bank}", seconds(time.step_ms))),
            ("A run lasts", run),
            ("Side by side", words::plural(&self.phase.max_slots, "episode")),
            ("Runs of a team", runs(&self.phase.quotas)),
            ("Scores are seen by", words::visibility(&self.phase.scores).to_owned()),
            ("Replays are seen by", words::visibility(&self.phase.replays).to_owned()),
        ]
    }

    /// The tables of the page: heading, what its rows are, rows.
    fn tables(&self) -> [(&'static str, &'static str, Vec<Row>); 4] {
        [
            ("Actions", "What an agent may do", self.actions().to_vec()),
            ("Observations", "What an agent is shown after each", self.observations()),
            ("Judgement", "How an episode is judged", self.judgement().to_vec()),
            ("Budgets", "What a team may spend, and who sees what", self.budgets()),
        ]
    }

    fn statistics(&self) -> Vec<Statistic> {
        self.missions.as_ref().map(statistics).unwrap_or_default()
    }

    /// The scenes: name, missions, address of the picture.
    fn scenes(&self) -> Vec<(String, u32, String)> {
        self.missions.as_ref().map(|missions| scenes(&self.phase.id, missions)).unwrap_or_default()
    }

    /// The phase for programs, or what is below it.
    fn twin(&self, below: &str) -> String {
        format!("/api/v1/phases/{}{below}", segment(&self.phase.id))
    }
}

/// How many runs a team may start.
fn runs(quotas: &QuotaLimits) -> String {
    let limits = [
        (quotas.day, "a day"),
        (quotas.month, "a month"),
        (quotas.total, "in all"),
        (quotas.concurrent, "at a time"),
    ];
    let told: Vec<String> =
        limits.iter().filter_map(|(limit, words)| limit.map(|limit| format!("{limit} {words}"))).collect();
    if told.is_empty() { "any number".to_owned() } else { told.join(", ") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quotas_are_told_by_what_is_limited() {
        let quotas = QuotaLimits { day: Some(2), total: Some(5), ..QuotaLimits::default() };
        assert_eq!(runs(&quotas), "2 a day, 5 in all");
        assert_eq!(runs(&QuotaLimits::default()), "any number");
    }
}
