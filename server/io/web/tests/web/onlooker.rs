use crate::fixture::{Arena, TOKEN};
use avln_episode::Sensors;
use avln_web::{RenderError, ViewRequest, RenderedSound, Hearing, SoundRequest, Looking, ReplayRenderer, RenderedView};
use axum::{
    body::Body,
    http::{HeaderMap, HeaderValue, Request, StatusCode, header},
};
use std::sync::{Arc, Mutex};
use tokio::sync::Semaphore;

/// Samples of a step of the sound that is heard.
const STEP: usize = 4000;

/// Sees grey and hears a rising tone on the left, once for each permit, and remembers where it looked from and what it listened to.
#[derive(Debug)]
pub(crate) struct Grey {
    glances: Mutex<Vec<ViewRequest>>,
    listened: Mutex<Vec<SoundRequest>>,
    permits: Arc<Semaphore>,
}

impl Grey {
    pub(crate) fn new(permits: usize) -> Arc<Self> {
        let permits = Arc::new(Semaphore::new(permits));
        Arc::new(Self { glances: Mutex::default(), listened: Mutex::default(), permits })
    }

    fn listened(&self) -> Vec<SoundRequest> {
        self.listened.lock().expect("nobody broke").clone()
    }

    fn glances(&self) -> Vec<ViewRequest> {
        self.glances.lock().expect("nobody broke").clone()
    }
}

impl ReplayRenderer for Grey {
    fn look(&self, glance: ViewRequest) -> Looking {
        let (permits, pixels) = (self.permits.clone(), (glance.width * glance.height) as usize);
        self.glances.lock().expect("nobody broke").push(glance);
        Box::pin(async move {
            let permit = permits.acquire().await.map_err(|_| RenderError("a secret reason".to_owned()))?;
            permit.forget();
            Ok(RenderedView { rgb: vec![128; 3 * pixels], depth_m: vec![5.0; pixels], depth_max_m: 10.0 })
        })
    }

    fn listen(&self, listening: SoundRequest) -> Hearing {
        let permits = self.permits.clone();
        self.listened.lock().expect("nobody broke").push(listening);
        Box::pin(async move {
            let permit = permits.acquire().await.map_err(|_| RenderError("a secret reason".to_owned()))?;
            permit.forget();
            Ok(RenderedSound { samples_per_step: STEP, left: tone(), right: vec![0.0; 7 * STEP] })
        })
    }
}

/// Seven steps, each of a constant pressure that grows from step to step: 0 dB, 20 dB and so on.
fn tone() -> Vec<f32> {
    (0..7).flat_map(|step| vec![20.5e-6 * 10_f32.powi(step); STEP]).collect()
}

const PICTURE: &str = "/runs/run_formula/episodes/1/eyes/3.png";

#[tokio::test]
async fn a_picture_is_made_from_where_the_body_stood_and_kept() {
    let grey = Grey::new(100);
    let arena = Arena::seen_by(Some(grey.clone())).await;
    let page = arena.get("/runs/run_formula/episodes/1?t=3").await.body;
    assert!(page.contains(&format!("src=\"{PICTURE}\"")), "{page}");
    assert!(page.contains(&format!("src=\"{PICTURE}?sensor=depth\"")), "{page}");
    for address in [PICTURE, &format!("{PICTURE}?sensor=rgb"), &format!("{PICTURE}?sensor=depth")] {
        let picture = arena.get(address).await;
        assert_eq!((picture.status, picture.header(header::CONTENT_TYPE)), (StatusCode::OK, "image/png"));
        assert!(picture.body.contains("PNG"), "{address}");
    }
    let glances = grey.glances();
    assert_eq!(glances.len(), 1, "one glance for both sensors");
    assert_eq!((glances[0].phase.as_str(), glances[0].scene.as_str()), ("open", "canary-scene"));
    assert_eq!((glances[0].pose.position.z, glances[0].width, glances[0].height), (1.25, 320, 320));
}

#[tokio::test]
async fn nobody_looks_where_no_replay_is_shown_or_nobody_stood() {
    let grey = Grey::new(100);
    let arena = Arena::seen_by(Some(grey.clone())).await;
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
    assert_eq!(grey.glances(), []);
    let blind = Arena::new().await;
    assert_eq!(blind.get(PICTURE).await.status, StatusCode::NOT_FOUND);
    assert!(!blind.get("/runs/run_formula/episodes/1").await.body.contains("/eyes/"));
}

#[tokio::test]
async fn few_wait_for_pictures_and_the_others_are_asked_to_come_again() {
    let grey = Grey::new(0);
    let arena = Arena::seen_by(Some(grey.clone())).await;
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
        while grey.glances().is_empty() {
            tokio::task::yield_now().await;
        }
        tokio::time::sleep(std::time::Duration::from_millis(200)).await;
        assert_eq!(grey.glances().len(), 1, "one picture is made at a time");
        grey.permits.add_permits(100);
    };
    let (answers, ()) = tokio::join!(all, open);
    let refused: Vec<_> = answers.iter().filter(|a| a.status == StatusCode::TOO_MANY_REQUESTS).collect();
    assert_eq!(answers.iter().filter(|a| a.status == StatusCode::OK).count(), 8);
    assert_eq!(refused.len(), 6);
    assert_eq!(refused[0].header(header::RETRY_AFTER), "5");
    assert_eq!(arena.get(PICTURE).await.status, StatusCode::OK, "the door is free again");
}

