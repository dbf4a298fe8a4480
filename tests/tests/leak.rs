//! Hidden facts stay hidden: every byte received by an agent or an anonymous visitor of an organiser-only
//! phase is searched for the split's hidden facts. The same search must succeed in a public phase.

use avln_arena::{data::DataFolder, setup};
use avln_client::{Action, Client, Episode, Error, Order, Run, RunOptions, Sensors};
use avln_dataset::CueSpec;
use avln_store::Visibility;
use avln_tests::{
    PASSED_M, PHASE, TestServer, TestSetup, Walker,
    clients::NO_SENSORS,
    clients::{MOVE_FORWARD, RawClient, SUBMIT},
    distance_m,
    hidden_facts::HiddenFacts,
    http,
    proxies::{self, RecordingProxy},
};
use serde_json::Value;
use std::{collections::BTreeSet, time::Duration};

const ORDERS: [Order; 2] = [Order::Ordered, Order::Unordered];
/// Facts of the split hidden from all users.
fn hidden(server: &TestServer) -> HiddenFacts {
    let data = DataFolder::open(server.folder.path()).expect("the data folder");
    let split = data.split(PHASE).expect("its split");
    let mut facts = HiddenFacts::default();
    facts.bytes("digest of the split", data.missions(PHASE).expect("its files").digest());
    for scene in &split.scenes {
        facts.bytes("name of a scene", &scene.name);
        facts.bytes("digest of a scene", &scene.digest);
    }
    for episode in &split.episodes {
        facts.bytes("id of an episode", &episode.id);
        facts.seed("seed of an episode", episode.seed);
        facts.place("start", episode.start.position.x, episode.start.position.z);
        for tour in [&episode.ordered, &episode.unordered] {
            facts.length("reference length", tour.length_m);
            for corner in &tour.path {
                facts.place("corner of a reference path", corner.x, corner.z);
            }
        }
        for goal in &episode.goals {
            let target = &goal.target;
            facts.place("corner of a target", target.bounds.min.x, target.bounds.min.z);
            facts.place("corner of a target", target.bounds.max.x, target.bounds.max.z);
            facts.place("source", target.source.x, target.source.z);
            facts.length("distance to a target", target.start_distance_m);
            for place in
                target.viewpoints.iter().map(|pose| pose.position).chain(target.region.iter().copied())
            {
                facts.place("success region", place.x, place.z);
            }
        }
    }
    facts
}

/// Target categories: those absent from all missions, and all of them in the form of a page.
fn categories(server: &TestServer) -> (HiddenFacts, HiddenFacts) {
    let split = DataFolder::open(server.folder.path()).and_then(|data| data.split(PHASE)).expect("its split");
    let (mut output, mut categories) = (String::new(), BTreeSet::new());
    for goal in split.episodes.iter().flat_map(|episode| &episode.goals) {
        let category = goal.target.category.clone();
        match &goal.cue {
            CueSpec::Category => output += &category,
            CueSpec::Description(description) => output += &description.text,
            CueSpec::Image(_) => {}
        }
        output.push(' ');
        categories.insert(category);
    }
    let (mut untold, mut shown) = (HiddenFacts::default(), HiddenFacts::default());
    // Pages call a cue that is a picture by this word.
    categories.remove("picture");
    for category in &categories {
        if category.len() >= 4 && !output.contains(category.as_str()) {
            untold.bytes(&format!("category {category}"), category);
        }
        shown.bytes(&format!("category {category}"), format!("\"{category}\""));
        shown.bytes(&format!("category {category}"), format!(">{category}<"));
    }
    assert!(shown.count() > 0);
    (untold, shown)
}

