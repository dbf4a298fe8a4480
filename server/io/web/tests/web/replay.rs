use crate::{Arena, TOKEN};
use avln_episode::Sensors;
use avln_store::{Scene, SceneMap};
use avln_web::{
    RenderError, RenderedSound, RenderedView, ReplayRenderer, SoundRequest, ViewRequest, async_trait,
};
use axum::{
    body::Body,
    http::{HeaderMap, HeaderValue, Request, StatusCode, header},
};
use std::sync::{Arc, Mutex};
use tokio::sync::Semaphore;

const EPISODE: &str = "/runs/run_formula/episodes/1";

/// Returns the text of the element that the script updates under `name`.
fn shown<'a>(page: &'a str, name: &str) -> &'a str {
    let mark = format!("data-tell=\"{name}\">");
    let rest = page.split_once(&mark).unwrap_or_else(|| panic!("{name} in {page}")).1;
    rest.split('<').next().unwrap_or_default()
}

#[tokio::test]
async fn steps_need_no_script() {
    let arena = Arena::new().await;
    let end = arena.get(EPISODE).await.body;
    assert_eq!(
        [shown(&end, "step"), shown(&end, "action"), shown(&end, "submits-left")],
        ["6", "Submit", "0"]
    );
    assert!(!end.contains(" later"), "no later steps at the end");
    let third = arena.get(&format!("{EPISODE}?t=3")).await.body;
    assert_eq!([shown(&third, "step"), shown(&third, "action")], ["3", "MoveForward, collided"]);
    assert_eq!([shown(&third, "sounding"), shown(&third, "bearing")], ["goal 1", "104° to the right"]);
    assert_eq!([shown(&third, "walked"), shown(&third, "actions-left")], ["0.75", "997"]);
    assert_eq!([shown(&third, "distance-0"), shown(&third, "submits-left")], ["0.50", "1"]);
    assert!(third.contains("translate(0.5 1.25) rotate(0)"), "the body: {third}");
    assert!(third.contains("<g class=\"submit right later\""), "later Submits are faint");
    assert!(third.contains("<g class=\"source sounds\" data-source=\"goal 1\""), "{third}");
    assert!(third.contains("<g class=\"source\" data-source=\"goal 2\""), "{third}");
    for link in [format!("href=\"{EPISODE}?t=2\""), format!("href=\"{EPISODE}?t=4\"")] {
        assert!(third.contains(&link), "{link} in {third}");
    }
    let start = arena.get(&format!("{EPISODE}?t=0")).await.body;
    assert_eq!([shown(&start, "action"), shown(&start, "walked")], ["none yet", "0.00"]);
    let beyond = arena.get(&format!("{EPISODE}?t=4000000000")).await.body;
    assert_eq!(shown(&beyond, "step"), "6");
    for wrong in ["t=-1", "t=x", "t=4294967296", "step=1"] {
        assert_eq!(arena.get(&format!("{EPISODE}?{wrong}")).await.status, StatusCode::BAD_REQUEST, "{wrong}");
    }
}

#[tokio::test]
async fn events_are_ordered_and_link_to_steps() {
    let arena = Arena::new().await;
    let page = arena.get(&format!("{EPISODE}?t=5")).await.body;
    let place = |words: &str| page.find(words).unwrap_or_else(|| panic!("{words} in {page}"));
    let order = ["</span> Submit, right: goal 1 (chair) found", "</span> Submit, wrong", "End: last submit"];
    let places: Vec<usize> = ["Start</td>", "Goal 1 sounds"].into_iter().chain(order).map(place).collect();
    assert!(places.is_sorted(), "{places:?}");
    assert!(page.contains("<tr data-event=\"5\" aria-current=\"true\">"), "{page}");
    assert_eq!(page.matches("aria-current=\"true\"").count(), 1);
    assert!(page.contains(&format!("href=\"{EPISODE}?t=1\">1</a>")), "{page}");
}

