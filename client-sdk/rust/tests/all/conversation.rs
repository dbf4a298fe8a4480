//! The client against a server that plays by a script.

use crate::fake::{RUN_TOKEN, SIDE, Stage, TOKEN, fault, observation, refusal, serve, welcome};
use avln_client::{
    Action, Agent, Client, ConnectOptions, EndReason, Error, GoalCue, Mission, Observation, Order, Packing,
    Play, Reason, Run, RunOptions, Sensors, TaskSpec, evaluate, evaluate_slots,
};
use avln_proto::v1::{self, play_request::Frame as Asked, play_response::Frame as Told};
use std::{future::Future, time::Duration};
use tonic::{Code, Status};

/// Opens a stream to a server with this script.
async fn open<F, S>(script: F) -> Result<Play, Error>
where
    F: Fn(Stage) -> S + Send + Sync + 'static,
    S: Future<Output = ()> + Send + 'static,
{
    let client = Client::connect(serve(script).await, "").await?;
    client.play(&Run::from_token(RUN_TOKEN), Sensors::square(SIDE)).await
}

/// Greets and starts an episode.
async fn one_episode(stage: &mut Stage) {
    stage.greet().await;
    stage.hear_ready().await;
    stage.begin(0, "ep_a", 1).await;
}

/// Two episodes, each until Stop; then the run ends.
async fn two_episodes(mut stage: Stage) {
    stage.greet().await;
    for (ordinal, episode) in [(1, "ep_a"), (2, "ep_b")] {
        stage.hear_ready().await;
        stage.begin(0, episode, ordinal).await;
        stage.play_until_stop(0, episode, ordinal).await;
    }
    stage.hear_ready().await;
    stage.end_run(2).await;
}

/// Walks `steps` steps and stops.
struct Walker {
    steps: u32,
    entered: Vec<String>,
    begun: usize,
}

impl Agent for Walker {
    fn enter(&mut self, episode: &str) {
        assert_eq!(self.entered.len(), self.begun);
        self.entered.push(episode.to_owned());
    }

    fn begin(&mut self, _: &TaskSpec, _: &Mission) {
        self.begun += 1;
    }

