//! Phase page: rules, mission statistics and floor plans.

use super::{Page, PageShell, SiteSection, render};
use crate::{
    documents::brief,
    error::{RequestError, Result},
    format::{self, url_encode},
    replay::plan,
    request::{GrpcAddress, PathOnly, RequestContext},
};
use askama::Template;
use avln_episode::{
    DistanceRule, DistractorSources, ExtraSubmit, FeedbackRule, Modality, PoseFrame, Rules, Sensors,
    SilenceRule, SoundClip, SoundingRule, StopClaims, WrongSubmit,
};
use avln_store::{MissionsView, PhaseState, PhaseView, QuotaLimits};
use axum::{
    http::header,
    response::{IntoResponse, Response},
};
use std::collections::BTreeMap;

/// Width (metres) and number of bins for reference tours; the last bin is open.
const BIN_M: f64 = 10.0;
const BINS: usize = 6;

#[derive(Template)]
#[template(path = "phase.html")]
struct PhasePage {
    shell: PageShell,
    grpc_address: GrpcAddress,
    phase: PhaseView,
    missions: Option<MissionsView>,
}

type Row = (&'static str, String);

pub(super) async fn page(
    context: RequestContext,
    grpc_address: GrpcAddress,
    PathOnly(id): PathOnly<String>,
) -> Page {
    let phase = context.phase(&id).await?;
    let shell =
        PageShell::new(phase.title.clone(), SiteSection::Leaderboards).below("Leaderboards", "/leaderboard");
    let missions = context.reader.missions(&context.viewer, &phase.id).await?;
    render(&PhasePage { shell, grpc_address, phase, missions })
}

impl PhasePage {
    fn description(&self) -> String {
        brief(&self.phase.description)
    }

    /// Returns true if agents can start runs.
    fn is_playable(&self) -> bool {
        self.phase.state == PhaseState::Open && !self.shell.context.is_frozen()
    }

    fn actions(&self) -> [Row; 4] {
        let Rules { forward_m, turn_deg, wrong_submit, extra_submit, stop_claims, .. } = self.phase.rules;
        let wrong = match wrong_submit {
            WrongSubmit::KeepsGoal => {
                "in ordered missions, the goal remains the next one after a wrong Submit"
            }
            WrongSubmit::SkipsGoal => "in ordered missions, a wrong Submit skips the goal",
        };
        let submits = match extra_submit {
            ExtraSubmit::Ignored => {
                "one Submit per goal except the last, which Stop claims; further ones only use a step"
            }
            ExtraSubmit::EndsEpisode => "one Submit per goal, and the last one ends the episode",
        };
        let stop = match stop_claims {
            StopClaims::AnyOpen => "ends the episode; may complete an open goal",
            StopClaims::LastOnly => "ends the episode; may complete the last remaining goal",
        };
        [
            ("MoveForward", format!("{forward_m} m forward, sliding along obstacles")),
            ("TurnLeft, TurnRight", format!("{turn_deg}° in place")),
            ("Submit", format!("claims that a goal is here; {submits}; {wrong}")),
            ("Stop", stop.to_owned()),
        ]
    }

    fn observations(&self) -> Vec<Row> {
        let (rules, sensors) = (&self.phase.rules, &self.phase.sensors);
        let Sensors { width, height, .. } = sensors;
        let pose = match rules.pose_frame {
            PoseFrame::Start => "position (metres) and heading (radians) relative to the start",
            PoseFrame::World => "position (metres) and heading (radians) in the frame of the scene",
        };
        let sound = format!(
            "two ears at {} m, {} samples per ear at {} kHz for each step of {} s",
            rules.ear_height_m,
            rules.audio_samples,
            Sensors::SAMPLE_RATE_HZ / 1000,
            rules.step_s
        );
        let picture =
            format!("up to {width} × {height} pixels from {} m above the floor", rules.camera_height_m);
        let all = [
            (sensors.rgb, "Colour", format!("{picture}; red, green and blue from 0 to 255")),
            (sensors.depth, "Depth", format!("{picture}; metres up to {}, 0 for no hit", rules.depth_max_m)),
            (sensors.audio, "Sound", sound),
            (true, "Pose", pose.to_owned()),
            (true, "Budget", "remaining steps, Submits and time".to_owned()),
        ];
        all.into_iter().filter(|(is_sent, ..)| *is_sent).map(|(_, name, words)| (name, words)).collect()
    }

    fn judgement(&self) -> [Row; 5] {
        let rules = &self.phase.rules;
        let radius_m = rules.success_radius_m;
        let success = match rules.success_distance {
            DistanceRule::CameraToBox => format!(
                "within {radius_m} m of the target's surface, on its floor, with a line of sight to it"
            ),
            DistanceRule::CameraToMesh => format!(
                "within {radius_m} m of the target's nearest triangle, on its floor, with a line of sight to it"
            ),
            DistanceRule::BaseToViewpoint => {
                format!("within {radius_m} m of a viewpoint along the floor, with the target in the image")
            }
        };
        let steps = rules.sounding_window_steps;
        let sounding = match rules.sounding {
            SoundingRule::UnfinishedInDrawnOrder => format!(
                "unfound targets sound in turn, {steps} steps each, in a random order; a found target falls silent{}",
                match rules.silence {
                    SilenceRule::Immediate => "",
                    SilenceRule::Delayed => " 5 to 20 steps later",
                    SilenceRule::WindowEnd => " at the end of its turn",
                }
            ),
            SoundingRule::AllInGoalOrder => {
                format!("all targets sound in the order of the goals, {steps} steps each")
            }
        };
        let clip = match rules.sound_clip {
            SoundClip::Anonymous => "one random clip for the whole episode, independent of the targets",
            SoundClip::Distinct => "a different random clip for each target, independent of its category",
            SoundClip::ByCategory => "a clip of the target's category",
        };
        let feedback = match self.phase.feedback {
            FeedbackRule::None => "none",
            FeedbackRule::Accepted => "confirmation that it was counted",
            FeedbackRule::Verdict => "success or failure",
        };
        [
            ("Success", success),
            ("Sounding targets", sounding + &distractors(rules.distractor_sources)),
            ("Sound clips", clip.to_owned()),
            ("Feedback to a Submit", feedback.to_owned()),
            ("Length", format!("at most {} actions", rules.max_steps)),
        ]
    }

    fn budgets(&self) -> Vec<Row> {
        let (time, seconds) = (&self.phase.time, |ms: u32| format::duration(&(f64::from(ms) / 1000.0)));
        let bank = if time.bank_ms > 0 {
            format!(", plus a reserve of {} per episode", seconds(time.bank_ms))
        } else {
            String::new()
        };
        let run = match time.run_s {
            0 => "until the phase ends".to_owned(),
            run_s => format::duration(&f64::from(run_s)),
        };
        vec![
            ("Time per action", format!("{}{bank}", seconds(time.step_ms))),
            ("Duration of a run", run),
            ("Parallel episodes", format::plural(&self.phase.max_slots, "episode")),
            ("Runs per team", run_limits(&self.phase.quotas)),
            ("Scores visible to", format::visibility(&self.phase.scores).to_owned()),
            ("Replays visible to", format::visibility(&self.phase.replays).to_owned()),
        ]
    }

    fn tables(&self) -> [(&'static str, &'static str, Vec<Row>); 4] {
        [
            ("Actions", "Actions of an agent", self.actions().to_vec()),
            ("Observations", "Observation after each action", self.observations()),
            ("Scoring", "Rules for success and sound", self.judgement().to_vec()),
            ("Limits", "Limits of runs, and visibility of results", self.budgets()),
        ]
    }

    fn statistics(&self) -> Vec<MissionTable> {
        self.missions.as_ref().map(statistics).unwrap_or_default()
    }

    fn scenes(&self) -> Vec<(String, u32, String)> {
        self.missions.as_ref().map(|missions| scenes(&self.phase.id, missions)).unwrap_or_default()
    }

    fn api_address(&self, below: &str) -> String {
        format!("/api/v1/phases/{}{below}", url_encode(&self.phase.id))
    }
}

fn distractors(sources: DistractorSources) -> String {
    let number = match sources {
        DistractorSources::Number(0) => return String::new(),
        DistractorSources::Number(number) => format!("{number} objects that are no goals"),
        DistractorSources::Goals => "as many objects that are no goals".to_owned(),
    };
    format!("; {number} sound in turn with them and never fall silent")
}

fn run_limits(quotas: &QuotaLimits) -> String {
    let limits = [
        (quotas.day, "per day"),
        (quotas.month, "per month"),
        (quotas.total, "in total"),
        (quotas.concurrent, "at a time"),
    ];
    let texts: Vec<String> =
        limits.iter().filter_map(|(limit, words)| limit.map(|limit| format!("{limit} {words}"))).collect();
    if texts.is_empty() { "unlimited".to_owned() } else { texts.join(", ") }
}

struct MissionTable {
    heading: &'static str,
    caption: String,
    rows: Vec<(String, u32)>,
}

fn statistics(missions: &MissionsView) -> Vec<MissionTable> {
    let table = |heading, caption: &str, rows| MissionTable { heading, caption: caption.to_owned(), rows };
    let mut all = vec![
        table(
            "Goals per mission",
            "Missions",
            counted(&missions.goals, |goals| format::plural(goals, "goal")),
        ),
        table("Goal cues", "Goals", modalities(missions)),
        table("Length of the reference tour", &lengths_caption(missions), lengths(&missions.reference_m)),
        table("Categories", "Goals with a category cue", counted(&missions.categories, Clone::clone)),
    ];
    all.retain(|statistic| !statistic.rows.is_empty());
    all
}

/// Names the missions with known lengths: a run with a sample plays only some.
fn lengths_caption(missions: &MissionsView) -> String {
    let (all, played) = (missions.goals.values().sum::<u32>(), missions.reference_m.len() as u32);
    if played == all {
        return "Missions".to_owned();
    }
    format!("{played} of {all} missions, as played in the latest completed run")
}

impl MissionTable {
    fn most(&self) -> u32 {
        self.rows.iter().map(|(_, count)| *count).max().unwrap_or(0)
    }
}

fn counted<K>(counts: &BTreeMap<K, u32>, name: impl Fn(&K) -> String) -> Vec<(String, u32)> {
    counts.iter().map(|(key, count)| (name(key), *count)).collect()
}

fn modalities(missions: &MissionsView) -> Vec<(String, u32)> {
    let all = [Modality::Category, Modality::Description, Modality::Image];
    let count = |modality: &Modality| missions.modalities.get(modality.as_str()).copied();
    all.iter().filter_map(|modality| Some((modality.as_str().to_owned(), count(modality)?))).collect()
}

fn lengths(reference_m: &[f64]) -> Vec<(String, u32)> {
    if reference_m.is_empty() {
        return vec![];
    }
    let mut bins = [0; BINS];
    reference_m.iter().for_each(|length| bins[((length / BIN_M) as usize).min(BINS - 1)] += 1);
    let name = |bin: usize| match (bin as f64 * BIN_M, bin + 1 == BINS) {
        (from, true) => format!("{from} m or more"),
        (from, false) => format!("{from} to {} m", from + BIN_M),
    };
    bins.into_iter().enumerate().map(|(bin, count)| (name(bin), count)).collect()
}

fn scenes(phase: &str, missions: &MissionsView) -> Vec<(String, u32, String)> {
    let address = |index| format!("/phases/{}/scenes/{index}.svg", url_encode(phase));
    let named = missions.scenes.iter().enumerate();
    named.map(|(index, (name, count))| (name.clone(), *count, address(index))).collect()
}

/// Serves a scene's floor plan, `INDEX.svg`.
pub(super) async fn scene(
    context: RequestContext,
    PathOnly((phase, file)): PathOnly<(String, String)>,
) -> Result<Response> {
    let unknown = || RequestError::unknown("picture", file.clone());
    let missions = context.reader.missions(&context.viewer, &phase).await?.ok_or_else(unknown)?;
    let index: Option<usize> = file.strip_suffix(".svg").and_then(|index| index.parse().ok());
    let name = index.and_then(|index| missions.scenes.into_keys().nth(index)).ok_or_else(unknown)?;
    let map = context.reader.scene_map(&context.viewer, &phase, &name).await?.unwrap_or_default();
    Ok(([(header::CONTENT_TYPE, "image/svg+xml")], plan(&map)).into_response())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn run_limits_list_only_set_quotas() {
        let quotas = QuotaLimits { day: Some(2), total: Some(5), ..QuotaLimits::default() };
        assert_eq!(run_limits(&quotas), "2 per day, 5 in total");
        assert_eq!(run_limits(&QuotaLimits::default()), "unlimited");
    }

    #[test]
    fn tours_are_binned_by_length() {
        let texts = lengths(&[0.0, 9.9, 10.0, 55.0, 400.0]);
        assert_eq!(texts.first().cloned(), Some(("0 to 10 m".to_owned(), 2)));
        assert_eq!(texts.last().cloned(), Some(("50 m or more".to_owned(), 2)));
        assert_eq!(texts.iter().map(|(_, count)| count).sum::<u32>(), 5);
        assert!(lengths(&[]).is_empty());
    }

    #[test]
    fn empty_tables_are_omitted() {
        assert!(statistics(&MissionsView::default()).is_empty());
        let goals = BTreeMap::from([(2, 3), (4, 1)]);
        let texts = statistics(&MissionsView { goals, ..MissionsView::default() });
        assert_eq!((texts.len(), texts[0].most(), texts[0].rows[1].0.as_str()), (1, 3, "4 goals"));
    }

    #[test]
    fn sampled_lengths_name_their_run() {
        let missions = |played: usize| MissionsView {
            goals: BTreeMap::from([(2, 5), (3, 4)]),
            reference_m: vec![12.0; played],
            ..MissionsView::default()
        };
        let captions = |played: usize| -> Vec<String> {
            statistics(&missions(played)).into_iter().map(|table| table.caption).collect()
        };
        assert_eq!(captions(9), ["Missions", "Missions"]);
        assert_eq!(captions(4), ["Missions", "4 of 9 missions, as played in the latest completed run"]);
    }
}
