//! Hidden data stays hidden: everything that a split hides is looked for in every byte that an agent or an anonymous
//! visitor receives of a phase whose results are the organiser's alone. The same search finds it in a public phase.

use avln_arena::{data::DataFolder, register};
use avln_client::{Action, Client, Episode, Error, Order, Run, RunOptions, Sensors};
use avln_store::Visibility;
use avln_tests::scripted_run::NO_SENSORS;
use avln_tests::{
    PASSED_M, PHASE, TestServer, TestSetup, Walker,
    canary::Canaries,
    distance_m, http,
    raw::{MOVE_FORWARD, RawClient, SUBMIT},
    recording_proxy,
    recording_proxy::RecordingProxy,
};
use serde_json::Value;
use std::{collections::BTreeSet, time::Duration};

const ORDERS: [Order; 2] = [Order::Ordered, Order::Unordered];
/// What the split of a house hides from everybody.
fn hidden(house: &TestServer) -> Canaries {
    let split = DataFolder::open(house.folder.path()).and_then(|data| data.split(PHASE)).expect("its split");
    let mut canaries = Canaries::default();
    for scene in &split.scenes {
        canaries.bytes("name of a scene", &scene.name);
        canaries.bytes("digest of a scene", &scene.digest);
    }
    for episode in &split.episodes {
        canaries.bytes("id of an episode", &episode.id);
        canaries.seed("seed of an episode", episode.seed);
        canaries.place("start", episode.start.position.x, episode.start.position.z);
        for tour in [&episode.ordered, &episode.unordered] {
            canaries.length("reference length", tour.length_m);
            for corner in &tour.path {
                canaries.place("corner of a reference path", corner.x, corner.z);
            }
        }
        for goal in &episode.goals {
            let target = &goal.target;
            canaries.place("corner of a target", target.bounds.min.x, target.bounds.min.z);
            canaries.place("corner of a target", target.bounds.max.x, target.bounds.max.z);
            canaries.place("source", target.source.x, target.source.z);
            canaries.length("distance to a target", target.start_distance_m);
            for place in
                target.viewpoints.iter().map(|pose| pose.position).chain(target.region.iter().copied())
            {
                canaries.place("success region", place.x, place.z);
            }
        }
    }
    canaries
}

/// Categories of targets: those of which no mission tells, and all of them as pages would show them.
fn categories(house: &TestServer) -> (Canaries, Canaries) {
    let split = DataFolder::open(house.folder.path()).and_then(|data| data.split(PHASE)).expect("its split");
    let (mut told, mut categories) = (String::new(), BTreeSet::new());
    for goal in split.episodes.iter().flat_map(|episode| &episode.goals) {
        let category = goal.target.category.clone();
        match serde_json::to_value(&goal.cue).expect("cues can be written") {
            Value::String(_) => told += &category,
            cue => told += cue["description"].as_str().unwrap_or_default(),
        }
        told.push(' ');
        categories.insert(category);
    }
    let (mut untold, mut shown) = (Canaries::default(), Canaries::default());
    // Pages call a cue that is a picture by this word.
    categories.remove("picture");
    for category in &categories {
        if category.len() >= 4 && !told.contains(category.as_str()) {
            untold.bytes(&format!("category {category}"), category);
        }
        shown.bytes(&format!("category {category}"), format!("\"{category}\""));
        shown.bytes(&format!("category {category}"), format!(">{category}<"));
    }
    assert!(shown.count() > 0);
    (untold, shown)
}

