//! Conversions to messages. All messages are built here, from `avln-episode` types and public values of the host.

use crate::{
    control::unix_ms,
    host::{Digests, ServerInfo, StoredEnd},
    limits::Limits,
};
use avln_challenge::{
    MethodInfo, MethodType, PhaseInfo, PhaseState, Quota, QuotaWindow, RunState, RunStatus, TokenScope,
    Visibility,
};
use avln_episode::{
    Action, DepthNoise, DistanceRule, DistractorSources, EndReason, ExtraSubmit, FeedbackRule, GoalCue,
    HeadRule, Mission, Order, PoseFrame, RgbImage, RgbNoise, Rules, Sensors, SilenceRule, SoundClip,
    SoundingRule, StopClaims, TimeLimits, WrongSubmit,
};
use avln_proto::v1::{self, Dtype, SensorKind, goal::Cue};
use bytes::Bytes;
use observation::tensor;

mod observation;
mod sensors;

pub(crate) use observation::{ObservationFormat, observation, tensor_specs};
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

pub(crate) fn server_info(
    info: ServerInfo,
    limits: &Limits,
    draining: bool,
    notice: String,
) -> v1::GetServerInfoResponse {
    let state = if draining { v1::ServerState::Draining } else { v1::ServerState::Up };
    let clients = info.clients.into_iter().map(|range| v1::ClientRange {
        name: range.name,
        min_version: range.min_version,
        max_version: range.max_version,
        min_api_minor: 0,
        install: range.install,
    });
    v1::GetServerInfoResponse {
        name: info.name,
        version: info.version,
        api_minor: info.api_minor,
        benchmark: info.benchmark,
        digests: None,
        clients: clients.collect(),
        encodings: sensors::offered(),
        max_request_bytes: limits.decode_bytes as u32,
        server_time_unix_ms: unix_ms(),
        state: state.into(),
        notice,
    }
}

pub(crate) fn phase(phase: PhaseInfo) -> v1::Phase {
    let sensors = [
        (phase.sensors.rgb, SensorKind::Rgb),
        (phase.sensors.depth, SensorKind::Depth),
        (phase.sensors.audio, SensorKind::Audio),
    ];
    v1::Phase {
        id: phase.id,
        title: phase.title,
        description: phase.description,
        orders: phase.orders.into_iter().map(|order| self::order(order).into()).collect(),
        episodes: phase.episode_count,
        max_slots: phase.max_slots.min(Limits::MAX_SLOTS),
        feedback: self::feedback_rule(phase.feedback).into(),
        sensors: sensors.into_iter().filter(|(on, _)| *on).map(|(_, kind)| kind.into()).collect(),
        encodings: sensors::offered_in(&phase.sensors),
        state: self::phase_state(phase.state).into(),
        state_reason: phase.state_reason.unwrap_or_default(),
        opens_unix_s: seconds(phase.opens_unix_ms),
        closes_unix_s: seconds(phase.closes_unix_ms),
        results: self::visibility(phase.results).into(),
        commitment: phase.commitment.unwrap_or_default(),
        revealed: phase.revealed.map(|values| v1::Revealed {
            pool: values.pool,
            scorer: values.scorer,
            secret: values.secret,
        }),
        time: Some(self::time_limits(&phase.time)),
        rules: phase.rules,
        sealed: phase.sealed,
        max_side: phase.sensors.width.max(phase.sensors.height),
    }
}

pub(crate) fn scope(scope: TokenScope) -> v1::TokenScope {
    match scope {
        TokenScope::Participant => v1::TokenScope::Participant,
        TokenScope::ReadOnly => v1::TokenScope::ReadOnly,
        TokenScope::Organiser => v1::TokenScope::Organiser,
        // Run tokens have no account, so hosts never return this scope.
        TokenScope::Run => v1::TokenScope::Unspecified,
    }
}

/// Returns whole seconds, and 0 if there is no time.
pub(crate) fn seconds(unix_ms: Option<i64>) -> i64 {
    unix_ms.map_or(0, |ms| ms.div_euclid(1000))
}