    fn act(&mut self, observation: &Observation) -> Action {
        if observation.step < self.steps { Action::MoveForward } else { Action::Stop }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_whole_run_is_evaluated() {
    let client = Client::connect(serve(two_episodes).await, TOKEN).await.unwrap();
    let run = client.start_run(RunOptions::new("practice", "walker").order(Order::Unordered)).await.unwrap();
    assert_eq!((run.id.as_str(), run.episodes, run.max_slots), ("run_1", 2, 2));
    let mut walker = Walker { steps: 3, entered: vec![], begun: 0 };
    let summary = evaluate(&client, &run, Sensors::square(SIDE), &mut walker).await.unwrap();
    assert_eq!((walker.begun, walker.entered), (2, vec!["ep_a".to_owned(), "ep_b".to_owned()]));
    assert!(summary.complete);
    assert_eq!((summary.progress.done, summary.progress.total), (2, 2));
    assert_eq!(summary.ends, [(EndReason::Stopped, 2)]);
    assert_eq!(summary.metric("isr").map(|metric| metric.value), Some(0.5));
}

#[tokio::test]
async fn observations_arrive_in_metres_and_ears() {
    let mut play = open(two_episodes).await.unwrap();
    assert_eq!(play.task().max_steps, 100);
    let mut episode = play.next_episode().await.unwrap().unwrap();
    assert_eq!((episode.id(), episode.ordinal()), ("ep_a", 1));
    assert_eq!(episode.mission().goals[0], GoalCue::Category("chair".into()));
    let seen = episode.step(Action::MoveForward).await.unwrap();
    assert_eq!((seen.step, seen.remaining_steps, seen.remaining_submits), (1, 99, 1));
    assert_eq!(seen.pose.position(), [0.0, 0.0, -0.25]);
    let rgb = seen.rgb.as_ref().unwrap();
    assert_eq!(
        (rgb.width, rgb.height, rgb.pixels[0], rgb.pixels.len()),
        (SIDE, SIDE, 1, (SIDE * SIDE * 3) as usize)
    );
    let depth = seen.depth.as_ref().unwrap();
    assert_eq!((depth.metres[0], depth.metres.len()), (5.0, (SIDE * SIDE) as usize));
    let audio = seen.audio.as_ref().unwrap();
    assert_eq!(
        (audio.sample_rate_hz, audio.left.as_slice(), audio.right[0]),
        (16_000, [1.0; 8].as_slice(), -1.0)
    );
    assert_eq!(episode.time_left().bank, Duration::from_secs(60));
    episode.step(Action::Stop).await.unwrap();
    let end = episode.end().unwrap();
    assert_eq!((end.reason, end.terminated, end.steps, end.progress.done), (EndReason::Stopped, true, 2, 1));
    assert!(matches!(episode.step(Action::Stop).await, Err(Error::EpisodeOver)));
}

#[tokio::test]
async fn a_refused_step_leaves_the_episode_open() {
    let mut play = open(|mut stage| async move {
        one_episode(&mut stage).await;
        stage.hear_act().await;
        let refused =
            v1::Fault { episode: "ep_a".into(), step: 1, ..fault(Some(0), v1::Reason::RateLimit, true) };
        stage.tell(Told::Fault(v1::Fault { retry_after_s: Some(2), ..refused })).await;
        stage.play_until_stop(0, "ep_a", 1).await;
    })
    .await
    .unwrap();
    let mut episode = play.next_episode().await.unwrap().unwrap();
    let error = episode.step(Action::MoveForward).await.unwrap_err();
    assert_eq!(error.reason(), Some(Reason::RateLimit));
    assert!(error.to_string().contains("told RATE_LIMIT; try again in 2 s"), "{error}");
    assert!(!episode.is_over());
    episode.step(Action::Stop).await.unwrap();
    assert!(episode.is_over());
}

#[tokio::test]
async fn server_fault_ends_episode_but_not_run() {
    let mut play = open(|mut stage| async move {
        one_episode(&mut stage).await;
        stage.hear_act().await;
        stage.tell(Told::Fault(fault(Some(0), v1::Reason::SimFault, false))).await;
        stage.end(0, "ep_a", 0, v1::EndReason::ServerFault, 1).await;
        stage.hear_ready().await;
        stage.begin(0, "ep_b", 2).await;
        stage.play_until_stop(0, "ep_b", 2).await;
    })
    .await
    .unwrap();
    let mut first = play.next_episode().await.unwrap().unwrap();
    first.step(Action::TurnLeft).await.unwrap();
    assert_eq!(first.end().unwrap().reason, EndReason::ServerFault);
    assert_eq!(first.fault().and_then(Error::reason), Some(Reason::SimFault));
    let mut second = play.next_episode().await.unwrap().unwrap();
    assert!(second.fault().is_none());
    second.step(Action::Stop).await.unwrap();
}

#[tokio::test]
async fn slow_agent_receives_end_and_skips_stale_faults() {
    let mut play = open(|mut stage| async move {
        one_episode(&mut stage).await;
        stage.end(0, "ep_a", 0, v1::EndReason::TimeBudget, 1).await;
        stage.hear_act().await;
        let late = v1::Fault { episode: "ep_a".into(), ..fault(Some(0), v1::Reason::EpisodeOver, true) };
        stage.tell(Told::Fault(late)).await;
        stage.hear_ready().await;
        stage.begin(0, "ep_b", 2).await;
        stage.play_until_stop(0, "ep_b", 2).await;
    })
    .await
    .unwrap();
    let mut first = play.next_episode().await.unwrap().unwrap();
    first.step(Action::MoveForward).await.unwrap();
    assert_eq!(first.end().unwrap().reason, EndReason::TimeBudget);
    let mut second = play.next_episode().await.unwrap().unwrap();
    second.step(Action::Stop).await.unwrap();
    assert_eq!(second.end().unwrap().reason, EndReason::Stopped);
}

#[tokio::test]
async fn open_episode_is_abandoned_before_next() {
    let mut play = open(|mut stage| async move {
        one_episode(&mut stage).await;
        let Some(Asked::Abandon(abandon)) = stage.hear().await else { panic!("no Abandon") };
        assert_eq!((abandon.slot, abandon.episode.as_str(), abandon.step), (0, "ep_a", 0));
        stage.end(0, "ep_a", 0, v1::EndReason::Abandoned, 1).await;
        stage.hear_ready().await;
        stage.begin(0, "ep_b", 2).await;
        stage.hear().await;
    })
    .await
    .unwrap();
    assert!(play.next_episode().await.unwrap().is_some());
    let second = play.next_episode().await.unwrap().unwrap();
    assert_eq!((second.id(), second.progress().total), ("ep_b", 2));
}

#[tokio::test]
async fn pings_are_answered_while_agent_thinks() {
    let (answered, mut heard) = tokio::sync::mpsc::channel(1);
    let mut play = open(move |mut stage| {
        let answered = answered.clone();
        async move {
            one_episode(&mut stage).await;
            stage.mumble().await;
            let news = v1::Notice { message: "lunch".into(), ..v1::Notice::default() };
            stage.tell(Told::Notice(news)).await;
            stage.tell(Told::Ping(v1::Ping { nonce: 41, ..v1::Ping::default() })).await;
            let Some(Asked::Pong(pong)) = stage.hear().await else { panic!("no Pong") };
            answered.send(pong.nonce).await.unwrap();
            stage.play_until_stop(0, "ep_a", 1).await;
        }
    })
    .await
    .unwrap();
    let mut episode = play.next_episode().await.unwrap().unwrap();
    assert_eq!(heard.recv().await, Some(41));
    episode.step(Action::Stop).await.unwrap();
    assert_eq!(play.take_notices()[0].message, "lunch");
    assert!(play.take_notices().is_empty());
}

#[tokio::test]
async fn finish_sends_goodbye_and_returns_summary() {
    let mut play = open(|mut stage| async move {
        one_episode(&mut stage).await;
        assert!(matches!(stage.hear().await, Some(Asked::Goodbye(v1::Goodbye { pause: false }))));
        stage.end(0, "ep_a", 0, v1::EndReason::Abandoned, 1).await;
        stage.end_run(1).await;
    })
    .await
    .unwrap();
    assert!(play.next_episode().await.unwrap().is_some());
    let summary = play.finish().await.unwrap();
    assert_eq!((summary.complete, summary.progress.done), (false, 1));
}

#[tokio::test]
async fn dropped_client_sends_no_goodbye() {
    let (said, mut heard) = tokio::sync::mpsc::channel(1);
    let mut play = open(move |mut stage| {
        let said = said.clone();
        async move {
            one_episode(&mut stage).await;
            said.send(stage.hear().await).await.unwrap();
        }
    })
    .await
    .unwrap();
    assert!(play.next_episode().await.unwrap().is_some());
    drop(play);
    assert_eq!(heard.recv().await, Some(None));
}

#[tokio::test]
async fn a_server_that_vanishes_is_a_lost_connection() {
    let mut play = open(|mut stage| async move { one_episode(&mut stage).await }).await.unwrap();
    let mut episode = play.next_episode().await.unwrap().unwrap();
    let error = episode.step(Action::MoveForward).await.unwrap_err();
    assert!(matches!(error, Error::Lost { .. }), "{error}");
    assert!(play.next_episode().await.is_err());
}

#[tokio::test]
async fn second_connection_ends_first_with_reason() {
    let mut play = open(|mut stage| async move {
        one_episode(&mut stage).await;
        stage.hear_act().await;
        stage.die(refusal(Code::Aborted, v1::Reason::Superseded)).await;
    })
    .await
    .unwrap();
    let mut episode = play.next_episode().await.unwrap().unwrap();
    let error = episode.step(Action::MoveForward).await.unwrap_err();
    assert_eq!(error.reason(), Some(Reason::Superseded));
}

#[tokio::test]
async fn old_client_error_names_required_version() {
    let opened = open(|mut stage| async move {
        let Some(Asked::Hello(hello)) = stage.hear().await else { panic!("no Hello") };
        assert_eq!(hello.client.unwrap().name, "avln-client");
        let message = "install avln-client 2.0 or newer".to_owned();
        stage.tell(Told::Fault(v1::Fault { message, ..fault(None, v1::Reason::ClientTooOld, false) })).await;
    });
    let error = opened.await.unwrap_err();
    assert_eq!(error.reason(), Some(Reason::ClientTooOld));
    assert!(error.to_string().contains("install avln-client 2.0"), "{error}");
}

/// Client error for a modified Welcome.
async fn complaint(spoil: impl Fn(&mut v1::Welcome) + Clone + Send + Sync + 'static) -> String {
    let opened = open(move |mut stage| {
        let spoil = spoil.clone();
        async move {
            stage.hear().await;
            let mut spoilt = welcome(1);
            spoil(&mut spoilt);
            stage.tell(Told::Welcome(spoilt)).await;
            stage.hear().await;
        }
    });
    match opened.await {
        Err(Error::Protocol { detail }) => detail,
        other => panic!("no protocol error but {other:?}"),
    }
}

#[tokio::test]
async fn inconsistent_welcome_is_rejected_before_first_step() {
    assert!(complaint(|w| w.task = None).await.contains("no task"));
    assert!(complaint(|w| w.slots = 0).await.contains("no slot"));
    assert!(complaint(|w| w.api_minor = 9).await.contains("minor 9"));
    assert!(complaint(|w| w.max_message_bytes = 17 << 20).await.contains("smaller images"));
    assert!(complaint(|w| w.tensors.truncate(2)).await.contains("SENSOR_KIND_AUDIO"));
    assert!(complaint(|w| w.tensors[1].shape = vec![SIDE, 1]).await.contains("[64, 1]"));
    assert!(complaint(|w| w.tensors[0].encoding = 2).await.contains("ENCODING_PNG"));
    assert!(complaint(|w| w.task.as_mut().unwrap().forward_m = f32::NAN).await.contains("forward_m"));
    assert!(complaint(|w| w.task.as_mut().unwrap().width = 512).await.contains("got 512 x 64"));
}

#[tokio::test]
async fn observations_that_break_the_agreement_are_refused() {
    let spoilt: [fn(&mut v1::Observation); 4] = [
        |seen| seen.tensors[1].data = vec![0; 5].into(),
        |seen| seen.tensors.truncate(1),
        |seen| seen.pose = None,
        |seen| seen.step = 7,
    ];
    for spoil in spoilt {
        let mut play = open(move |mut stage| async move {
            one_episode(&mut stage).await;
            stage.hear_act().await;
            let mut seen = observation(0, "ep_a", 1);
            spoil(&mut seen);
            stage.tell(Told::Observation(seen)).await;
            stage.hear().await;
        })
        .await
        .unwrap();
        let mut episode = play.next_episode().await.unwrap().unwrap();
        let error = episode.step(Action::MoveForward).await.unwrap_err();
        assert!(matches!(error, Error::Protocol { .. }), "{error}");
    }
}

#[tokio::test]
async fn raw_numbers_may_replace_agreed_encoding() {
    let server = serve(|mut stage: Stage| async move {
        stage.hear().await;
        let mut packed = welcome(1);
        packed.tensors[..2].iter_mut().for_each(|tensor| tensor.set_encoding(v1::Encoding::Packed));
        stage.tell(Told::Welcome(packed)).await;
        stage.hear_ready().await;
        stage.begin(0, "ep_a", 1).await;
        stage.hear().await;
    });
    let options = ConnectOptions { packing: Some(Packing::Lossless), ..ConnectOptions::default() };
    let client = Client::connect_with(server.await, "", &options).await.unwrap();
    let mut play = client.play(&Run::from_token(RUN_TOKEN), Sensors::square(SIDE)).await.unwrap();
    let episode = play.next_episode().await.unwrap().unwrap();
    let seen = episode.observation();
    assert!(seen.rgb.is_some() && seen.depth.is_some());
}

#[tokio::test]
async fn wrong_run_token_is_token_error() {
    let client = Client::connect(serve(two_episodes).await, "").await.unwrap();
    let error = client.play(&Run::from_token("bad"), Sensors::square(SIDE)).await.unwrap_err();
    assert_eq!(error.reason(), Some(Reason::TokenMalformed));
}

#[tokio::test]
async fn a_status_without_a_reason_keeps_its_text() {
    let mut play = open(|mut stage| async move {
        stage.greet().await;
        stage.hear_ready().await;
        stage.die(Status::internal("id 7")).await;
    })
    .await
    .unwrap();
    let error = play.next_episode().await.unwrap_err();
    assert!(error.to_string().contains("id 7"), "{error}");
}

/// Plays an episode in two slots, step by step in turn.
async fn two_slots(mut stage: Stage) {
    assert_eq!(stage.greet().await.slots, 2);
    for slot in [stage.hear_ready().await.slot, stage.hear_ready().await.slot] {
        stage.begin(slot, &format!("ep_{slot}"), slot + 1).await;
    }
    let (mut done, mut ready) = (0, 0);
    while ready < 2 {
        match stage.hear().await.unwrap() {
            Asked::Ready(_) => ready += 1,
            Asked::Act(act) => {
                let stop = act.action() == v1::Action::Stop;
                let seen = observation(act.slot, &act.episode, act.step);
                stage.tell(Told::Observation(v1::Observation { terminated: stop, ..seen })).await;
                if stop {
                    done += 1;
                    stage.end(act.slot, &act.episode, act.step, v1::EndReason::Stopped, done).await;
                }
            }
            other => panic!("{other:?}"),
        }
    }
    stage.end_run(done).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn two_agents_play_two_slots_of_one_run() {
    let client = Client::connect(serve(two_slots).await, "").await.unwrap();
    let walker = |steps| Box::new(Walker { steps, entered: vec![], begun: 0 }) as Box<dyn Agent + Send>;
    let run = Run::from_token(RUN_TOKEN);
    let (mut agents, mut ended) = (vec![walker(2), walker(9)], 0);
    let summary =
        evaluate_slots(&client, &run, Sensors::square(SIDE), &mut agents, &mut |_| ended += 1).await.unwrap();
    assert!(summary.complete);
    assert_eq!((agents.len(), ended), (2, summary.progress.done));
}