#[tokio::test]
async fn plots_have_descriptions_and_a_cursor() {
    let arena = Arena::new().await;
    let page = arena.get(&format!("{EPISODE}?t=3")).await.body;
    assert_eq!(page.matches("<svg class=\"curves\"").count(), 4);
    assert_eq!(page.matches("transform=\"translate(260.0 0)\"/></svg>").count(), 4, "half way: {page}");
    assert!(
        page.contains("Nearest to each target: goal 1 0.50 m at step 0, goal 2 0.50 m at step 0."),
        "{page}"
    );
    assert!(page.contains("Sounding goals: goal 1 in 6 steps, goal 2 in 0 steps."), "{page}");
    let left = "At the end, 994 of 1000 actions (4.1 min of simulated time) and 0 of 1 Submit remained.";
    assert!(page.contains(left), "{page}");
    assert!(page.contains("Path length 1.00 m, reference tour 1.00 m."), "{page}");
}

#[tokio::test]
async fn the_script_gets_the_same_steps() {
    let arena = Arena::new().await;
    let page = arena.get(EPISODE).await;
    let columns = page.body.split_once("data-columns=\"").expect("columns").1;
    let columns = columns.split('"').next().unwrap_or_default().replace("&#34;", "\"");
    let columns: serde_json::Value = serde_json::from_str(&columns).expect("JSON");
    assert_eq!(columns["y"], serde_json::json!([2.0, 1.75, 1.5, 1.25, 1.0, 1.0, 1.0]));
    assert_eq!(columns["action"]["words"][2], "MoveForward, collided");
    assert_eq!(columns["action"]["at"], serde_json::json!([0, 1, 1, 2, 1, 3, 3]));
    let policy = page.header(header::CONTENT_SECURITY_POLICY);
    assert!(policy.contains("script-src 'self'") && !policy.contains("unsafe"), "{policy}");
    let script = arena.get("/assets/replay.js").await;
    assert_eq!(script.header(header::CONTENT_TYPE), "text/javascript; charset=utf-8");
    for banned in ["http:", "https:", "fetch(", "eval(", "innerHTML", "document.write"] {
        assert!(!script.body.contains(banned), "{banned}");
    }
}

#[tokio::test]
async fn step_tables_follow_the_visibility_of_replays() {
    let arena = Arena::new().await;
    let table = arena.get("/api/v1/runs/run_formula/episodes/1/steps.csv").await;
    let lines: Vec<&str> = table.body.lines().collect();
    assert_eq!(lines.len(), 8);
    assert!(
        lines[0].starts_with("step,action,x_m,y_m,z_m") && lines[0].ends_with("distance_1_m,distance_2_m")
    );
    assert_eq!(lines[1], "0,,0.5,0,2,0,false,,,0,1000,1,0.5,0.5");
    assert!(lines[4].starts_with("3,MoveForward,0.5,0,1.25,0,true,1,-1.81"), "{}", lines[4]);
    for hidden in
        ["/api/v1/runs/run_sealed/episodes/0/steps.csv", "/api/v1/runs/run_begun/episodes/1/steps.csv"]
    {
        for answer in [arena.get(hidden).await, arena.get_as(hidden, TOKEN).await] {
            assert_eq!(answer.status, StatusCode::NOT_FOUND, "{hidden}: {}", answer.body);
            assert!(!answer.body.contains("canary"), "{}", answer.body);
        }
    }
    let hidden = arena.get_as("/runs/run_sealed/episodes/0?t=3", TOKEN).await;
    assert_eq!(hidden.status, StatusCode::OK);
    assert!(!hidden.body.contains("id=\"replay\"") && !hidden.body.contains("canary"), "{}", hidden.body);
}

