//! Conversions between benchmark types and messages. All messages of this crate are built here, from `avln-episode` types and
//! public values of the host.

use crate::host::Digests;
use avln_episode::{
    Action, DepthNoise, DistanceRule, EndReason, FeedbackRule, GoalCue, HeadRule, Mission, Order, PoseFrame,
    RgbImage, RgbNoise, Rules, Sensors, SoundClip, SoundingRule, TimeLimits, WrongSubmit,
};
use avln_proto::v1::{self, Dtype, goal::Cue};
use bytes::Bytes;
use observation::tensor;

mod observation;
mod run;
mod sensors;

pub(crate) use observation::{ObservationFormat, observation, tensor_specs};
pub(crate) use run::{phase, public_metrics, quota, run, run_end, scope, seconds, server_info};
pub(crate) use sensors::{check_client, sensors};

pub(crate) fn order(order: Order) -> v1::Order {
    match order {
        Order::Ordered => v1::Order::Ordered,
        Order::Unordered => v1::Order::Unordered,
    }
}

pub(crate) fn end_reason(reason: EndReason) -> v1::EndReason {
    match reason {
        EndReason::Stopped => v1::EndReason::Stopped,
        EndReason::FinalSubmit => v1::EndReason::FinalSubmit,
        EndReason::StepLimit => v1::EndReason::StepLimit,
        EndReason::TimeBudget => v1::EndReason::TimeBudget,
        EndReason::Abandoned => v1::EndReason::Abandoned,
        EndReason::Disconnected => v1::EndReason::Disconnected,
        EndReason::ServerFault => v1::EndReason::ServerFault,
    }
}

pub(crate) fn feedback_rule(rule: FeedbackRule) -> v1::FeedbackRule {
    match rule {
        FeedbackRule::None => v1::FeedbackRule::None,
        FeedbackRule::Accepted => v1::FeedbackRule::Accepted,
        FeedbackRule::Verdict => v1::FeedbackRule::Verdict,
    }
}

/// Returns the action for a wire number: index plus one.
pub(crate) fn action(number: i32) -> Option<Action> {
    let index = u32::try_from(number).ok()?.checked_sub(1)?;
    Action::try_from(index).ok()
}

/// Returns an action's wire number.
pub(crate) fn action_number(action: Action) -> i32 {
    action.index() as i32 + 1
}

/// Describes rules and sensors.
pub(crate) fn task_spec(rules: &Rules, sensors: &Sensors) -> v1::TaskSpec {
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
    }
}

fn depth_noise(noise: DepthNoise) -> v1::DepthNoise {
    match noise {
        DepthNoise::None => v1::DepthNoise::None,
        DepthNoise::Redwood => v1::DepthNoise::Redwood,
    }
}

fn rgb_noise(noise: RgbNoise) -> v1::RgbNoise {
    match noise {
        RgbNoise::None => v1::RgbNoise::None,
        RgbNoise::Gaussian => v1::RgbNoise::Gaussian,
    }
}

fn head(head: &HeadRule) -> String {
    match head {
        HeadRule::Sphere => String::new(),
        HeadRule::Measured(digest) => digest.clone(),
    }
}

fn pose_frame(frame: PoseFrame) -> v1::PoseFrame {
    match frame {
        PoseFrame::Start => v1::PoseFrame::Start,
        PoseFrame::World => v1::PoseFrame::World,
    }
}

fn distance_rule(rule: DistanceRule) -> v1::DistanceRule {
    match rule {
        DistanceRule::CameraToBox => v1::DistanceRule::CameraToBox,
        DistanceRule::BaseToViewpoint => v1::DistanceRule::BaseToViewpoint,
    }
}

fn wrong_submit(rule: WrongSubmit) -> v1::WrongSubmit {
    match rule {
        WrongSubmit::KeepsGoal => v1::WrongSubmit::KeepsGoal,
        WrongSubmit::SkipsGoal => v1::WrongSubmit::SkipsGoal,
    }
}

fn sounding_rule(rule: SoundingRule) -> v1::SoundingRule {
    match rule {
        SoundingRule::UnfinishedInDrawnOrder => v1::SoundingRule::UnfinishedInDrawnOrder,
        SoundingRule::AllInGoalOrder => v1::SoundingRule::AllInGoalOrder,
    }
}

fn sound_clip(clip: SoundClip) -> v1::SoundClip {
    match clip {
        SoundClip::Anonymous => v1::SoundClip::Anonymous,
        SoundClip::Distinct => v1::SoundClip::Distinct,
        SoundClip::ByCategory => v1::SoundClip::ByCategory,
    }
}

/// Builds a mission.
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

/// Builds the digests that results depend on.
pub(crate) fn digests(digests: &Digests) -> v1::Digests {
    let Digests { engine, dataset, scorer, config } = digests.clone();
    v1::Digests { engine, dataset, scorer, config }
}

/// Builds the time limits.
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
    }
}
