//! Fair sharing between agents; a long connection has no disadvantage.

use avln_arena::{servers::Limits, setup::admit};
use avln_client::{Action, Client, EndReason, Error, Order, Play, Reason, RunOptions, Sensors};
use avln_tests::{
    PHASE, TestServer, TestSetup, change_phase, clients::NO_SENSORS, proxies::FaultProxy, set_up, store,
};
use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU32, Ordering},
    },
    time::Duration,
};
use tokio::{sync::Mutex, task::JoinSet, time::sleep};

/// Serialises the tests, because they measure processor time.
static ALONE: Mutex<()> = Mutex::const_new(());

/// Turns on the spot in every slot until `enough`.
async fn turn(
    client: Client,
    slots: u32,
    steps: Arc<AtomicU32>,
    enough: Arc<AtomicBool>,
) -> Result<(), Error> {
    let run = client.start_run(RunOptions::new(PHASE, "dervish").order(Order::Unordered)).await?;
    let mut players = JoinSet::new();
    for mut play in client.play_slots(&run, Sensors::default(), slots).await? {
        let (steps, enough) = (steps.clone(), enough.clone());
        players.spawn(async move {
            while let Some(mut episode) = play.next_episode().await? {
                while !episode.is_over() && !enough.load(Ordering::Relaxed) {
                    episode.step(Action::TurnLeft).await?;
                    steps.fetch_add(1, Ordering::Relaxed);
                }
                if enough.load(Ordering::Relaxed) {
                    break;
                }
            }
            Ok::<_, Error>(())
        });
    }
    while let Some(joined) = players.join_next().await {
        joined.expect("no panic")?;
    }
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn teams_share_steps_independent_of_slots() {
    let _alone = ALONE.lock().await;
    let folder = tempfile::tempdir().expect("a folder");
    let token = set_up(folder.path(), &TestSetup { houses: 1, missions: 17, ..TestSetup::default() }).await;
    let store = store(folder.path()).await;
    let modest = admit(&store, "modest", None).await.expect("another team");
    store.close().await;
    let one_core = |limits: Limits| Limits { max_simulations: 1, ..limits };
    let server = TestServer::open_with(folder, token, |arena| arena, one_core).await;

    let enough = Arc::new(AtomicBool::new(false));
    let steps: [Arc<AtomicU32>; 2] = Default::default();
    let mut teams = JoinSet::new();
    for (token, slots, steps) in [(&server.token, 16, &steps[0]), (&modest, 1, &steps[1])] {
        let client = Client::connect(server.agents_url(), token).await.expect("a connection");
        teams.spawn(turn(client, slots, steps.clone(), enough.clone()));
    }
    while steps.iter().any(|steps| steps.load(Ordering::Relaxed) < 20) {
        sleep(Duration::from_millis(50)).await;
    }
    let before = steps.each_ref().map(|steps| steps.load(Ordering::Relaxed));
    sleep(Duration::from_secs(5)).await;
    let [greedy, modest] = [0, 1].map(|team| steps[team].load(Ordering::Relaxed) - before[team]);
    enough.store(true, Ordering::Relaxed);
    while let Some(joined) = teams.join_next().await {
        joined.expect("no panic").expect("two teams that play");
    }
    println!("in 5 s {modest} steps for one slot, {greedy} for sixteen");
    assert!(modest * 3 >= greedy, "{modest} steps for one slot, {greedy} for sixteen");
}

/// Attempts to open all 256 sessions for a team. Returns the open ones and the number of refusals.
async fn take_sessions(server: &TestServer, token: &str) -> (Vec<Play>, usize) {
    let (mut sessions, mut refusals) = (Vec::new(), 0);
    // A connection carries at most 128 calls at a time.
    for _ in 0..4 {
        let client = Client::connect(server.agents_url(), token).await.expect("a connection");
        for _ in 0..64 {
            let options = RunOptions::new(PHASE, "hog").order(Order::Unordered);
            let run = client.start_run(options).await.expect("a run");
            match client.play(&run, NO_SENSORS).await {
                Ok(play) => sessions.push(play),
                Err(refused) => {
                    assert_eq!(refused.reason(), Some(Reason::NoCapacity), "{refused}");
                    refusals += 1;
                }
            }
        }
    }
    (sessions, refusals)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_team_never_takes_all_sessions() {
    let _alone = ALONE.lock().await;
    let folder = tempfile::tempdir().expect("a folder");
    let token = set_up(folder.path(), &TestSetup::default()).await;
    let store = store(folder.path()).await;
    let modest = admit(&store, "modest", None).await.expect("another team");
    store.close().await;
    let server = TestServer::open_with(folder, token, |arena| arena, |limits| limits).await;
    let (sessions, refusals) = take_sessions(&server, &server.token).await;
    assert_eq!((sessions.len(), refusals), (128, 128), "half of the sessions");
    let client = Client::connect(server.agents_url(), &modest).await.expect("a connection");
    let run = client.start_run(RunOptions::new(PHASE, "new").order(Order::Unordered)).await.expect("a run");
    let mut play = client.play(&run, NO_SENSORS).await.expect("a session at once");
    let mut episode = play.next_episode().await.expect("an answer").expect("an episode");
    episode.step(Action::Stop).await.expect("a step");
}

#[tokio::test(flavor = "multi_thread")]
async fn hundred_milliseconds_away_costs_no_time() {
    let _alone = ALONE.lock().await;
    let folder = tempfile::tempdir().expect("a folder");
    let token = set_up(folder.path(), &TestSetup::default()).await;
    change_phase(folder.path(), |phase| (phase.time.step_ms, phase.time.bank_ms) = (150, 1000)).await;
    let server = TestServer::open_with(folder, token, |arena| arena, |limits| limits).await;
    let proxy = FaultProxy::open_delayed(server.servers.grpc, Duration::from_millis(100)).await;
    let client = Client::connect(proxy.url(), &server.token).await.expect("a connection");
    let run = client.start_run(RunOptions::new(PHASE, "far").order(Order::Unordered)).await.expect("a run");
    let blind = Sensors { rgb: false, depth: false, audio: false, ..Sensors::default() };
    let mut play = client.play(&run, blind).await.expect("a stream");
    let mut episode = play.next_episode().await.expect("an answer").expect("an episode");
    for _ in 0..40 {
        episode.step(Action::TurnLeft).await.expect("a step");
    }
    let left = episode.time_left().bank;
    assert!(left >= Duration::from_millis(500), "40 steps of 200 ms on the proxy left {left:?} of a second");
    sleep(Duration::from_millis(1500)).await;
    episode.step(Action::TurnLeft).await.expect("it learns of the end");
    let end = episode.end().map(|end| end.reason);
    assert_eq!(end, Some(EndReason::TimeBudget), "an agent that thinks is charged wherever it is");
}