#[tokio::test]
async fn storeys_are_tabs() {
    let arena = Arena::new().await;
    let one = arena.get(EPISODE).await.body;
    assert!(!one.contains("data-storey-tab") && !one.contains("class=\"floor away\""), "{one}");
    let floor = |y: f32| vec![[0.0, y, 0.0], [4.0, y, 0.0], [0.0, y, 4.25]];
    let map = SceneMap { min: [0.0; 3], max: [4.0, 6.0, 4.25], polygons: vec![floor(0.0), floor(3.0)] };
    let scene = Scene { name: "canary-scene".to_owned(), digest: "s".to_owned(), map };
    arena.store.upsert_scene(&scene).await.expect("a scene");
    let below = arena.get(&format!("{EPISODE}?t=3")).await.body;
    assert!(below.contains("data-storey-tab=\"0\" aria-current=\"true\""), "{below}");
    assert!(below.contains("class=\"floor away\" data-storey=\"1\""), "{below}");
    assert!(below.contains(&format!("href=\"{EPISODE}?t=3&#38;storey=2\" data-storey-tab=\"1\"")), "{below}");
    let above = arena.get(&format!("{EPISODE}?t=3&storey=2")).await.body;
    assert!(above.contains("data-storey-tab=\"1\" aria-current=\"true\""), "{above}");
    assert!(above.contains("class=\"floor away\" data-storey=\"0\""), "{above}");
    assert!(
        above.contains(&format!("href=\"{EPISODE}?t=4&#38;storey=2\"")),
        "links keep the storey: {above}"
    );
    let nowhere = arena.get(&format!("{EPISODE}?t=3&storey=9")).await.body;
    assert!(nowhere.contains("data-storey-tab=\"0\" aria-current=\"true\""), "{nowhere}");
}

/// Samples per step of the fake sound.
const STEP: usize = 4000;

/// A renderer of renderer views and of a rising tone at the left ear. Each rendering needs a permit; all requests are recorded.
#[derive(Debug)]
pub(crate) struct FakeRenderer {
    views: Mutex<Vec<ViewRequest>>,
    sounds: Mutex<Vec<SoundRequest>>,
    permits: Arc<Semaphore>,
}

impl FakeRenderer {
    pub(crate) fn new(permits: usize) -> Arc<Self> {
        let permits = Arc::new(Semaphore::new(permits));
        Arc::new(Self { views: Mutex::default(), sounds: Mutex::default(), permits })
    }

    fn sounds(&self) -> Vec<SoundRequest> {
        self.sounds.lock().expect("no panic").clone()
    }

    fn views(&self) -> Vec<ViewRequest> {
        self.views.lock().expect("no panic").clone()
    }
}

#[async_trait]
impl ReplayRenderer for FakeRenderer {
    async fn render_view(&self, request: ViewRequest) -> Result<RenderedView, RenderError> {
        let pixels = (request.width * request.height) as usize;
        self.views.lock().expect("no panic").push(request);
        let permit = self.permits.acquire().await.map_err(|_| RenderError("a secret reason".to_owned()))?;
        permit.forget();
        Ok(RenderedView { rgb: vec![128; 3 * pixels], depth_m: vec![5.0; pixels], depth_max_m: 10.0 })
    }

    async fn render_sound(&self, request: SoundRequest) -> Result<RenderedSound, RenderError> {
        self.sounds.lock().expect("no panic").push(request);
        let permit = self.permits.acquire().await.map_err(|_| RenderError("a secret reason".to_owned()))?;
        permit.forget();
        Ok(RenderedSound { samples_per_step: STEP, left: tone(), right: vec![0.0; 7 * STEP] })
    }
}

/// Returns seven steps of constant pressure at 0 dB, 20 dB and so on.
fn tone() -> Vec<f32> {
    (0..7).flat_map(|step| vec![20.5e-6 * 10_f32.powi(step); STEP]).collect()
}

const PICTURE: &str = "/runs/run_formula/episodes/1/eyes/3.png";

