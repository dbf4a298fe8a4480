//! What the operator sees and does, and that nobody else can.

use avln_arena::{
    admin::{Drain, Notice, Status, ask},
    data::DataFolder,
    now_unix_ms,
};
use avln_client::{Action, Client, ConnectOptions, Error, Reason, RunOptions};
use avln_store::AuditNote;
use avln_tests::scripted_run::NO_SENSORS;
use avln_tests::{PHASE, TestServer, TestSetup, http};
use serde::Serialize;
use std::time::Duration;
use tokio::time::timeout;

struct Operator {
    url: String,
    token: String,
}

impl Operator {
    async fn of(house: &TestServer) -> Self {
        let token = house.organiser().await;
        Self { url: format!("http://{}", house.doors.admin.unwrap()), token }
    }

    async fn ask(&self, path: &str, token: &str, body: Option<&impl Serialize>) -> (u16, String) {
        let body = body.map(|body| serde_json::to_vec(body).unwrap());
        let answer = ask(&self.url, path, token, body).await.unwrap();
        (answer.status.as_u16(), String::from_utf8(answer.body.to_vec()).unwrap())
    }

    async fn status(&self, path: &str, body: Option<&impl Serialize>) -> Status {
        let (code, words) = self.ask(path, &self.token, body).await;
        assert_eq!(code, 200, "{words}");
        serde_json::from_str(&words).unwrap()
    }