pub(crate) fn quota(quota: Quota) -> v1::Quota {
    v1::Quota {
        phase: quota.phase,
        window: self::quota_window(quota.window).into(),
        limit: quota.limit,
        used: quota.used,
        remaining: quota.remaining,
        window_start_unix_s: quota.window_start_unix_ms.div_euclid(1000),
        next_increase_unix_s: seconds(quota.next_increase_unix_ms),
        charges: quota
            .charges
            .into_iter()
            .map(|charge| v1::Charge { run: charge.run, reason: charge.reason.to_owned() })
            .collect(),
    }
}

pub(crate) fn run(status: RunStatus) -> v1::Run {
    let over = !status.state.is_open();
    let progress = progress(&status);
    v1::Run {
        id: status.run,
        phase: status.phase,
        order: self::order(status.order).into(),
        method: Some(method(status.method)),
        state: self::run_state(status.state).into(),
        state_since_unix_ms: status.updated_unix_ms,
        state_deadline_unix_ms: status.deadline_unix_ms.unwrap_or_default(),
        created_unix_ms: status.created_unix_ms,
        ended_unix_ms: if over { status.updated_unix_ms } else { 0 },
        progress: Some(progress),
        ends: end_counts(&status.ends),
        eligible: status.ineligible_because.is_empty(),
        ineligible_because: status.ineligible_because,
        metrics: status.metrics.map(|metrics| public_metrics(metrics, status.done)),
        sealed: status.sealed,
        charged: status.charge.charged,
        charge_reason: status.charge.reason.to_owned(),
        url: status.url,
        ..v1::Run::default()
    }
}

/// Builds an episode's end, without the run's progress.
pub(crate) fn episode_end(slot: u32, episode: &str, end: StoredEnd) -> v1::EpisodeEnd {
    v1::EpisodeEnd {
        slot,
        episode: episode.to_owned(),
        step: end.steps,
        reason: self::end_reason(end.reason).into(),
        terminated: end.reason.is_terminated(),
        metrics: end.outcome.map(|outcome| public_metrics(outcome.metrics, 0)),
        progress: None,
    }
}

pub(crate) fn run_end(status: RunStatus) -> v1::RunEnd {
    let cut_short = matches!(status.state, RunState::Failed | RunState::Cancelled | RunState::Expired);
    v1::RunEnd {
        progress: Some(progress(&status)),
        run: status.run,
        ends: end_counts(&status.ends),
        metrics: status.metrics.map(|metrics| public_metrics(metrics, status.done)),
        complete: !cut_short && status.done >= status.episodes,
        url: status.url,
    }
}

fn progress(status: &RunStatus) -> v1::RunProgress {
    v1::RunProgress { total: status.episodes, done: status.done, in_flight: status.in_flight, eta_s: None }
}

fn method(method: MethodInfo) -> v1::MethodInfo {
    let MethodInfo { name, version, method_type, .. } = method;
    v1::MethodInfo {
        name,
        version,
        description: method.description,
        code_url: method.code_url,
        paper_url: method.paper_url,
        weights_licence: method.weights_licence,
        external_data: method.external_data,
        method_type: method_type.map_or(v1::MethodType::Unspecified, self::method_type).into(),
    }
}

/// Returns the type of a method; `None` if the client declared none.
pub(crate) fn declared_type(declared: v1::MethodType) -> Option<MethodType> {
    MethodType::ALL.iter().copied().find(|&known| self::method_type(known) == declared)
}

fn end_counts(ends: &[(EndReason, u32)]) -> Vec<v1::EndCount> {
    let count = |&(reason, episodes)| v1::EndCount { reason: self::end_reason(reason).into(), episodes };
    ends.iter().map(count).collect()
}

/// Builds public metrics over a number of episodes; 0 for a single episode.
fn public_metrics(metrics: Vec<(String, f64)>, episodes: u32) -> v1::PublicMetrics {
    let metric = |(name, value)| v1::Metric { name, value, low: None, high: None, n: episodes };
    v1::PublicMetrics { metrics: metrics.into_iter().map(metric).collect() }
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
