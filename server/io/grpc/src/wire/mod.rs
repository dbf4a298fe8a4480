//! Conversions to messages. All messages are built here, from `avln-episode` types and public values of the host.

use crate::host::Digests;
use avln_challenge::{MethodType, PhaseState, QuotaWindow, RunState, Visibility};
use avln_episode::{
    Action, DepthNoise, DistanceRule, DistractorSources, EndReason, ExtraSubmit, FeedbackRule, GoalCue,
    HeadRule, Mission, Order, PoseFrame, RgbImage, RgbNoise, Rules, Sensors, SilenceRule, SoundClip,
    SoundingRule, StopClaims, TimeLimits, WrongSubmit,
};
use avln_proto::v1::{self, Dtype, goal::Cue};
use bytes::Bytes;
use observation::tensor;

mod observation;
mod run;
mod sensors;

pub(crate) use observation::{ObservationFormat, observation, tensor_specs};
pub(crate) use run::{declared_type, episode_end, phase, quota, run, run_end, scope, seconds, server_info};
pub(crate) use sensors::{check_client, check_sensors, requested_sensors};

/// Defines conversions of enums with the same variants in the benchmark and in the protocol.
macro_rules! same_variants {
    ($($function:ident: $name:ident { $($variant:ident),+ })+) => {$(
        pub(crate) fn $function(value: $name) -> v1::$name {
            match value {
                $($name::$variant => v1::$name::$variant),+
            }
        }
    )+};
}
// The match is exhaustive: the compiler rejects a new benchmark variant that is missing here.
same_variants! {
    order: Order { Ordered, Unordered }
    end_reason: EndReason { Stopped, FinalSubmit, StepLimit, TimeBudget, Abandoned, Disconnected, ServerFault }
    feedback_rule: FeedbackRule { None, Accepted, Verdict }
    depth_noise: DepthNoise { None, Redwood }
    rgb_noise: RgbNoise { None, Gaussian }
    pose_frame: PoseFrame { Start, World }
    distance_rule: DistanceRule { CameraToBox, BaseToViewpoint, CameraToMesh }
    wrong_submit: WrongSubmit { KeepsGoal, SkipsGoal }
    sounding_rule: SoundingRule { UnfinishedInDrawnOrder, AllInGoalOrder }
    extra_submit: ExtraSubmit { Ignored, EndsEpisode }
    stop_claims: StopClaims { AnyOpen, LastOnly }
    silence_rule: SilenceRule { Immediate, Delayed, WindowEnd }
    sound_clip: SoundClip { Anonymous, Distinct, ByCategory }
    visibility: Visibility { Organiser, Team, Public }
    run_state: RunState { Created, Running, Completed, Failed, Cancelled, Expired }
    method_type: MethodType { TrainingFree, LearntPerception, FoundationModels, Imitation, Rl }
    phase_state: PhaseState { Upcoming, Open, Paused, Closed }
    quota_window: QuotaWindow { Day, Month, Total, Concurrent, Uncharged }
}

/// Returns the action for a wire number: index plus one.
pub(crate) fn action(number: i32) -> Option<Action> {
    let index = u32::try_from(number).ok()?.checked_sub(1)?;
    Action::try_from(index).ok()
}

pub(crate) fn action_number(action: Action) -> i32 {
    action.index() as i32 + 1
}

pub(crate) fn task_spec(rules: &Rules, sensors: &Sensors) -> v1::TaskSpec {
    let (distractor_sources, distractor_sources_per_goal) = match rules.distractor_sources {
        DistractorSources::Number(number) => (number, 0),
        DistractorSources::Goals => (0, 1),
    };
    v1::TaskSpec {
        rules: rules.name.clone(),
        forward_m: rules.forward_m,
        turn_deg: rules.turn_deg,
        step_s: rules.step_s,
        max_steps: rules.max_steps,
        body_radius_m: rules.body_radius_m,
        body_height_m: rules.body_height_m,
        width: sensors.width,
        height: sensors.height,
        hfov_rad: sensors.hfov_rad,
        camera_height_m: rules.camera_height_m,
        ear_height_m: rules.ear_height_m,
        depth_max_m: rules.depth_max_m,
        depth_divisor: rules.depth_divisor,
        sample_rate_hz: Sensors::SAMPLE_RATE_HZ,
        audio_samples: rules.audio_samples,
        samples_per_step: rules.samples_per_step(),
        pose_frame: pose_frame(rules.pose_frame).into(),
        success_radius_m: rules.success_radius_m,
        success_distance: distance_rule(rules.success_distance).into(),
        wrong_submit: wrong_submit(rules.wrong_submit).into(),
        feedback: feedback_rule(rules.feedback).into(),
        sounding: sounding_rule(rules.sounding).into(),
        sounding_window_steps: rules.sounding_window_steps,
        sound_clip: sound_clip(rules.sound_clip).into(),
        source_lift_m: rules.source_lift_m,
        depth_noise: depth_noise(rules.depth_noise).into(),
        rgb_noise: rgb_noise(rules.rgb_noise).into(),
        head: head(&rules.head),
        silence: silence_rule(rules.silence).into(),
        extra_submit: extra_submit(rules.extra_submit).into(),
        stop_claims: stop_claims(rules.stop_claims).into(),
        distractor_sources,
        distractor_sources_per_goal,
    }
}

fn head(head: &HeadRule) -> String {
    match head {
        HeadRule::Sphere => String::new(),
        HeadRule::Measured(digest) => digest.clone(),
    }
}