/// Walks along the reference tour until the first target on it can be claimed.
async fn claim_first_target(house: &TestServer, episode: &mut Episode<'_>, order: Order) {
    let data = DataFolder::open(house.folder.path()).expect("the data folder");
    let split = data.split(PHASE).expect("its split");
    let rules = register::rules_of(PHASE, &data.missions(PHASE).expect("its files")).expect("its rules");
    let spec = &split.episodes[episode.ordinal() as usize - 1];
    let truth = spec.truth(order.to_string().parse().expect("an order"));
    let assets = split.scene(&spec.scene).expect("its scene").open(&rules).expect("it opens");
    let tour: Vec<_> = truth.reference_path.iter().map(|corner| [corner.x, corner.z]).collect();
    let start = [truth.start.position.x, truth.start.position.z];
    let mut walker = Walker::new(start, truth.start.heading_rad);
    let candidates = if order == Order::Ordered { &truth.targets[..1] } else { &truth.targets[..] };
    let mut passed = 0;
    while !episode.is_over() {
        let told = episode.observation().pose;
        let (place, _) = walker.locate(&told);
        let mut base = truth.start.position;
        (base.x, base.y, base.z) = (place[0], base.y + told.position[1], place[1]);
        let reached = candidates.iter().any(|target| {
            let object = assets.scene.objects.iter().find(|object| object.id.0 == target.instance);
            let sees = |eye: &_, half| object.is_some_and(|object| assets.sees(eye, object.id, half));
            target.distance_within_region(&base, &rules, sees).is_some()
        });
        if reached {
            episode.step(Action::Submit).await.expect("a legal step");
            return;
        }
        passed += usize::from(passed + 1 < tour.len() && distance_m(tour[passed], place) < PASSED_M);
        let action = walker.step(&told, &tour[passed..]);
        episode.step(action).await.expect("a legal step");
    }
}

/// Everything that an agent and a visitor received.
struct Received {
    /// With pictures and sound.
    noisy: Vec<u8>,
    /// Without.
    plain: Vec<u8>,
    /// Path and answer of every page.
    pages: Vec<(String, http::Answer)>,
    /// Names and values of the metrics that the runs showed.
    metrics: Vec<(String, f64)>,
}

/// Plays an episode with all senses: wrong claims, refused steps, and then gives it up.
async fn fumble(proxy: &RecordingProxy, arena: &Client, run: &Run) {
    let mut play = arena.play(run, Sensors::square(64)).await.expect("a stream");
    let mut episode = play.next_episode().await.expect("a stream").expect("an episode");
    for action in
        [Action::MoveForward, Action::TurnLeft, Action::MoveForward, Action::Submit, Action::TurnRight]
    {
        episode.step(action).await.expect("a legal step");
    }
    for spoiler in [recording_proxy::illegal_action(), recording_proxy::wrong_step(100)] {
        proxy.corrupt(spoiler);
        let refused = episode.step(Action::MoveForward).await.expect_err("a spoiled step");
        assert!(matches!(refused, Error::Refused { .. }), "{refused}");
    }
    episode.abandon().await.expect("an answer");
}

/// Plays the rest of a run without senses: the first target of each episode is claimed, then a wrong place.
async fn claim(house: &TestServer, arena: &Client, run: &Run, order: Order) -> Vec<(String, f64)> {
    let mut play = arena.play(run, NO_SENSORS).await.expect("a stream");
    while let Some(mut episode) = play.next_episode().await.expect("a stream") {
        claim_first_target(house, &mut episode, order).await;
        while !episode.is_over() {
            episode.step(Action::Submit).await.expect("a legal step");
        }
    }
    let summary = play.finish().await.expect("a summary");
    let status = arena.run(&run.id).await.expect("the run");
    let metrics = summary.metrics.into_iter().chain(status.metrics).flatten();
    metrics.map(|metric| (metric.name, metric.value)).collect()
}

/// Plays one step through the unary mirror, gives episode and run up, and asks for health and reflection.
async fn go_unary(proxy: &RecordingProxy, arena: &Client) -> String {
    let run = arena.start_run(RunOptions::new(PHASE, "mirror")).await.expect("a run");
    let mut caller = RawClient::connect(&proxy.url(), &run.token).await;
    caller.play(&[MOVE_FORWARD, SUBMIT], true).await.expect("legal calls");
    caller.play(&[MOVE_FORWARD], false).await.expect("legal calls");
    caller.play(&[], false).await.expect_err("the run is over");
    let symbols = ["PlayService", "RunService", "InfoService"].map(|name| format!("avln.v1.{name}"));
    caller.inspect(&symbols.each_ref().map(String::as_str)).await.expect("health and reflection answer");
    run.id
}

/// Watches a run until it is over.
async fn watch(arena: &Client, run: &str) {
    let mut states = arena.watch(run).await.expect("a stream");
    while states.next().await.expect("a state").is_some() {}
}