    async fn metrics(&self) -> String {
        self.ask("/metrics", "", None::<&()>).await.1
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_operator_sees_what_is_played_and_nobody_else_does() {
    let house = TestServer::open_with_admin(&TestSetup::default()).await;
    let operator = Operator::of(&house).await;
    let arena = Client::connect(house.agents_url(), &house.token).await.unwrap();
    let run = arena.start_run(RunOptions::new(PHASE, "secretive method")).await.unwrap();
    let mut play = arena.play(&run, NO_SENSORS).await.unwrap();
    let mut episode = play.next_episode().await.unwrap().unwrap();
    for _ in 0..3 {
        episode.step(Action::TurnLeft).await.unwrap();
    }

    let status = operator.status("/v1/status", None::<&()>).await;
    let slots: Vec<_> = status.slots.iter().map(|slot| (slot.run.as_str(), slot.slot, slot.step)).collect();
    assert_eq!(slots, [(run.id.as_str(), 0, 3)]);
    let metrics = operator.metrics().await;
    for line in
        ["avln_steps_total 3\n", "avln_open_episodes 1\n", "avln_step_seconds_count{part=\"thinking\"} 3\n"]
    {
        assert!(metrics.contains(line), "{line} is missing in {metrics}");
    }
    for hidden in ["secretive", run.id.as_str(), avln_tests::TEAM] {
        assert!(!metrics.contains(hidden), "{hidden} is told: {metrics}");
    }
    episode.step(Action::Stop).await.unwrap();
    let metrics = operator.metrics().await;
    assert!(metrics.contains("avln_episodes_ended_total{end=\"stopped\"} 1\n"), "{metrics}");
    assert!(metrics.contains("avln_episodes{state=\"terminated\",end=\"stopped\"} 1\n"), "{metrics}");

    for token in ["", "wrong", &house.token, &run.token] {
        for path in ["/v1/status", "/v1/drain", "/v1/notice"] {
            let body = (path != "/v1/status").then(|| Notice { text: "x".into() });
            let (code, words) = operator.ask(path, token, body.as_ref()).await;
            assert_eq!(code, 401, "{path} with '{token}': {words}");
        }
    }
    for path in ["/metrics", "/v1/status", "/v1/drain", "/v1/notice", "/admin"] {
        assert_eq!(http::get(house.doors.web, path).await.status, 404, "{path} on the people's door");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_drain_begins_nothing_new_and_lets_open_episodes_end() {
    let house = TestServer::open_with_admin(&TestSetup::default()).await;
    let operator = Operator::of(&house).await;
    let link = ConnectOptions { patience: Some(Duration::from_secs(2)), ..ConnectOptions::default() };
    let arena = Client::connect_with(house.agents_url(), &house.token, &link).await.unwrap();
    let run = arena.start_run(RunOptions::new(PHASE, "patient")).await.unwrap();
    let mut play = arena.play(&run, NO_SENSORS).await.unwrap();
    let mut episode = play.next_episode().await.unwrap().unwrap();

    operator.status("/v1/notice", Some(&Notice { text: "closed on Sunday".into() })).await;
    assert_eq!(arena.server_info().await.unwrap().notice, "closed on Sunday");
    assert!(http::get(house.doors.web, "/").await.body.contains("closed on Sunday"));
    let (code, words) =
        operator.ask("/v1/drain", &operator.token, Some(&Drain { reason: " ".into(), minutes: 1 })).await;
    assert_eq!(code, 422, "{words}");

    let drain = Drain { reason: "new disks".into(), minutes: 10 };
    let status = operator.status("/v1/drain", Some(&drain)).await;
    assert_eq!(status.draining.as_deref(), Some("new disks"));
    let info = arena.server_info().await.unwrap();
    assert!(info.draining && info.notice == "new disks", "{info:?}");
    let refused = arena.start_run(RunOptions::new(PHASE, "late")).await.unwrap_err();
    assert_eq!(refused.reason(), Some(Reason::Draining), "{refused}");
    assert!(refused.to_string().contains("new disks"), "{refused}");

    let closing = tokio::spawn(house.doors.wait());
    episode.step(Action::TurnLeft).await.unwrap();
    episode.step(Action::Stop).await.unwrap();
    assert!(episode.is_over());
    let told: Vec<_> = play.take_notices().into_iter().map(|notice| notice.message).collect();
    assert!(told.iter().any(|message| message.contains("new disks")), "{told:?}");
    let refused = play.next_episode().await.unwrap_err();
    let is_refusal = refused.reason() == Some(Reason::Draining) || matches!(refused, Error::Lost { .. });
    assert!(is_refusal, "{refused}");
    drop((play, arena));
    timeout(Duration::from_secs(60), closing).await.expect("it stops").unwrap().unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn what_a_drain_takes_from_phases_is_given_back_on_record() {
    let house = TestServer::open_with_admin(&TestSetup::default()).await;
    let operator = Operator::of(&house).await;
    let store = DataFolder::open(house.folder.path()).unwrap().store().await.unwrap();
    let mut phase = store.phase(PHASE).await.unwrap();
    let closes = now_unix_ms() + 3_600_000;
    phase.schedule.closes_unix_ms = Some(closes);
    store.change_phases(&[phase], &[AuditNote::default()], 1).await.unwrap();
    let before = now_unix_ms();
    operator.status("/v1/drain", Some(&Drain { reason: "new disks".into(), minutes: 0 })).await;
    timeout(Duration::from_secs(60), house.doors.wait()).await.expect("it stops").unwrap();
    tokio::time::sleep(Duration::from_millis(1500)).await;
    let next = avln_tests::start_servers(house.folder.path()).await;
    let away = now_unix_ms() - before;
    let later = store.phase(PHASE).await.unwrap().schedule.closes_unix_ms.unwrap() - closes;
    assert!((1500..=away).contains(&later), "{later} ms later after {away} ms");
    let audit = store.audit().await.unwrap();
    let told: Vec<_> = audit.iter().filter(|line| line.actor == "server").collect();
    let words: Vec<_> = told.iter().map(|line| (line.subject.as_str(), line.what.as_str())).collect();
    assert_eq!(words, [("server", "drain"), ("phase trial", "closes")]);
    assert!(told.iter().all(|line| line.reason == "new disks"), "{told:?}");
    next.close().await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn the_operators_door_is_never_opened_to_other_machines() {
    let free = "127.0.0.1:0".parse().unwrap();
    let addresses = avln_arena::servers::Addresses { grpc: free, web: free };
    let doors = avln_arena::servers::Servers::bind(&addresses).await.unwrap();
    let Err(refused) = doors.with_admin("0.0.0.0:0".parse().unwrap()).await else { panic!("it was opened") };
    assert!(refused.to_string().contains("ssh -L"), "{refused}");
}