/// Follows the reference tour up to the first claimable target.
async fn claim_first_target(server: &TestServer, episode: &mut Episode<'_>, order: Order) {
    let data = DataFolder::open(server.folder.path()).expect("the data folder");
    let split = data.split(PHASE).expect("its split");
    let rules = setup::rules_of(PHASE, &data.missions(PHASE).expect("its files")).expect("its rules");
    // A hidden phase draws the order: only the database has the episode behind the handle.
    let store = avln_tests::store(server.folder.path()).await;
    let running = store.running_episodes().await.expect("the open episodes");
    store.close().await;
    let played = running.iter().find(|running| running.handle == episode.id()).expect("the open episode");
    let spec = split.episodes.iter().find(|spec| spec.id == played.episode).expect("its mission");
    let truth = spec.truth(order.to_string().parse().expect("an order"));
    let assets = split.scene(&spec.scene).expect("its scene").open(&rules).expect("it opens");
    let tour: Vec<_> = truth.reference_path.iter().map(|corner| [corner.x, corner.z]).collect();
    let start = [truth.start.position.x, truth.start.position.z];
    let mut walker = Walker::new(start, truth.start.heading_rad);
    let candidates = if order == Order::Ordered { &truth.targets[..1] } else { &truth.targets[..] };
    let mut passed = 0;
    while !episode.is_over() {
        let output = episode.observation().pose;
        let (place, _) = walker.locate(&output);
        let mut base = truth.start.position;
        (base.x, base.y, base.z) = (place[0], base.y + output.position()[1], place[1]);
        let reached = candidates.iter().any(|target| {
            let object = assets.scene.objects.iter().find(|object| object.id.0 == target.instance);
            let to_mesh_m =
                |eye: &_| object.map_or(f32::INFINITY, |object| assets.distance_to_mesh_m(eye, object.id));
            let sees = |eye: &_, half| object.is_some_and(|object| assets.sees(eye, object.id, half));
            target.distance_within_region(&base, &rules, to_mesh_m, sees).is_some()
        });
        if reached {
            episode.step(Action::Submit).await.expect("a legal step");
            return;
        }
        passed += usize::from(passed + 1 < tour.len() && distance_m(tour[passed], place) < PASSED_M);
        let action = walker.step(&output, &tour[passed..]);
        episode.step(action).await.expect("a legal step");
    }
}

/// Everything that an agent and a visitor received.
struct Received {
    /// With pictures and sound.
    noisy: Vec<u8>,
    /// Without.
    plain: Vec<u8>,
    /// All paths and answers.
    pages: Vec<(String, http::Answer)>,
    /// Metrics shown by the runs.
    metrics: Vec<(String, f64)>,
}

/// Plays an episode with all sensors, wrong Submits and rejected steps, then abandons it.
async fn fumble(proxy: &RecordingProxy, client: &Client, run: &Run) {
    let mut play = client.play(run, Sensors::square(64)).await.expect("a stream");
    let mut episode = play.next_episode().await.expect("a stream").expect("an episode");
    for action in
        [Action::MoveForward, Action::TurnLeft, Action::MoveForward, Action::Submit, Action::TurnRight]
    {
        episode.step(action).await.expect("a legal step");
    }
    for spoiler in [proxies::illegal_action(), proxies::wrong_step(100)] {
        proxy.corrupt(spoiler);
        let refused = episode.step(Action::MoveForward).await.expect_err("a spoiled step");
        assert!(matches!(refused, Error::Refused { .. }), "{refused}");
    }
    episode.abandon().await.expect("an answer");
}

/// Plays the remaining episodes without sensors: claims the first target, then a wrong place.
async fn claim(server: &TestServer, client: &Client, run: &Run, order: Order) -> Vec<(String, f64)> {
    let mut play = client.play(run, NO_SENSORS).await.expect("a stream");
    while let Some(mut episode) = play.next_episode().await.expect("a stream") {
        claim_first_target(server, &mut episode, order).await;
        while !episode.is_over() {
            let claim = episode.observation().claim();
            episode.step(claim).await.expect("a legal step");
        }
    }
    let summary = play.finish().await.expect("a summary");
    let status = client.run(&run.id).await.expect("the run");
    let metrics = summary.metrics.into_iter().chain(status.metrics).flatten();
    metrics.map(|metric| (metric.name, metric.value)).collect()
}