/// Asks for everything else that the agents' door answers.
async fn ask_around(house: &TestServer, proxy: &RecordingProxy, arena: &Client) {
    arena.server_info().await.expect("an answer");
    arena.phases().await.expect("an answer");
    arena.quota().await.expect("an answer");
    arena.runs().await.expect("an answer");
    arena.whoami().await.expect("an answer");
    arena.run("run_of_nobody").await.expect_err("no such run");
    arena.start_run(RunOptions::new("finals", "curious")).await.expect_err("no such phase");
    Client::connect(proxy.url(), "wrong").await.expect_err("no such token");
    let own = Run::from_token(&house.token);
    arena.play(&own, NO_SENSORS).await.expect_err("no token of a run");
}

/// What is told to somebody who follows a run that is under way, and all of them.
async fn follow(house: &TestServer, run: &str) -> Vec<(String, http::Answer)> {
    const LONG_ENOUGH: Duration = Duration::from_millis(1500);
    let mut told = Vec::new();
    for path in ["/api/v1/runs/events".to_owned(), format!("/api/v1/runs/{run}/events")] {
        let answer = http::get_events(house.doors.web, &path, LONG_ENOUGH).await;
        told.push((path, answer));
    }
    told
}

async fn receive(house: &TestServer) -> Received {
    let (noisy, plain) =
        (RecordingProxy::open(house.doors.grpc).await, RecordingProxy::open(house.doors.grpc).await);
    let curious = Client::connect(noisy.url(), &house.token).await.expect("the door is open");
    let sober = Client::connect(plain.url(), &house.token).await.expect("the door is open");
    let (mut metrics, mut runs) = (Vec::new(), Vec::new());
    let mut followed = Vec::new();
    for order in ORDERS {
        let run = curious.start_run(RunOptions::new(PHASE, "curious").order(order)).await.expect("a run");
        fumble(&noisy, &curious, &run).await;
        followed.extend(follow(house, &run.id).await);
        let (shown, ()) = tokio::join!(claim(house, &sober, &run, order), watch(&sober, &run.id));
        metrics.extend(shown);
        runs.push(run.id);
    }
    runs.push(go_unary(&noisy, &curious).await);
    ask_around(house, &plain, &sober).await;
    let mut pages = Vec::new();
    for path in paths(&runs) {
        let answer = http::get(house.doors.web, &path).await;
        pages.push((path, answer));
    }
    pages.extend(followed);
    Received { noisy: noisy.recorded(), plain: plain.recorded(), pages, metrics }
}

/// Every page and every way into the API that has to do with the runs.
fn paths(runs: &[String]) -> Vec<String> {
    let mut paths: Vec<String> = [
        "/",
        "/docs",
        "/leaderboard",
        "/runs",
        "/sign-in",
        "/me",
        "/organise",
        "/organise/runs",
        "/api/v1/openapi.json",
    ]
    .map(str::to_owned)
    .into();
    paths.extend(
        ["status", "phases", "runs", "runs.csv", "runs?phase=trial"].map(|path| format!("/api/v1/{path}")),
    );
    paths.extend([format!("/phases/{PHASE}"), format!("/phases/{PHASE}/scenes/0.svg")]);
    paths.extend(["", "/missions", "/missions.csv"].map(|rest| format!("/api/v1/phases/{PHASE}{rest}")));
    for order in ORDERS {
        paths.push(format!("/leaderboard/{PHASE}?order={order}"));
        paths.push(format!("/embed/{PHASE}?order={order}"));
        for kind in ["", ".json", ".csv"] {
            paths.push(format!("/api/v1/phases/{PHASE}/leaderboard{kind}?order={order}"));
        }
    }
    paths.push(format!("/leaderboard/{PHASE}?order=both"));
    for kind in ["", ".csv"] {
        paths.push(format!("/api/v1/phases/{PHASE}/leaderboards{kind}"));
    }
    for run in runs {
        for door in ["/compare", "/api/v1/compare", "/api/v1/compare.csv"] {
            paths.extend(runs.iter().map(|other| format!("{door}?first={run}&second={other}")));
        }
        paths.push(format!("/runs/{run}"));
        paths.push(format!("/runs/{run}/badge.svg"));
        paths.push(format!("/organise/runs/{run}"));
        for rest in ["", "/episodes", "/episodes.csv", "/events", "/log"] {
            paths.push(format!("/api/v1/runs/{run}{rest}"));
        }
        for ordinal in 0..=3 {
            paths.push(format!("/runs/{run}/episodes/{ordinal}"));
            paths.push(format!("/runs/{run}/episodes/{ordinal}?t=1&storey=1"));
            paths.push(format!("/runs/{run}/episodes/{ordinal}/eyes/1.png"));
            paths.push(format!("/runs/{run}/episodes/{ordinal}/eyes/1.png?sensor=depth"));
            paths.push(format!("/runs/{run}/episodes/{ordinal}?ears=on"));
            paths.push(format!("/runs/{run}/episodes/{ordinal}/ears/0-1.wav"));
            paths.push(format!("/api/v1/runs/{run}/episodes/{ordinal}/steps.csv"));
            paths.push(format!("/api/v1/runs/{run}/episodes/{ordinal}/levels.csv"));
            paths.push(format!("/api/v1/runs/{run}/episodes/{ordinal}"));
        }
    }
    paths
}

