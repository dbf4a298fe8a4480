//! Hidden data stays hidden: everything that a split hides is looked for in every byte that an agent or an anonymous
//! visitor receives of a phase whose results are the organiser's alone. The same search finds it in a public phase.

use avln_client::{Action, Arena, Episode, Error, Order, Pose, Run, RunOptions, Sensors};
use avln_server::{
    arena::{data::DataFolder, register},
    commands::phase::Who,
};
use avln_tests::{House, PHASE, Plan, http, tap, tap::Tap};
use serde_json::Value;
use std::collections::{BTreeSet, HashMap};

const BLIND: Sensors =
    Sensors { rgb: false, depth: false, audio: false, width: 64, height: 64, hfov_rad: 1.57 };
const ORDERS: [Order; 2] = [Order::Ordered, Order::Unordered];
/// Pictures and sound are noise, in which shorter patterns occur by chance.
const LONG_ENOUGH_FOR_NOISE: usize = 8;
/// Two coordinates of one place lie at most so many bytes apart in any message.
const NEAR_BYTES: usize = 16;

/// Something that nobody may receive.
#[derive(Debug)]
struct Canary {
    what: String,
    bytes: Vec<u8>,
    /// Bytes that must follow nearby for it to count.
    then: Vec<u8>,
}

#[derive(Default)]
struct Canaries(Vec<Canary>);

impl Canaries {
    fn bytes(&mut self, what: &str, bytes: impl AsRef<[u8]>) {
        let (what, bytes) = (what.to_owned(), bytes.as_ref().to_vec());
        assert!(bytes.len() >= 4, "{what} is long enough to be told from chance");
        self.0.push(Canary { what, bytes, then: vec![] });
    }

    /// Decimal text of a number, cut and not rounded. Left out are round numbers, which occur everywhere, and those
    /// that could as well be shares.
    fn text(&mut self, what: &str, value: f64) {
        let text = format!("{value:.6}");
        let cut = &text[..text.len() - 3];
        let decimals = &text[text.len() - 6..];
        if !decimals.ends_with("0000") && cut.len() >= 5 && value.abs() > 1.0 {
            self.bytes(&format!("{what} as text {cut}"), cut);
        }
    }

    fn length(&mut self, what: &str, metres: f64) {
        self.text(what, metres);
        self.bytes(&format!("{what} as f64"), metres.to_le_bytes());
        self.bytes(&format!("{what} as f32"), (metres as f32).to_le_bytes());
    }

    fn seed(&mut self, what: &str, seed: u64) {
        let mut varint = Vec::new();
        let mut rest = seed;
        while rest > 0 {
            varint.push((rest & 0x7f) as u8 | if rest > 0x7f { 0x80 } else { 0 });
            rest >>= 7;
        }
        if seed > u64::from(u32::MAX) {
            self.bytes(&format!("{what} as text"), seed.to_string());
            self.bytes(&format!("{what} as u64"), seed.to_le_bytes());
            self.bytes(&format!("{what} as varint"), varint);
        }
    }

    fn place(&mut self, what: &str, x: f32, z: f32) {
        self.text(&format!("{what} x"), x.into());
        self.text(&format!("{what} z"), z.into());
        let (single, double) = ([x, z].map(f32::to_le_bytes), [x, z].map(|m| f64::from(m).to_le_bytes()));
        let pair = |bytes: &[u8], then: &[u8], kind| Canary {
            what: format!("{what} as {kind}"),
            bytes: bytes.to_vec(),
            then: then.to_vec(),
        };
        self.0.push(pair(&single[0], &single[1], "f32"));
        self.0.push(pair(&double[0], &double[1], "f64"));
    }

    /// What of this `bytes` hold.
    fn found_in(&self, bytes: &[u8]) -> BTreeSet<String> {
        let mut by_start = HashMap::<[u8; 4], Vec<&Canary>>::new();
        for canary in &self.0 {
            by_start.entry(canary.bytes[..4].try_into().expect("four bytes")).or_default().push(canary);
        }
        let mut found = BTreeSet::new();
        for (at, start) in bytes.windows(4).enumerate() {
            let Some(canaries) = start.first_chunk().and_then(|start| by_start.get(start)) else { continue };
            for canary in canaries.iter().filter(|canary| canary.is_at(&bytes[at..])) {
                found.insert(canary.what.clone());
            }
        }
        found
    }