#[tokio::test]
async fn pictures_are_rendered_once_from_the_recorded_pose() {
    let renderer = FakeRenderer::new(100);
    let arena = Arena::with_renderer(Some(renderer.clone())).await;
    let page = arena.get("/runs/run_formula/episodes/1?t=3").await.body;
    assert!(page.contains(&format!("src=\"{PICTURE}\"")), "{page}");
    assert!(page.contains(&format!("src=\"{PICTURE}?sensor=depth\"")), "{page}");
    for address in [PICTURE, &format!("{PICTURE}?sensor=rgb"), &format!("{PICTURE}?sensor=depth")] {
        let picture = arena.get(address).await;
        assert_eq!((picture.status, picture.header(header::CONTENT_TYPE)), (StatusCode::OK, "image/png"));
        assert!(picture.body.contains("PNG"), "{address}");
    }
    let views = renderer.views();
    assert_eq!(views.len(), 1, "one rendering for both sensors");
    assert_eq!((views[0].phase.as_str(), views[0].scene.as_str()), ("open", "canary-scene"));
    assert_eq!((views[0].pose.position.z, views[0].width, views[0].height), (1.25, 320, 320));
}

#[tokio::test]
async fn hidden_or_missing_steps_have_no_picture() {
    let renderer = FakeRenderer::new(100);
    let arena = Arena::with_renderer(Some(renderer.clone())).await;
    for address in [
        "/runs/run_sealed/episodes/0/eyes/0.png",
        "/runs/run_begun/episodes/1/eyes/0.png",
        "/runs/run_formula/episodes/1/eyes/7.png",
        "/runs/run_formula/episodes/1/eyes/-1.png",
        "/runs/run_formula/episodes/1/eyes/3",
        "/runs/nowhere/episodes/1/eyes/3.png",
    ] {
        for answer in [arena.get(address).await, arena.get_as(address, TOKEN).await] {
            assert_eq!(answer.status, StatusCode::NOT_FOUND, "{address}");
        }
    }
    assert_eq!(arena.get(&format!("{PICTURE}?sensor=instances")).await.status, StatusCode::BAD_REQUEST);
    assert_eq!(renderer.views(), []);
    let plain = Arena::new().await;
    assert_eq!(plain.get(PICTURE).await.status, StatusCode::NOT_FOUND);
    assert!(!plain.get("/runs/run_formula/episodes/1").await.body.contains("/eyes/"));
}

#[tokio::test]
async fn the_render_queue_is_limited() {
    let renderer = FakeRenderer::new(0);
    let arena = Arena::with_renderer(Some(renderer.clone())).await;
    let addresses: Vec<String> = ["run_formula", "run_rude"]
        .iter()
        .flat_map(|run| (0..7).map(move |step| format!("/runs/{run}/episodes/0/eyes/{step}.png")))
        .collect();
    let all = async {
        let mut asked = tokio::task::JoinSet::new();
        for address in addresses {
            let arena = arena.clone();
            asked.spawn(async move { arena.get(&address).await });
        }
        asked.join_all().await
    };
    let open = async {
        while renderer.views().is_empty() {
            tokio::task::yield_now().await;
        }
        tokio::time::sleep(std::time::Duration::from_millis(200)).await;
        assert_eq!(renderer.views().len(), 1, "one rendering at a time");
        renderer.permits.add_permits(100);
    };
    let (answers, ()) = tokio::join!(all, open);
    let refused: Vec<_> = answers.iter().filter(|a| a.status == StatusCode::TOO_MANY_REQUESTS).collect();
    assert_eq!(answers.iter().filter(|a| a.status == StatusCode::OK).count(), 8);
    assert_eq!(refused.len(), 6);
    assert_eq!(refused[0].header(header::RETRY_AFTER), "5");
    assert_eq!(arena.get(PICTURE).await.status, StatusCode::OK, "the queue is free again");
}

#[tokio::test]
async fn failed_renderings_do_not_reveal_their_reason() {
    let renderer = FakeRenderer::new(0);
    renderer.permits.close();
    let arena = Arena::with_renderer(Some(renderer)).await;
    let failed = arena.get(PICTURE).await;
    assert_eq!(failed.status, StatusCode::INTERNAL_SERVER_ERROR);
    assert!(!failed.body.contains("secret"), "{}", failed.body);
    assert_eq!(arena.get(PICTURE).await.status, StatusCode::INTERNAL_SERVER_ERROR);
}