const METRICS: [&str; 6] = ["sr", "isr", "osr", "spl", "soft_spl", "sna"];

/// Whether there is nothing at a path but what a replay shows.
fn is_of_replays(path: &str) -> bool {
    ["/eyes/", "/ears/", "/steps.csv", "/levels.csv"].iter().any(|part| path.contains(part))
}

/// Whether a number stands below a metric's name anywhere in `value`.
fn shows_metric(value: &Value) -> bool {
    fn holds_number(value: &Value) -> bool {
        match value {
            Value::Number(_) => true,
            Value::Array(items) => items.iter().any(holds_number),
            Value::Object(fields) => fields.values().any(holds_number),
            _ => false,
        }
    }
    match value {
        Value::Array(items) => items.iter().any(shows_metric),
        Value::Object(fields) => fields.iter().any(|(name, value)| {
            (METRICS.contains(&name.as_str()) && holds_number(value)) || shows_metric(value)
        }),
        _ => false,
    }
}

/// Paths of the API below which a metric is shown.
fn paths_with_metrics(received: &Received) -> Vec<&str> {
    let described = |path: &str| path.ends_with("openapi.json");
    let shows = |(path, answer): &&(String, http::Answer)| {
        !described(path) && serde_json::from_str(&answer.body).is_ok_and(|value| shows_metric(&value))
    };
    received.pages.iter().filter(shows).map(|(path, _)| path.as_str()).collect()
}

/// The results that the pages and the agents' door of a house showed which shows them: the same runs in another house
/// have the same.
fn results(shown: &Received) -> Canaries {
    const DECIMALS: usize = 5;
    let mut canaries = Canaries::default();
    for (name, value) in &shown.metrics {
        canaries.share(name, *value);
    }
    for (path, answer) in shown.pages.iter().filter(|(path, _)| path.contains(".csv")) {
        let numbers = answer.body.split(|letter: char| !letter.is_ascii_digit() && letter != '.');
        let long = |number: &&str| number.split_once('.').is_some_and(|(_, rest)| rest.len() >= DECIMALS);
        for number in numbers.filter(long) {
            canaries.bytes(&format!("{number} of {path}"), number);
        }
    }
    canaries
}

fn holds(bytes: &[u8], word: &str) -> bool {
    bytes.windows(word.len()).any(|window| window == word.as_bytes())
}

async fn house(visible_to: Visibility) -> TestServer {
    TestServer::open(&TestSetup { visible_to, ..TestSetup::default() }).await
}