/// Plays both episodes with unary calls, abandons them and leaves the run, and calls health and reflection.
async fn go_unary(proxy: &RecordingProxy, client: &Client) -> String {
    let run = client.start_run(RunOptions::new(PHASE, "mirror")).await.expect("a run");
    let mut caller = RawClient::connect(&proxy.url(), &run.token).await;
    caller.play(&[MOVE_FORWARD, SUBMIT], false).await.expect("legal calls");
    caller.play(&[MOVE_FORWARD], true).await.expect("legal calls");
    caller.play(&[], false).await.expect_err("the run is over");
    let symbols = ["PlayService", "RunService", "InfoService"].map(|name| format!("avln.v1.{name}"));
    caller.inspect(&symbols.each_ref().map(String::as_str)).await.expect("health and reflection answer");
    run.id
}

/// Watches a run until it is over.
async fn watch(client: &Client, run: &str) {
    let mut states = client.watch(run).await.expect("a stream");
    while states.next().await.expect("a state").is_some() {}
}

/// Calls all other gRPC methods.
async fn ask_around(server: &TestServer, proxy: &RecordingProxy, client: &Client) {
    client.server_info().await.expect("an answer");
    client.phases().await.expect("an answer");
    client.quota().await.expect("an answer");
    client.runs().await.expect("an answer");
    client.whoami().await.expect("an answer");
    client.run("run_of_nobody").await.expect_err("no such run");
    client.start_run(RunOptions::new("finals", "curious")).await.expect_err("no such phase");
    Client::connect(proxy.url(), "wrong").await.expect_err("no such token");
    let own = Run::from_token(&server.token);
    client.play(&own, NO_SENSORS).await.expect_err("no token of a run");
}

/// Event streams for one run and for all runs.
async fn follow(server: &TestServer, run: &str) -> Vec<(String, http::Answer)> {
    const LONG_ENOUGH: Duration = Duration::from_millis(1500);
    let paths = ["/api/v1/runs/events".to_owned(), format!("/api/v1/runs/{run}/events")];
    let events = |path| http::get_events(server.servers.web, path, LONG_ENOUGH);
    let (all, single) = tokio::join!(events(&paths[0]), events(&paths[1]));
    paths.into_iter().zip([all, single]).collect()
}