const SOUND: &str = "/runs/run_formula/episodes/1/ears/2-3.wav";
const REPLAY: &str = "/runs/run_formula/episodes/1?t=3";

/// Returns an arena with a renderer, where the agents requested sound.
async fn arena_with_sound(renderer: Arc<FakeRenderer>) -> Arena {
    let arena = Arena::with_renderer(Some(renderer)).await;
    for run in ["run_formula", "run_sealed", "run_begun"] {
        arena.store.set_sensors(run, &Sensors::all(64, 64)).await.expect("a run");
    }
    arena
}

async fn bytes(
    arena: &Arena,
    address: &str,
    headers: &[(header::HeaderName, &str)],
) -> (StatusCode, HeaderMap, Vec<u8>) {
    let mut request = Request::get(address);
    for (name, value) in headers {
        request = request.header(name, *value);
    }
    arena.bytes(request.body(Body::empty()).expect("a request")).await
}

#[tokio::test]
async fn sound_files_hold_the_exact_samples() {
    let renderer = FakeRenderer::new(1);
    let arena = arena_with_sound(renderer.clone()).await;
    let (status, headers, wav) = bytes(&arena, SOUND, &[]).await;
    assert_eq!(
        (status, &headers[header::CONTENT_TYPE]),
        (StatusCode::OK, &HeaderValue::from_static("audio/wav"))
    );
    assert_eq!(wav.len(), 68 + 2 * STEP * 8);
    let left: Vec<u8> = wav[68..].chunks(8).flat_map(|frame| frame[..4].to_vec()).collect();
    let heard: Vec<u8> = tone()[2 * STEP..4 * STEP].iter().flat_map(|sample| sample.to_le_bytes()).collect();
    assert!(left == heard, "bit for bit");
    let tag = headers[header::ETAG].to_str().expect("a tag").to_owned();
    let (known, _, nothing) = bytes(&arena, SOUND, &[(header::IF_NONE_MATCH, &tag)]).await;
    assert_eq!((known, nothing.len()), (StatusCode::NOT_MODIFIED, 0));
    let asked = [(header::RANGE, "bytes=100-199"), (header::ACCEPT_ENCODING, "gzip")];
    let (status, headers, part) = bytes(&arena, SOUND, &asked).await;
    assert_eq!(status, StatusCode::PARTIAL_CONTENT);
    assert_eq!(headers[header::CONTENT_RANGE], format!("bytes 100-199/{}", wav.len()));
    assert!(part == wav[100..200] && !headers.contains_key(header::CONTENT_ENCODING));
    let (_, headers, packed) = bytes(&arena, SOUND, &[(header::ACCEPT_ENCODING, "gzip")]).await;
    assert!(packed == wav && !headers.contains_key(header::CONTENT_ENCODING), "sound is not compressed");
    let expected = SoundRequest { phase: "open".to_owned(), run: "run_formula".to_owned(), ordinal: 1 };
    assert_eq!(renderer.sounds(), [expected], "rendered once");
}