#[tokio::test(flavor = "multi_thread")]
async fn nothing_hidden_reaches_an_agent_or_a_visitor() {
    let open = receive(&house(Visibility::Public).await).await;
    let results = results(&open);
    let house = house(Visibility::Organiser).await;
    let received = receive(&house).await;
    let canaries = hidden(&house);
    let (untold, shown) = categories(&house);
    for (path, answer) in open.pages.iter().filter(|(path, _)| path.ends_with("/episodes.csv")) {
        assert!(!results.found_in(&answer.bytes).is_empty(), "{path} of a public phase shows results");
    }
    assert!(holds(&open.plain, "soft_spl"), "an agent of a public phase is told results");
    assert!(!holds(&received.plain, "soft_spl"), "an agent of a hidden phase is told none");
    assert_eq!(results.found_in_noise(&received.noisy), BTreeSet::new(), "results, with pictures and sound");
    assert_eq!(results.found_in(&received.plain), BTreeSet::new(), "results, without pictures and sound");
    assert!(received.noisy.len() > 100_000 && received.plain.len() > 10_000, "bytes were recorded");
    assert!(holds(&received.plain, "ep_"), "messages can be read on the wire");
    assert_eq!(canaries.found_in_noise(&received.noisy), BTreeSet::new(), "with pictures and sound");
    assert_eq!(canaries.found_in(&received.plain), BTreeSet::new(), "without pictures and sound");
    assert_eq!(untold.found_in(&received.plain), BTreeSet::new(), "categories that no mission tells");
    for (path, answer) in &received.pages {
        assert!(answer.status < 500, "{path}: {}", answer.status);
        assert!(answer.status == 404 || !is_of_replays(path), "{path}: {}", answer.status);
        assert_eq!(canaries.found_in(&answer.bytes), BTreeSet::new(), "{path}");
        assert_eq!(shown.found_in(&answer.bytes), BTreeSet::new(), "{path}");
        assert_eq!(results.found_in(&answer.bytes), BTreeSet::new(), "results on {path}");
    }
    assert_eq!(received.metrics, [], "metrics of a phase that shows none");
    assert_eq!(paths_with_metrics(&received), Vec::<&str>::new());
    for name in ["soft_spl", "isr"] {
        assert!(!holds(&received.noisy, "soft_spl") && !holds(&received.plain, name), "{name} on the wire");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn public_scores_do_not_show_what_hidden_replays_hide() {
    let plan = TestSetup {
        visible_to: Visibility::Public,
        replays_to: Some(Visibility::Organiser),
        ..TestSetup::default()
    };
    let house = TestServer::open(&plan).await;
    let received = receive(&house).await;
    let canaries = hidden(&house);
    let (untold, shown) = categories(&house);
    assert!(!paths_with_metrics(&received).is_empty(), "scores are public");
    assert_eq!(canaries.found_in_noise(&received.noisy), BTreeSet::new(), "with pictures and sound");
    assert_eq!(canaries.found_in(&received.plain), BTreeSet::new(), "without pictures and sound");
    assert_eq!(untold.found_in(&received.plain), BTreeSet::new(), "categories that no mission tells");
    for (path, answer) in &received.pages {
        assert!(answer.status == 404 || !is_of_replays(path), "{path}: {}", answer.status);
        assert_eq!(canaries.found_in(&answer.bytes), BTreeSet::new(), "{path}");
        assert_eq!(shown.found_in(&answer.bytes), BTreeSet::new(), "{path}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_same_search_finds_what_a_public_phase_shows() {
    let house = house(Visibility::Public).await;
    let received = receive(&house).await;
    let (_, shown) = categories(&house);
    let canaries = hidden(&house);
    let found: BTreeSet<_> =
        received.pages.iter().flat_map(|(_, answer)| canaries.found_in(&answer.bytes)).collect();
    for what in ["name of a scene", "corner of a target", "reference length", "start"] {
        assert!(found.iter().any(|found| found.starts_with(what)), "{what} in replays: {found:?}");
    }
    assert!(received.pages.iter().any(|(_, answer)| !shown.found_in(&answer.bytes).is_empty()), "categories");
    for replay in ["/eyes/1.png", "/eyes/1.png?sensor=depth", "/ears/0-1.wav", "/steps.csv", "/levels.csv"] {
        let shown =
            received.pages.iter().any(|(path, answer)| path.ends_with(replay) && answer.status == 200);
        assert!(shown, "{replay} of a public phase");
    }
    assert!(received.metrics.iter().any(|(name, value)| name == "isr" && *value > 0.0), "a Submit was right");
    assert!(paths_with_metrics(&received).len() > 2);
    assert!(holds(&received.plain, "soft_spl"));
    let run = received.pages.iter().find(|(path, _)| path.starts_with("/api/v1/runs/")).expect("a run");
    let time = &serde_json::from_str::<Value>(&run.1.body).expect("an object")["time"];
    for part in ["simulation_s", "thinking_s"] {
        assert!(time[part].as_f64().is_some_and(|seconds| seconds > 0.0), "{part} was measured: {time}");
    }
}
