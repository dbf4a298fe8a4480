use crate::fixture::{Arena, ORGANISER, TOKEN};
use axum::http::{StatusCode, header};

const SEALED: [&str; 20] = [
    "/",
    "/api/v1/runs.csv",
    "/leaderboard/sealed",
    "/runs",
    "/runs/run_sealed",
    "/runs/run_sealed/episodes/0",
    "/runs/run_sealed/badge.svg",
    "/embed/sealed",
    "/api/v1/phases/sealed/leaderboard",
    "/api/v1/phases/sealed/leaderboard.csv",
    "/api/v1/runs/run_sealed/episodes.csv",
    "/leaderboard/sealed?order=both",
    "/api/v1/phases/sealed/leaderboards",
    "/api/v1/phases/sealed/leaderboards.csv",
    "/runs/run_sealed/episodes/0?t=1",
    "/runs/run_sealed/episodes/0/eyes/1.png",
    "/runs/run_sealed/episodes/0?ears=on",
    "/runs/run_sealed/episodes/0/ears/0-1.wav",
    "/api/v1/runs/run_sealed/episodes/0/levels.csv",
    "/api/v1/runs/run_sealed/episodes/0/steps.csv",
];

#[tokio::test]
async fn nobody_learns_of_sealed_runs_without_a_token() {
    let arena = Arena::new().await;
    for address in SEALED {
        let answer = arena.get(address).await;
        assert!(!answer.body.contains("secret walker"), "{address}: {}", answer.body);
        let gone = address.contains("run_sealed");
        assert_eq!(answer.status, if gone { StatusCode::NOT_FOUND } else { StatusCode::OK }, "{address}");
    }
    for hidden in [
        "/api/v1/phases/sealed/missions",
        "/api/v1/phases/sealed/missions.csv",
        "/phases/sealed/scenes/0.svg",
    ] {
        assert_eq!(arena.get(hidden).await.status, StatusCode::NOT_FOUND, "{hidden}");
        assert_eq!(arena.get_as(hidden, TOKEN).await.status, StatusCode::NOT_FOUND, "{hidden}");
        assert_eq!(arena.get_as(hidden, ORGANISER).await.status, StatusCode::OK, "{hidden}");
    }
    let phase = arena.get_as("/phases/sealed", TOKEN).await.body;
    assert!(!phase.contains("canary") && !phase.contains("Goals of a mission"), "{phase}");
    let board = arena.get("/leaderboard/sealed").await.body;
    assert!(board.contains("Who sees the scores of this phase: the organiser"), "{board}");
}

#[tokio::test]
async fn a_team_follows_its_sealed_run_without_scores_and_the_organiser_sees_them() {
    let arena = Arena::new().await;
    let own = arena.get_as("/runs/run_sealed", TOKEN).await;
    assert_eq!(own.status, StatusCode::OK);
    assert!(own.body.contains("The scores of this phase are hidden") && own.body.contains("2 of 2 episodes"));
    assert!(!own.body.contains("id=\"scores\"") && !own.body.contains("canary"), "{}", own.body);
    let json = arena.get_as("/api/v1/runs/run_sealed", TOKEN).await;
    assert!(json.json()["summary"].is_null());
    let badge = arena.get_as("/runs/run_sealed/badge.svg", TOKEN).await.body;
    assert!(badge.contains("scores are hidden") && !badge.contains("canary"), "{badge}");
    for address in ["/compare", "/api/v1/compare", "/api/v1/compare.csv"] {
        let both = arena.get_as(&format!("{address}?first=run_sealed&second=run_sealed"), TOKEN).await;
        assert_eq!(both.status, StatusCode::BAD_REQUEST, "{}", both.body);
        assert!(both.body.contains("hides what single episodes were worth") && !both.body.contains("canary"));
    }
    let episode = arena.get_as("/runs/run_sealed/episodes/0", TOKEN).await.body;
    assert!(!episode.contains("<figure") && !episode.contains("canary"), "{episode}");
    let seen = arena.get_as("/runs/run_sealed", ORGANISER).await.body;
    assert!(seen.contains("id=\"scores\"") && seen.contains("canary-scene"));
    let board = arena.get_as("/leaderboard/sealed", ORGANISER).await.body;
    assert!(board.contains("secret walker"));
}

#[tokio::test]
async fn what_a_token_opened_is_kept_by_no_cache() {
    let arena = Arena::new().await;
    let own = arena.get_as("/runs/run_sealed", TOKEN).await;
    assert_eq!(own.header(header::CACHE_CONTROL), "private, no-store");
    assert_eq!(own.header(header::VARY), "authorization, cookie, accept-encoding");
    let bad = arena.get_as("/api/v1/runs", "no such token").await;
    assert_eq!(bad.status, StatusCode::UNAUTHORIZED);
    assert_eq!(bad.header(header::WWW_AUTHENTICATE), "Bearer");
    assert_eq!(bad.json()["reason"], "UNAUTHENTICATED");
}

#[tokio::test]
async fn logs_are_given_out_where_replays_are_shown_once_the_run_is_over() {
    let arena = Arena::new().await;
    for run in ["run_rude", "run_begun", "run_sealed"] {
        let path = arena.folder.path().join(format!("{run}.log"));
        std::fs::write(path, format!("the canary log of {run}\n")).expect("a log");
    }
    let log = arena.get("/api/v1/runs/run_rude/log").await;
    assert_eq!((log.status, log.body.as_str()), (StatusCode::OK, "the canary log of run_rude\n"));
    assert_eq!(log.header(header::CACHE_CONTROL), "private, no-store");
    assert_eq!(log.header(header::CONTENT_DISPOSITION), "attachment; filename=\"run_rude.log\"");
    let open = arena.get("/api/v1/runs/run_begun/log").await;
    assert_eq!(open.status, StatusCode::BAD_REQUEST);
    assert!(open.body.contains("is not over") && !open.body.contains("canary"), "{}", open.body);
    for hidden in [
        arena.get("/api/v1/runs/run_sealed/log").await,
        arena.get_as("/api/v1/runs/run_sealed/log", TOKEN).await,
        arena.get("/api/v1/runs/..%2Frun_rude/log").await,
        arena.get("/api/v1/runs/run_formula/log").await,
    ] {
        assert_eq!(hidden.status, StatusCode::NOT_FOUND);
        assert!(!hidden.body.contains("canary"), "{}", hidden.body);
    }
    let organiser = arena.get_as("/api/v1/runs/run_sealed/log", ORGANISER).await;
    assert_eq!(organiser.body, "the canary log of run_sealed\n");
    assert_eq!(arena.get("/api/v1/status").await.json()["log_key"], crate::fixture::LOG_KEY);
}