pub(crate) fn mission(mission: &Mission) -> v1::Mission {
    let goals = mission.goals.iter().map(|cue| v1::Goal { cue: Some(goal_cue(cue)) });
    v1::Mission { order: order(mission.order).into(), goals: goals.collect() }
}

fn goal_cue(cue: &GoalCue) -> Cue {
    match cue {
        GoalCue::Category(label) => Cue::Category(label.clone()),
        GoalCue::Description(sentence) => Cue::Description(sentence.clone()),
        GoalCue::Image(RgbImage { width, height, pixels }) => {
            let shape = vec![*height, *width, 3];
            Cue::Image(tensor(0, Dtype::U8, shape, v1::Encoding::Raw, Bytes::copy_from_slice(pixels)))
        }
    }
}

pub(crate) fn digests(digests: &Digests) -> v1::Digests {
    let Digests { engine, dataset, scorer, config } = digests.clone();
    v1::Digests { engine, dataset, scorer, config }
}

pub(crate) fn time_limits(time: &TimeLimits) -> v1::TimeLimits {
    v1::TimeLimits {
        step_ms: time.step_ms,
        bank_ms: time.bank_ms,
        run_s: time.run_s,
        disconnect_s: time.disconnect_s,
        disconnect_total_s: time.disconnect_total_s,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_episode::Order;

    #[test]
    fn actions_are_their_index_plus_one() {
        for (index, known) in Action::ALL.into_iter().enumerate() {
            assert_eq!(action(index as i32 + 1), Some(known));
            assert_eq!(action_number(known), index as i32 + 1);
        }
        assert_eq!(action(v1::Action::Stop as i32), Some(Action::Stop));
        for wrong in [i32::MIN, -1, 0, 6, i32::MAX] {
            assert_eq!(action(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn a_mission_keeps_its_goals_in_order() {
        let image = RgbImage { width: 2, height: 1, pixels: vec![1, 2, 3, 4, 5, 6] };
        let sent = mission(&Mission {
            order: Order::Ordered,
            goals: vec![
                GoalCue::Category("sofa".into()),
                GoalCue::Description("the red one".into()),
                GoalCue::Image(image),
            ],
        });
        assert_eq!(sent.order(), v1::Order::Ordered);
        let cues: Vec<_> = sent.goals.into_iter().map(|goal| goal.cue.unwrap()).collect();
        assert_eq!(cues[0], Cue::Category("sofa".into()));
        assert_eq!(cues[1], Cue::Description("the red one".into()));
        let Cue::Image(picture) = &cues[2] else { panic!("no picture: {:?}", cues[2]) };
        assert_eq!((picture.shape.as_slice(), &picture.data[..]), (&[1, 2, 3][..], &[1, 2, 3, 4, 5, 6][..]));
    }

    #[test]
    fn rule_sets_differ_on_the_wire() {
        let sensors = Sensors::all(256, 256);
        let paper = task_spec(&Rules::paper(), &sensors);
        let authors = task_spec(&Rules::authors(), &sensors);
        assert_eq!((paper.audio_samples, authors.audio_samples), (4000, 16_000));
        assert_eq!(paper.pose_frame(), v1::PoseFrame::Start);
        assert_eq!(authors.pose_frame(), v1::PoseFrame::World);
        assert_eq!(paper.sound_clip(), v1::SoundClip::Anonymous);
        assert_eq!(authors.sound_clip(), v1::SoundClip::ByCategory);
        assert_eq!(task_spec(&Rules::distinct(), &sensors).sound_clip(), v1::SoundClip::Distinct);
        assert_eq!(paper.samples_per_step, 4000);
        let noisy = task_spec(&Rules::noisy(), &sensors);
        assert_eq!(
            (noisy.depth_noise(), noisy.rgb_noise()),
            (v1::DepthNoise::Redwood, v1::RgbNoise::Gaussian)
        );
        assert_eq!((paper.depth_noise(), paper.rgb_noise()), (v1::DepthNoise::None, v1::RgbNoise::None));
        let measured = Rules { head: HeadRule::Measured("c0ffee".into()), ..Rules::paper() };
        assert_eq!((paper.head.as_str(), task_spec(&measured, &sensors).head.as_str()), ("", "c0ffee"));
        let late = Rules { silence: SilenceRule::WindowEnd, ..Rules::paper() };
        assert_eq!(paper.silence(), v1::SilenceRule::Immediate);
        assert_eq!(task_spec(&late, &sensors).silence(), v1::SilenceRule::WindowEnd);
    }

    #[test]
    fn task_specs_contain_claim_options_and_distractors() {
        let spec = |rules: &Rules| task_spec(rules, &Sensors::all(64, 64));
        let (paper, authors, hard) = (spec(&Rules::paper()), spec(&Rules::authors()), spec(&Rules::hard()));
        assert_eq!(paper.extra_submit(), v1::ExtraSubmit::Ignored);
        assert_eq!(authors.extra_submit(), v1::ExtraSubmit::EndsEpisode);
        assert_eq!(paper.stop_claims(), v1::StopClaims::AnyOpen);
        let sources = |task: &v1::TaskSpec| (task.distractor_sources, task.distractor_sources_per_goal);
        assert_eq!((sources(&paper), sources(&hard)), ((0, 0), (0, 1)));
        let last_only = Rules {
            stop_claims: StopClaims::LastOnly,
            distractor_sources: DistractorSources::Number(2),
            ..Rules::paper()
        };
        assert_eq!(spec(&last_only).stop_claims(), v1::StopClaims::LastOnly);
        assert_eq!(sources(&spec(&last_only)), (2, 0));
    }
}