#[tokio::test]
async fn a_picture_that_fails_is_trouble_without_its_reason() {
    let grey = Grey::new(0);
    grey.permits.close();
    let arena = Arena::seen_by(Some(grey)).await;
    let failed = arena.get(PICTURE).await;
    assert_eq!(failed.status, StatusCode::INTERNAL_SERVER_ERROR);
    assert!(!failed.body.contains("secret"), "{}", failed.body);
    assert_eq!(arena.get(PICTURE).await.status, StatusCode::INTERNAL_SERVER_ERROR);
}

const SOUND: &str = "/runs/run_formula/episodes/1/ears/2-3.wav";
const REPLAY: &str = "/runs/run_formula/episodes/1?t=3";

/// An arena in which somebody can listen, and the agents asked for sound.
async fn hearing(grey: Arc<Grey>) -> Arena {
    let arena = Arena::seen_by(Some(grey)).await;
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
async fn sound_is_the_samples_that_were_heard_and_is_made_once() {
    let grey = Grey::new(1);
    let arena = hearing(grey.clone()).await;
    let (status, headers, wav) = bytes(&arena, SOUND, &[]).await;
    assert_eq!(
        (status, &headers[header::CONTENT_TYPE]),
        (StatusCode::OK, &HeaderValue::from_static("audio/wav"))
    );
    assert_eq!(wav.len(), 58 + 2 * STEP * 8);
    let left: Vec<u8> = wav[58..].chunks(8).flat_map(|frame| frame[..4].to_vec()).collect();
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
    assert!(packed == wav && !headers.contains_key(header::CONTENT_ENCODING), "noise is not packed");
    let expected = SoundRequest { phase: "open".to_owned(), run: "run_formula".to_owned(), ordinal: 1 };
    assert_eq!(grey.listened(), [expected], "it was listened to once");
}

#[tokio::test]
async fn nobody_listens_where_no_replay_is_shown_or_nobody_had_ears() {
    let grey = Grey::new(100);
    let arena = hearing(grey.clone()).await;
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
    assert_eq!(grey.listened(), [], "and a page alone makes nobody listen");
    let beyond = arena.get("/runs/run_formula/episodes/1/ears/5-7.wav").await;
    assert_eq!(beyond.status, StatusCode::NOT_FOUND);
    let long = arena.get("/runs/run_formula/episodes/1/ears/0-120.wav").await;
    assert_eq!(long.status, StatusCode::BAD_REQUEST);
    assert!(long.body.contains("more than the 120 that one file holds"), "{}", long.body);
    let deaf = Arena::new().await;
    deaf.store.set_sensors("run_formula", &Sensors::all(64, 64)).await.expect("a run");
    assert_eq!(deaf.get(SOUND).await.status, StatusCode::NOT_FOUND);
    assert!(!deaf.get(REPLAY).await.body.contains("id=\"ears\""));
}

#[tokio::test]
async fn ears_tell_in_words_what_there_was_to_hear_and_levels_where_asked() {
    let arena = hearing(Grey::new(100)).await;
    let page = arena.get(REPLAY).await;
    assert!(page.header(header::CONTENT_SECURITY_POLICY).contains("media-src 'self'"));
    let page = page.body;
    assert!(page.contains("preload=\"none\" src=\"/runs/run_formula/episodes/1/ears/0-6.wav\""), "{page}");
    assert!(
        page.contains("chair (goal 1), right</td>") && !page.contains("chair (goal 1), right, "),
        "{page}"
    );
    assert!(page.contains("Where sound came from") && !page.contains("Level at each ear"), "{page}");
    assert!(page.contains("?t=3&#38;ears=on#ears\">Tell how loud it was</a>"), "{page}");
    let page = arena.get(&format!("{REPLAY}&ears=on")).await.body;
    assert!(page.contains("chair (goal 1), right, 17 dB</td>"), "{page}");
    assert!(page.contains("value=\"60\" aria-label=\"Level at the left ear, decibels\""), "{page}");
    assert!(page.contains("data-level-words=\"right\">not to be heard<"), "{page}");
    assert!(
        page.contains("Loudest at the left ear at step 6, 120 dB; nothing to be heard at the right ear."),
        "{page}"
    );
    assert!(page.contains("?t=2&#38;ears=on\">"), "links go on with levels: {page}");
    assert_eq!(arena.get(&format!("{REPLAY}&ears=off")).await.status, StatusCode::BAD_REQUEST);
    let table = arena.get("/api/v1/runs/run_formula/episodes/1/levels.csv").await.body;
    let lines: Vec<&str> = table.split_terminator("\r\n").collect();
    assert_eq!((lines.len(), lines[0]), (8, "step,left_rms_pa,right_rms_pa,left_db,right_db"));
    assert!(lines[4].starts_with("3,0.020") && lines[4].contains(",0,60.2"), "{table}");
}

#[tokio::test]
async fn a_page_goes_without_levels_that_cannot_be_had() {
    let grey = Grey::new(0);
    grey.permits.close();
    let arena = hearing(grey).await;
    let page = arena.get(&format!("{REPLAY}&ears=on")).await;
    assert_eq!(page.status, StatusCode::OK);
    assert!(page.body.contains("No levels yet") && !page.body.contains("secret"), "{}", page.body);
    assert_eq!(arena.get(SOUND).await.status, StatusCode::INTERNAL_SERVER_ERROR);
}
