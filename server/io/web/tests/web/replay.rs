use crate::fixture::{Arena, TOKEN};
use avln_store::{Scene, SceneMap};
use axum::http::{StatusCode, header};

const EPISODE: &str = "/runs/run_formula/episodes/1";

/// What stands in the element that the script would fill under `name`.
fn told<'a>(page: &'a str, name: &str) -> &'a str {
    let mark = format!("data-tell=\"{name}\">");
    let rest = page.split_once(&mark).unwrap_or_else(|| panic!("{name} in {page}")).1;
    rest.split('<').next().unwrap_or_default()
}

#[tokio::test]
async fn each_step_has_an_address_and_needs_no_script() {
    let arena = Arena::new().await;
    let end = arena.get(EPISODE).await.body;
    assert_eq!([told(&end, "step"), told(&end, "action"), told(&end, "submits-left")], ["6", "Submit", "0"]);
    assert!(!end.contains(" later"), "at the end nothing is still to come");
    let third = arena.get(&format!("{EPISODE}?t=3")).await.body;
    assert_eq!([told(&third, "step"), told(&third, "action")], ["3", "MoveForward, held back"]);
    assert_eq!([told(&third, "sounding"), told(&third, "bearing")], ["goal 1", "104° to the right"]);
    assert_eq!([told(&third, "walked"), told(&third, "actions-left")], ["0.75", "997"]);
    assert_eq!([told(&third, "distance-0"), told(&third, "submits-left")], ["0.50", "2"]);
    assert!(third.contains("translate(0.5 1.25) rotate(0)"), "the body: {third}");
    assert!(third.contains("<g class=\"submit right later\""), "claims to come are faint");
    assert!(third.contains("<g class=\"source sounds\" data-source=\"goal 1\""), "{third}");
    assert!(third.contains("<g class=\"source\" data-source=\"goal 2\""), "{third}");
    for link in [format!("href=\"{EPISODE}?t=2\""), format!("href=\"{EPISODE}?t=4\"")] {
        assert!(third.contains(&link), "{link} in {third}");
    }
    let start = arena.get(&format!("{EPISODE}?t=0")).await.body;
    assert_eq!([told(&start, "action"), told(&start, "walked")], ["before the first", "0.00"]);
    let beyond = arena.get(&format!("{EPISODE}?t=4000000000")).await.body;
    assert_eq!(told(&beyond, "step"), "6");
    for wrong in ["t=-1", "t=x", "t=4294967296", "step=1"] {
        assert_eq!(arena.get(&format!("{EPISODE}?{wrong}")).await.status, StatusCode::BAD_REQUEST, "{wrong}");
    }
}

#[tokio::test]
async fn events_are_told_in_order_and_lead_to_their_steps() {
    let arena = Arena::new().await;
    let page = arena.get(&format!("{EPISODE}?t=5")).await.body;
    let place = |words: &str| page.find(words).unwrap_or_else(|| panic!("{words} in {page}"));
    let order =
        ["</span> Submit, right: goal 1 (chair) is found", "</span> Submit, wrong", "End: last submit"];
    let places: Vec<usize> = ["Start</td>", "Goal 1 sounds"].into_iter().chain(order).map(place).collect();
    assert!(places.is_sorted(), "{places:?}");
    assert!(page.contains("<tr data-event=\"5\" aria-current=\"true\">"), "{page}");
    assert_eq!(page.matches("aria-current=\"true\"").count(), 1);
    assert!(page.contains(&format!("href=\"{EPISODE}?t=1\">1</a>")), "{page}");
}

#[tokio::test]
async fn plots_say_in_words_what_they_show_and_share_the_cursor() {
    let arena = Arena::new().await;
    let page = arena.get(&format!("{EPISODE}?t=3")).await.body;
    assert_eq!(page.matches("<svg class=\"curves\"").count(), 4);
    assert_eq!(page.matches("transform=\"translate(260.0 0)\"/></svg>").count(), 4, "half way: {page}");
    assert!(
        page.contains("Nearest to each target: goal 1 0.50 m at step 0, goal 2 0.50 m at step 0."),
        "{page}"
    );
    assert!(page.contains("What sounded: goal 1 in 6 steps, goal 2 in 0 steps."), "{page}");
    let left = "At the end 994 of 1000 actions were left, 4.1 min of simulated time, and 0 of 2 claims.";
    assert!(page.contains(left), "{page}");
    assert!(page.contains("1.00 m walked against a reference tour of 1.00 m."), "{page}");
}

#[tokio::test]
async fn the_script_is_handed_the_same_steps_and_is_no_other_origins() {
    let arena = Arena::new().await;
    let page = arena.get(EPISODE).await;
    let columns = page.body.split_once("data-columns=\"").expect("columns").1;
    let columns = columns.split('"').next().unwrap_or_default().replace("&#34;", "\"");
    let columns: serde_json::Value = serde_json::from_str(&columns).expect("JSON");
    assert_eq!(columns["y"], serde_json::json!([2.0, 1.75, 1.5, 1.25, 1.0, 1.0, 1.0]));
    assert_eq!(columns["action"]["words"][2], "MoveForward, held back");
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
async fn steps_are_a_table_where_the_replay_is_shown() {
    let arena = Arena::new().await;
    let table = arena.get("/api/v1/runs/run_formula/episodes/1/steps.csv").await;
    let lines: Vec<&str> = table.body.lines().collect();
    assert_eq!(lines.len(), 8);
    assert!(
        lines[0].starts_with("step,action,x_m,y_m,z_m") && lines[0].ends_with("distance_1_m,distance_2_m")
    );
    assert_eq!(lines[1], "0,,0.5,0,2,0,false,,,0,1000,2,0.5,0.5");
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
async fn storeys_are_tabs_and_the_body_is_on_one() {
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