#[tokio::test]
async fn hidden_or_deaf_episodes_have_no_sound() {
    let renderer = FakeRenderer::new(100);
    let arena = arena_with_sound(renderer.clone()).await;
    for address in [
        "/runs/run_sealed/episodes/0/ears/0-1.wav",
        "/runs/run_sealed/episodes/0/ears/0-1000.wav",
        "/runs/run_rude/episodes/0/ears/0-1.wav",
        "/runs/run_begun/episodes/1/ears/0-1.wav",
        "/runs/nowhere/episodes/0/ears/0-1.wav",
        "/runs/run_formula/episodes/1/ears/1.wav",
        "/api/v1/runs/run_sealed/episodes/0/levels.csv",
        "/api/v1/runs/run_rude/episodes/0/levels.csv",
    ] {
        for answer in [arena.get(address).await, arena.get_as(address, TOKEN).await] {
            assert_eq!(answer.status, StatusCode::NOT_FOUND, "{address}");
        }
    }
    for (episode, hears) in [("run_sealed", false), ("run_rude", false), ("run_formula", true)] {
        let page = arena.get_as(&format!("/runs/{episode}/episodes/0"), TOKEN).await.body;
        assert_eq!(page.contains("id=\"ears\"") && page.contains("<audio"), hears, "{episode}: {page}");
    }
    assert_eq!(renderer.sounds(), [], "pages alone render no sound");
    let beyond = arena.get("/runs/run_formula/episodes/1/ears/5-7.wav").await;
    assert_eq!(beyond.status, StatusCode::NOT_FOUND);
    let long = arena.get("/runs/run_formula/episodes/1/ears/0-120.wav").await;
    assert_eq!(long.status, StatusCode::BAD_REQUEST);
    assert!(long.body.contains("exceed the limit of 120 steps in one file"), "{}", long.body);
    let plain = Arena::new().await;
    plain.store.set_sensors("run_formula", &Sensors::all(64, 64)).await.expect("a run");
    assert_eq!(plain.get(SOUND).await.status, StatusCode::NOT_FOUND);
    assert!(!plain.get(REPLAY).await.body.contains("id=\"ears\""));
}

#[tokio::test]
async fn pages_describe_sound_and_show_levels_on_request() {
    let arena = arena_with_sound(FakeRenderer::new(100)).await;
    let page = arena.get(REPLAY).await;
    assert!(page.header(header::CONTENT_SECURITY_POLICY).contains("media-src 'self'"));
    let page = page.body;
    assert!(page.contains("preload=\"none\" src=\"/runs/run_formula/episodes/1/ears/0-6.wav\""), "{page}");
    assert!(
        page.contains("chair (goal 1), right</td>") && !page.contains("chair (goal 1), right, "),
        "{page}"
    );
    assert!(page.contains("Direction of sound") && !page.contains("Level at each ear"), "{page}");
    assert!(page.contains("?t=3&#38;ears=on#ears\">Show sound levels</a>"), "{page}");
    let page = arena.get(&format!("{REPLAY}&ears=on")).await.body;
    assert!(page.contains("chair (goal 1), right, 17 dB</td>"), "{page}");
    assert!(page.contains("value=\"60\" aria-label=\"Level at the left ear, decibels\""), "{page}");
    assert!(page.contains("data-level-words=\"right\">inaudible<"), "{page}");
    assert!(
        page.contains("Maximum at the left ear 120 dB at step 6; nothing audible at the right ear."),
        "{page}"
    );
    assert!(page.contains("?t=2&#38;ears=on\">"), "links keep the levels: {page}");
    assert_eq!(arena.get(&format!("{REPLAY}&ears=off")).await.status, StatusCode::BAD_REQUEST);
    let table = arena.get("/api/v1/runs/run_formula/episodes/1/levels.csv").await.body;
    let lines: Vec<&str> = table.split_terminator("\r\n").collect();
    assert_eq!((lines.len(), lines[0]), (8, "step,left_rms_pa,right_rms_pa,left_db,right_db"));
    assert!(lines[4].starts_with("3,0.020") && lines[4].contains(",0,60.2"), "{table}");
}

#[tokio::test]
async fn pages_work_without_levels() {
    let renderer = FakeRenderer::new(0);
    renderer.permits.close();
    let arena = arena_with_sound(renderer).await;
    let page = arena.get(&format!("{REPLAY}&ears=on")).await;
    assert_eq!(page.status, StatusCode::OK);
    assert!(
        page.body.contains("The sound levels are not ready yet") && !page.body.contains("secret"),
        "{}",
        page.body
    );
    assert_eq!(arena.get(SOUND).await.status, StatusCode::INTERNAL_SERVER_ERROR);
}