    /// The same among noise.
    fn found_in_noise(&self, bytes: &[u8]) -> BTreeSet<String> {
        let mut found = self.found_in(bytes);
        let long = |c: &Canary| c.bytes.len() + c.then.len() >= LONG_ENOUGH_FOR_NOISE;
        let long: BTreeSet<_> = self.0.iter().filter(|c| long(c)).map(|c| &c.what).collect();
        found.retain(|what| long.contains(what));
        found
    }
}

impl Canary {
    fn is_at(&self, bytes: &[u8]) -> bool {
        let Some(rest) = bytes.strip_prefix(&self.bytes[..]) else { return false };
        let near = &rest[..rest.len().min(NEAR_BYTES)];
        self.then.is_empty() || near.windows(self.then.len()).any(|window| window == self.then)
    }
}

/// What the split of a house hides from everybody.
fn hidden(house: &House) -> Canaries {
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
fn categories(house: &House) -> (Canaries, Canaries) {
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
    assert!(!shown.0.is_empty());
    (untold, shown)
}

/// Walks along the reference tour until the first target on it can be claimed.
async fn claim_first_target(house: &House, episode: &mut Episode<'_>, order: Order) {
    let split = DataFolder::open(house.folder.path()).and_then(|data| data.split(PHASE)).expect("its split");
    let rules = register::rules_of(&split).expect("its rules");
    let spec = &split.episodes[episode.ordinal() as usize - 1];
    let truth = spec.truth(order.to_string().parse().expect("an order"));
    let assets = split.scene(&spec.scene).expect("its scene").open(&rules).expect("it opens");
    let mut corners: Vec<_> = truth.reference_path.iter().rev().map(|corner| [corner.x, corner.z]).collect();
    let candidates = if order == Order::Ordered { &truth.targets[..1] } else { &truth.targets[..] };
    while !episode.is_over() {
        let told = episode.observation().pose;
        let (place, heading_rad) =
            in_world([truth.start.position.x, truth.start.position.z], truth.start.heading_rad, &told);
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
        episode.step(toward(&mut corners, place, heading_rad)).await.expect("a legal step");
    }
}

/// The told pose in the world: x and z, metres, and heading, radians.
fn in_world(start: [f32; 2], start_heading_rad: f32, told: &Pose) -> ([f32; 2], f32) {
    let (sin, cos) = start_heading_rad.sin_cos();
    let [x, _, z] = told.position;
    ([start[0] + x * cos + z * sin, start[1] - x * sin + z * cos], start_heading_rad + told.heading_rad)
}

/// The next move to the last of `corners`; those that are reached are taken out.
fn toward(corners: &mut Vec<[f32; 2]>, place: [f32; 2], heading_rad: f32) -> Action {
    use std::f32::consts::{PI, TAU};
    const REACHED_M: f32 = 0.2;
    const HALF_TURN_RAD: f32 = PI / 12.0 + 1e-3;
    let offset = |corner: &[f32; 2]| [place[0] - corner[0], place[1] - corner[1]];
    while let Some([x, z]) = corners.last().map(offset)
        && x.hypot(z) < REACHED_M
    {
        corners.pop();
    }
    let Some([x, z]) = corners.last().map(offset) else { return Action::Stop };
    match (x.atan2(z) - heading_rad + PI).rem_euclid(TAU) - PI {
        turn_rad if turn_rad > HALF_TURN_RAD => Action::TurnLeft,
        turn_rad if turn_rad < -HALF_TURN_RAD => Action::TurnRight,
        _ => Action::MoveForward,
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
async fn fumble(tap: &Tap, arena: &Arena, run: &Run) {
    let mut play = arena.play(run, Sensors::square(64)).await.expect("a stream");
    let mut episode = play.next_episode().await.expect("a stream").expect("an episode");
    for action in
        [Action::MoveForward, Action::TurnLeft, Action::MoveForward, Action::Submit, Action::TurnRight]
    {
        episode.step(action).await.expect("a legal step");
    }
    for spoiler in [tap::illegal_action(), tap::wrong_step(100)] {
        tap.spoil(spoiler);
        let refused = episode.step(Action::MoveForward).await.expect_err("a spoiled step");
        assert!(matches!(refused, Error::Refused { .. }), "{refused}");
    }
    episode.abandon().await.expect("an answer");
}

/// Plays the rest of a run without senses: the first target of each episode is claimed, then a wrong place.
async fn claim(house: &House, arena: &Arena, run: &Run, order: Order) -> Vec<(String, f64)> {
    let mut play = arena.play(run, BLIND).await.expect("a stream");
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

/// Asks for everything else that the agents' door answers.
async fn ask_around(house: &House, tap: &Tap, arena: &Arena) {
    arena.server_info().await.expect("an answer");
    arena.phases().await.expect("an answer");
    arena.quota().await.expect("an answer");
    arena.runs().await.expect("an answer");
    arena.run("run_of_nobody").await.expect_err("no such run");
    arena.start_run(RunOptions::new("finals", "curious")).await.expect_err("no such phase");
    Arena::connect(tap.url(), "wrong").await.expect_err("no such token");
    let own = Run::from_token(&house.token);
    arena.play(&own, BLIND).await.expect_err("no token of a run");
}

async fn receive(house: &House) -> Received {
    let (noisy, plain) = (Tap::open(house.doors.grpc).await, Tap::open(house.doors.grpc).await);
    let curious = Arena::connect(noisy.url(), &house.token).await.expect("the door is open");
    let sober = Arena::connect(plain.url(), &house.token).await.expect("the door is open");
    let (mut metrics, mut runs) = (Vec::new(), Vec::new());
    for order in ORDERS {
        let run = curious.start_run(RunOptions::new(PHASE, "curious").order(order)).await.expect("a run");
        fumble(&noisy, &curious, &run).await;
        metrics.extend(claim(house, &sober, &run, order).await);
        runs.push(run.id);
    }
    ask_around(house, &plain, &sober).await;
    let mut pages = Vec::new();
    for path in paths(&runs) {
        let answer = http::get(house.doors.web, &path).await;
        pages.push((path, answer));
    }
    Received { noisy: noisy.heard(), plain: plain.heard(), pages, metrics }
}

/// Every page and every way into the API that has to do with the runs.
fn paths(runs: &[String]) -> Vec<String> {
    let mut paths: Vec<String> =
        ["/", "/docs", "/leaderboard", "/runs", "/api/v1/openapi.json"].map(str::to_owned).into();
    paths.extend(["status", "phases", "runs", "runs?phase=trial"].map(|path| format!("/api/v1/{path}")));
    paths.push(format!("/api/v1/phases/{PHASE}"));
    for order in ORDERS {
        paths.push(format!("/leaderboard/{PHASE}?order={order}"));
        for kind in ["", ".json", ".csv"] {
            paths.push(format!("/api/v1/phases/{PHASE}/leaderboard{kind}?order={order}"));
        }
    }
    for run in runs {
        paths.push(format!("/runs/{run}"));
        for rest in ["", "/episodes", "/episodes.csv"] {
            paths.push(format!("/api/v1/runs/{run}{rest}"));
        }
        for ordinal in 0..=3 {
            paths.push(format!("/runs/{run}/episodes/{ordinal}"));
            paths.push(format!("/api/v1/runs/{run}/episodes/{ordinal}"));
        }
    }
    paths
}

const METRICS: [&str; 6] = ["sr", "isr", "osr", "spl", "soft_spl", "sna"];

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

fn holds(bytes: &[u8], word: &str) -> bool {
    bytes.windows(word.len()).any(|window| window == word.as_bytes())
}

async fn house(visible_to: Who) -> House {
    House::open(&Plan { visible_to, ..Plan::default() }).await
}

#[tokio::test(flavor = "multi_thread")]
async fn nothing_hidden_reaches_an_agent_or_a_visitor() {
    let house = house(Who::Organiser).await;
    let received = receive(&house).await;
    let canaries = hidden(&house);
    let (untold, shown) = categories(&house);
    assert!(received.noisy.len() > 100_000 && received.plain.len() > 10_000, "bytes were recorded");
    assert!(holds(&received.plain, "ep_"), "messages can be read on the wire");
    assert_eq!(canaries.found_in_noise(&received.noisy), BTreeSet::new(), "with pictures and sound");
    assert_eq!(canaries.found_in(&received.plain), BTreeSet::new(), "without pictures and sound");
    assert_eq!(untold.found_in(&received.plain), BTreeSet::new(), "categories that no mission tells");
    for (path, answer) in &received.pages {
        assert!(answer.status < 500, "{path}: {}", answer.status);
        assert_eq!(canaries.found_in(&answer.bytes), BTreeSet::new(), "{path}");
        assert_eq!(shown.found_in(&answer.bytes), BTreeSet::new(), "{path}");
    }
    assert_eq!(received.metrics, [], "metrics of a phase that shows none");
    assert_eq!(paths_with_metrics(&received), Vec::<&str>::new());
    for name in ["soft_spl", "isr"] {
        assert!(!holds(&received.noisy, "soft_spl") && !holds(&received.plain, name), "{name} on the wire");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn public_scores_do_not_show_what_hidden_replays_hide() {
    let plan = Plan { visible_to: Who::Public, replays_to: Some(Who::Organiser), ..Plan::default() };
    let house = House::open(&plan).await;
    let received = receive(&house).await;
    let canaries = hidden(&house);
    let (untold, shown) = categories(&house);
    assert!(!paths_with_metrics(&received).is_empty(), "scores are public");
    assert_eq!(canaries.found_in_noise(&received.noisy), BTreeSet::new(), "with pictures and sound");
    assert_eq!(canaries.found_in(&received.plain), BTreeSet::new(), "without pictures and sound");
    assert_eq!(untold.found_in(&received.plain), BTreeSet::new(), "categories that no mission tells");
    for (path, answer) in &received.pages {
        assert_eq!(canaries.found_in(&answer.bytes), BTreeSet::new(), "{path}");
        assert_eq!(shown.found_in(&answer.bytes), BTreeSet::new(), "{path}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_same_search_finds_what_a_public_phase_shows() {
    let house = house(Who::Public).await;
    let received = receive(&house).await;
    let (_, shown) = categories(&house);
    let canaries = hidden(&house);
    let found: BTreeSet<_> =
        received.pages.iter().flat_map(|(_, answer)| canaries.found_in(&answer.bytes)).collect();
    for what in ["name of a scene", "corner of a target", "reference length", "start"] {
        assert!(found.iter().any(|found| found.starts_with(what)), "{what} in replays: {found:?}");
    }
    assert!(received.pages.iter().any(|(_, answer)| !shown.found_in(&answer.bytes).is_empty()), "categories");
    assert!(received.metrics.iter().any(|(name, value)| name == "isr" && *value > 0.0), "a Submit was right");
    assert!(paths_with_metrics(&received).len() > 2);
    assert!(holds(&received.plain, "soft_spl"));
}

#[test]
fn the_search_knows_every_form_of_a_secret() {
    let mut canaries = Canaries::default();
    canaries.place("place", 1.234_567, -9.876_543);
    canaries.seed("seed", 0x0123_4567_89ab_cdef);
    let near = [&1.234_567_f32.to_le_bytes()[..], &[0x1d], &(-9.876_543_f32).to_le_bytes()].concat();
    assert_eq!(canaries.found_in(&near).into_iter().collect::<Vec<_>>(), ["place as f32"]);
    let far = [&1.234_567_f32.to_le_bytes()[..], &[0; 20], &(-9.876_543_f32).to_le_bytes()].concat();
    assert!(canaries.found_in(&far).is_empty());
    assert_eq!(
        canaries.found_in(b"at -9.87654 m").into_iter().collect::<Vec<_>>(),
        ["place z as text -9.876"]
    );
    assert_eq!(canaries.found_in(b"81985529216486895").into_iter().collect::<Vec<_>>(), ["seed as text"]);
    let varint = [0xef, 0x9b, 0xaf, 0xcd, 0xf8, 0xac, 0xd1, 0x91, 0x01];
    assert_eq!(canaries.found_in(&varint).into_iter().collect::<Vec<_>>(), ["seed as varint"]);
}
