use crate::fixture::{Arena, TOKEN};
use avln_web::{Blind, Glance, Looking, Onlooker, Seen};
use axum::http::{StatusCode, header};
use std::sync::{Arc, Mutex};
use tokio::sync::Semaphore;

/// Sees grey, once for each permit, and remembers where it looked from.
#[derive(Debug)]
struct Grey {
    glances: Mutex<Vec<Glance>>,
    permits: Arc<Semaphore>,
}

impl Grey {
    fn new(permits: usize) -> Arc<Self> {
        Arc::new(Self { glances: Mutex::default(), permits: Arc::new(Semaphore::new(permits)) })
    }

    fn glances(&self) -> Vec<Glance> {
        self.glances.lock().expect("nobody broke").clone()
    }
}

impl Onlooker for Grey {
    fn look(&self, glance: Glance) -> Looking {
        let (permits, pixels) = (self.permits.clone(), (glance.width * glance.height) as usize);
        self.glances.lock().expect("nobody broke").push(glance);
        Box::pin(async move {
            let permit = permits.acquire().await.map_err(|_| Blind("a secret reason".to_owned()))?;
            permit.forget();
            Ok(Seen { rgb: vec![128; 3 * pixels], depth_m: vec![5.0; pixels], depth_max_m: 10.0 })
        })
    }
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