async fn receive(server: &TestServer) -> Received {
    let (noisy, plain) =
        (RecordingProxy::open(server.servers.grpc).await, RecordingProxy::open(server.servers.grpc).await);
    let curious = Client::connect(noisy.url(), &server.token).await.expect("a connection");
    let sober = Client::connect(plain.url(), &server.token).await.expect("a connection");
    let (mut metrics, mut runs) = (Vec::new(), Vec::new());
    let mut followed = Vec::new();
    for order in ORDERS {
        let run = curious.start_run(RunOptions::new(PHASE, "curious").order(order)).await.expect("a run");
        fumble(&noisy, &curious, &run).await;
        followed.extend(follow(server, &run.id).await);
        let (shown, ()) = tokio::join!(claim(server, &sober, &run, order), watch(&sober, &run.id));
        metrics.extend(shown);
        runs.push(run.id);
    }
    runs.push(go_unary(&noisy, &curious).await);
    ask_around(server, &plain, &sober).await;
    let mut pages = Vec::new();
    for path in paths(&runs) {
        let answer = http::get(server.servers.web, &path).await;
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
        for page in ["/compare", "/api/v1/compare", "/api/v1/compare.csv"] {
            paths.extend(runs.iter().map(|other| format!("{page}?first={run}&second={other}")));
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

/// True if all paths of a page belong to replays.
fn is_of_replays(path: &str) -> bool {
    ["/eyes/", "/ears/", "/steps.csv", "/levels.csv"].iter().any(|part| path.contains(part))
}

/// True if `value` contains a number under a metric's name.
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

/// API paths with metrics.
fn paths_with_metrics(received: &Received) -> Vec<&str> {
    let described = |path: &str| path.ends_with("openapi.json");
    let shows = |(path, answer): &&(String, http::Answer)| {
        !described(path) && serde_json::from_str(&answer.body).is_ok_and(|value| shows_metric(&value))
    };
    received.pages.iter().filter(shows).map(|(path, _)| path.as_str()).collect()
}

/// The results that the pages and the gRPC server of a public phase show: the same runs in another house
/// have the same.
fn results(shown: &Received) -> HiddenFacts {
    const DECIMALS: usize = 5;
    let mut facts = HiddenFacts::default();
    for (name, value) in &shown.metrics {
        facts.share(name, *value);
    }
    for (path, answer) in shown.pages.iter().filter(|(path, _)| path.contains(".csv")) {
        let numbers = answer.body.split(|letter: char| !letter.is_ascii_digit() && letter != '.');
        let long = |number: &&str| number.split_once('.').is_some_and(|(_, rest)| rest.len() >= DECIMALS);
        for number in numbers.filter(long) {
            facts.bytes(&format!("{number} of {path}"), number);
        }
    }
    facts
}

fn holds(bytes: &[u8], word: &str) -> bool {
    bytes.windows(word.len()).any(|window| window == word.as_bytes())
}

async fn server(visible_to: Visibility) -> TestServer {
    // Both servers play the same split, so that results can be compared.
    TestServer::open(&TestSetup { visible_to, is_secret: true, ..TestSetup::default() }).await
}

#[tokio::test(flavor = "multi_thread")]
async fn nothing_hidden_reaches_an_agent_or_a_visitor() {
    let open = receive(&server(Visibility::Public).await).await;
    let results = results(&open);
    let server = server(Visibility::Organiser).await;
    let received = receive(&server).await;
    let facts = hidden(&server);
    let (untold, shown) = categories(&server);
    for (path, answer) in open.pages.iter().filter(|(path, _)| path.ends_with("/episodes.csv")) {
        assert!(!results.found_in(&answer.bytes).is_empty(), "{path} of a public phase shows results");
    }
    assert!(holds(&open.plain, "soft_spl"), "an agent of a public phase receives results");
    assert!(!holds(&received.plain, "soft_spl"), "an agent of a hidden phase receives no results");
    assert_eq!(results.found_in_noise(&received.noisy), BTreeSet::new(), "results, with pictures and sound");
    assert_eq!(results.found_in(&received.plain), BTreeSet::new(), "results, without pictures and sound");
    assert!(received.noisy.len() > 100_000 && received.plain.len() > 10_000, "bytes were recorded");
    assert!(holds(&received.plain, "ep_"), "messages can be read on the wire");
    assert_eq!(facts.found_in_noise(&received.noisy), BTreeSet::new(), "with pictures and sound");
    assert_eq!(facts.found_in(&received.plain), BTreeSet::new(), "without pictures and sound");
    assert_eq!(untold.found_in(&received.plain), BTreeSet::new(), "categories that no mission tells");
    for (path, answer) in &received.pages {
        assert!(answer.status < 500, "{path}: {}", answer.status);
        assert!(answer.status == 404 || !is_of_replays(path), "{path}: {}", answer.status);
        assert_eq!(facts.found_in(&answer.bytes), BTreeSet::new(), "{path}");
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
async fn public_scores_hide_replay_facts() {
    let setup = TestSetup {
        visible_to: Visibility::Public,
        replays_to: Some(Visibility::Organiser),
        ..TestSetup::default()
    };
    let server = TestServer::open(&setup).await;
    let received = receive(&server).await;
    let facts = hidden(&server);
    let (untold, shown) = categories(&server);
    assert!(!paths_with_metrics(&received).is_empty(), "scores are public");
    assert_eq!(facts.found_in_noise(&received.noisy), BTreeSet::new(), "with pictures and sound");
    assert_eq!(facts.found_in(&received.plain), BTreeSet::new(), "without pictures and sound");
    assert_eq!(untold.found_in(&received.plain), BTreeSet::new(), "categories that no mission tells");
    for (path, answer) in &received.pages {
        assert!(answer.status == 404 || !is_of_replays(path), "{path}: {}", answer.status);
        assert_eq!(facts.found_in(&answer.bytes), BTreeSet::new(), "{path}");
        assert_eq!(shown.found_in(&answer.bytes), BTreeSet::new(), "{path}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn search_finds_facts_of_public_phase() {
    let server = server(Visibility::Public).await;
    let received = receive(&server).await;
    let (_, shown) = categories(&server);
    let facts = hidden(&server);
    let found: BTreeSet<_> =
        received.pages.iter().flat_map(|(_, answer)| facts.found_in(&answer.bytes)).collect();
    for what in ["digest of the split", "name of a scene", "corner of a target", "reference length", "start"]
    {
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
