//! A challenge file: checked, applied, shown, played on a running server, and revealed.

use crate::Hall;
use avln_arena::{
    Arena, SCENE_MEMORY_MIB,
    challenge::SummaryStyle,
    seed_to_publish,
    setup::{NewPhase, open_phase},
};
use avln_challenge::{Account, MethodInfo, PhaseState, TokenScope};
use avln_episode::{DistractorSources, ExtraSubmit, Order, SilenceRule, StopClaims};
use avln_grpc::{Host, Reason, RunRequest};
use avln_store::{AuditNote, Phase, Viewer, Visibility};

pub(crate) const TEAM: &str = "red";
const FILE: &str = r#"
[[phases]]
id = "practice"
split = "val"
scores = "public"
replays = "public"
feedback = "verdict"

[[phases]]
id = "finals"
title = "The finals"
split = "hidden"
scores = "organiser"
replays = "organiser"
sample = { episodes = 2, anchors = 1 }
quota = { total = 2, concurrent = 1 }
ranking = { key = "spl", entry = "latest" }
"#;

fn account() -> Account {
    Account {
        team: TEAM.to_owned(),
        scope: TokenScope::Participant,
        token_name: String::new(),
        expires_unix_ms: None,
    }
}

fn request(phase: &str) -> RunRequest {
    RunRequest {
        phase: phase.to_owned(),
        method: MethodInfo::new("walker", ""),
        client_request_id: String::new(),
        order: Order::Unordered,
    }
}

#[tokio::test]
async fn repeated_apply_changes_nothing() {
    let hall = Hall::new().await;
    assert!(!hall.apply(FILE).await.is_empty());
    let lines = hall.audit_lines().await;
    assert_eq!(hall.apply(FILE).await, []);
    let shown = hall.shown().await;
    assert_eq!(hall.apply(&shown).await, []);
    assert_eq!((hall.audit_lines().await, hall.shown().await), (lines, shown.clone()));
    let ids: Vec<_> = hall.store.phases().await.expect("phases").into_iter().map(|p| p.id).collect();
    assert_eq!(ids, ["practice", "finals"]);
    let finals = hall.store.phase("finals").await.expect("the phase");
    assert!(finals.sampling.shuffle, "hidden replays are shuffled");
    let notes = hall.apply(&shown.replace("total = 2", "total = 5")).await;
    let [AuditNote { subject, what, before, after, reason, .. }] = &notes[..] else { panic!("{notes:?}") };
    assert_eq!((subject.as_str(), what.as_str(), reason.as_str()), ("phase finals", "quota.total", "a test"));
    assert_eq!((before.as_deref(), after.as_deref()), (Some("2"), Some("5")));
    assert_eq!(hall.audit_lines().await, lines + 1);
}

#[tokio::test]
async fn manual_decisions_survive_apply() {
    let hall = Hall::new().await;
    hall.apply(FILE).await;
    hall.reschedule("practice", |schedule| schedule.paused = Some("the server moves".to_owned())).await;
    assert_eq!(hall.apply(FILE).await, []);
    let paused = hall.store.phase("practice").await.expect("the phase").schedule.paused;
    assert_eq!(paused.as_deref(), Some("the server moves"));
    hall.reschedule("practice", |schedule| (schedule.paused, schedule.closed) = (None, false)).await;
    assert_eq!(hall.store.phase("practice").await.expect("the phase").schedule.paused, None);
    let last = hall.store.audit().await.expect("a list").pop().expect("a line");
    assert_eq!((last.what.as_str(), last.after), ("paused", None));
}

#[tokio::test]
async fn nonsense_value_error_has_line() {
    let hall = Hall::new().await;
    let cases = [
        ("split = \"val\"", "split = \"train\"", 4, "split 'train'"),
        ("id = \"finals\"", "id = \"practice\"", 10, "another phase"),
        ("id = \"finals\"", "id = \"../finals\"", 10, "letters"),
        ("episodes = 2", "episodes = 4", 15, "4 is outside of 1 to 3"),
        ("anchors = 1", "anchors = 3", 15, "3 is outside of 0 to 2"),
        ("total = 2", "total = 0", 16, "0 permits no run"),
        ("feedback = \"verdict\"", "max_slots = 65", 7, "65 is outside of 1 to 64"),
        ("feedback = \"verdict\"", "max_side = 32", 7, "32 is outside of 64 to 1024"),
        ("feedback = \"verdict\"", "orders = []", 7, "one or both orders"),
        ("feedback = \"verdict\"", "sounds = \"kept:00\"", 7, "sounds"),
        ("feedback = \"verdict\"", "rules = \"habitat\"", 7, "habitat"),
        ("feedback = \"verdict\"", "opens = 2026-07-01T00:00:00", 7, "offset"),
        ("feedback = \"verdict\"", "teams = { allow = [\"a\"], deny = [\"a\"] }", 7, "allowed and denied"),
        (
            "feedback = \"verdict\"",
            "opens = 2026-07-02T00:00:00Z\ncloses = 2026-07-01T00:00:00Z",
            8,
            "close before it opens",
        ),
    ];
    for (good, bad, line, said) in cases {
        let text = FILE.replacen(good, bad, 1);
        let refused = hall.plan(&text).await.expect_err(bad).to_string();
        assert!(refused.contains(&format!("challenge.toml, line {line}: ")), "{bad}: {refused}");
        assert!(refused.contains(said) && refused.contains("for example: "), "{bad}: {refused}");
    }
    assert_eq!(hall.audit_lines().await, 0);
    hall.apply(FILE).await;
}

#[tokio::test]
async fn running_server_sees_organiser_changes() {
    let hall = Hall::new().await;
    hall.apply(FILE).await;
    let arena = Arena::open(&hall.data, hall.store.clone(), SCENE_MEMORY_MIB).await.expect("phases");
    let listed = async || Host::phases(&arena, None).await.expect("a list");
    assert_eq!(
        listed().await.iter().map(|phase| phase.id.as_str()).collect::<Vec<_>>(),
        ["practice", "finals"]
    );
    let ticket = arena.start_run(&account(), request("finals")).await.expect("a run");
    assert_eq!(ticket.episodes, 2);
    let quota = ticket.quota.expect("a quota");
    assert_eq!((quota.limit, quota.remaining), (Some(1), Some(0)), "the one run at a time");
    let refusal = arena.start_run(&account(), request("finals")).await.expect_err("one at a time");
    assert_eq!(refusal.reason, Reason::QuotaConcurrent);

    hall.reschedule("practice", |schedule| schedule.paused = Some("the server moves".to_owned())).await;
    let practice = listed().await.remove(0);
    assert_eq!(
        (practice.state, practice.state_reason.as_deref()),
        (PhaseState::Paused, Some("the server moves"))
    );
    let refusal = arena.start_run(&account(), request("practice")).await.expect_err("a pause");
    assert_eq!(refusal.reason, Reason::PhasePaused);
    assert!(refusal.message.contains("the server moves"), "{refusal}");

    let later = FILE.replace("feedback = \"verdict\"", "opens = 2999-01-01T00:00:00Z");
    hall.reschedule("practice", |schedule| (schedule.paused, schedule.closed) = (None, false)).await;
    hall.apply(&later).await;
    let refusal = arena.start_run(&account(), request("practice")).await.expect_err("too early");
    assert_eq!((refusal.reason, refusal.retry_after_s.is_some()), (Reason::PhaseNotOpen, true));

    let third = format!(
        "{FILE}\n[[phases]]\nid = \"third\"\nsplit = \"hidden\"\nscores = \"team\"\nreplays = \"team\"\n"
    );
    hall.apply(&third).await;
    arena.start_run(&account(), request("third")).await.expect("a phase that was not there at the start");
    let refusal = arena.start_run(&account(), request("fourth")).await.expect_err("no such phase");
    assert!(refusal.message.contains("practice, finals, third"), "{refusal}");
}

#[tokio::test]
async fn first_run_fixes_silence() {
    let hall = Hall::new().await;
    let late = FILE.replace("feedback = \"verdict\"", "silence = \"window_end\"");
    hall.apply(&late).await;
    let rules = hall.store.phase("practice").await.expect("the phase").rules;
    assert_eq!(rules.silence, SilenceRule::WindowEnd);
    assert!(hall.shown().await.contains("silence = \"window_end\""));
    let arena = Arena::open(&hall.data, hall.store.clone(), SCENE_MEMORY_MIB).await.expect("phases");
    arena.start_run(&account(), request("practice")).await.expect("a run");
    let changed = late.replace("window_end", "delayed");
    let refused = hall.plan(&changed).await.expect_err("a run exists").to_string();
    assert!(refused.contains("existing runs fix") && refused.contains("silence"), "{refused}");
}

#[tokio::test]
async fn hard_track_needs_enough_other_targets() {
    let hall = Hall::new().await;
    hall.make("rich", 8, 8).await;
    hall.make("poor", 9, 1).await;
    let hard = |split: &str| {
        FILE.replace("feedback = \"verdict\"", "rules = \"lh-avln-hard-v1\"")
            .replace("split = \"val\"", &format!("split = \"{split}\""))
    };
    let refused = hall.refused(&hard("poor")).await;
    assert!(
        refused.contains("distractor sources in mission") && refused.contains("has 0 other targets"),
        "{refused}"
    );
    hall.apply(&hard("rich")).await;
    assert!(hall.shown().await.contains("distractor_sources = \"goals\""));
    let split = hall.data.missions("rich").expect("a split");
    let rules = hall.store.phase("practice").await.expect("the phase").rules;
    let scene = &split.scenes()[0];
    let assets = scene.spec().open(&rules).expect("a house");
    for episode in split.episodes(scene).expect("missions") {
        let [ordered, unordered] = [Order::Ordered, Order::Unordered]
            .map(|order| split.truth(&episode, order, &rules, &assets).expect("a truth").distractor_sources);
        assert_eq!((ordered.len(), &ordered), (episode.goals.len(), &unordered));
    }
}

#[tokio::test]
async fn first_run_fixes_claims_and_distractors() {
    let hall = Hall::new().await;
    let options = "extra_submit = \"ends_episode\"\nstop_claims = \"last_only\"\ndistractor_sources = 1";
    let file = FILE.replace("feedback = \"verdict\"", options);
    hall.apply(&file).await;
    let rules = hall.store.phase("practice").await.expect("the phase").rules;
    assert_eq!((rules.extra_submit, rules.stop_claims), (ExtraSubmit::EndsEpisode, StopClaims::LastOnly));
    assert_eq!(rules.distractor_sources, DistractorSources::Number(1));
    let arena = Arena::open(&hall.data, hall.store.clone(), SCENE_MEMORY_MIB).await.expect("phases");
    arena.start_run(&account(), request("practice")).await.expect("a run");
    for (was, is) in [("ends_episode", "ignored"), ("last_only", "any_open"), ("= 1\n", "= 2\n")] {
        let refused = hall.refused(&file.replace(was, is)).await;
        assert!(refused.contains("existing runs fix"), "{refused}");
    }
    let unknown = hall.refused(&file.replace("= 1\n", "= 9\n")).await;
    assert!(unknown.contains("distractor_sources"), "{unknown}");
}

#[tokio::test]
async fn run_samples_are_fixed_and_fulfilled() {
    let hall = Hall::new().await;
    hall.apply(FILE).await;
    let arena = Arena::open(&hall.data, hall.store.clone(), SCENE_MEMORY_MIB).await.expect("phases");
    let promised =
        Host::phases(&arena, None).await.expect("a list").remove(1).commitment.expect("a commitment");
    assert_eq!(promised.len(), 64);
    arena.start_run(&account(), request("finals")).await.expect("a run");
    let text = FILE.replace("episodes = 2", "episodes = 3");
    let refused = hall.plan(&text).await.expect_err("existing runs fix").to_string();
    assert!(refused.contains("line 15: ") && refused.contains("existing runs fix"), "{refused}");
    hall.reschedule("finals", |schedule| schedule.closed = true).await;
    let (promise, values) =
        hall.store.reveal_phase("finals", None, AuditNote::default(), 1 << 42).await.expect("a closed phase");
    assert_eq!((promise.commitment, values.commitment()), (promised.clone(), promised));
    let told = Host::phases(&arena, None).await.expect("a list").remove(1);
    assert_eq!(told.revealed.map(|values| values.secret), Some(values.secret));
}

/// A file with a single phase.
fn single(id: &str, split: &str, visible_to: &str) -> String {
    format!(
        "[[phases]]\nid = \"{id}\"\nsplit = \"{split}\"\nscores = \"{visible_to}\"\nreplays = \"{visible_to}\"\n"
    )
}

#[tokio::test]
async fn faults_of_all_phases_are_reported() {
    let hall = Hall::new().await;
    let text = FILE
        .replace("feedback = \"verdict\"", "max_slots = 65\nmax_side = 32")
        .replace("total = 2", "total = 0");
    let refused = hall.refused(&text).await;
    let lines: Vec<_> = refused.lines().filter(|line| line.starts_with("challenge.toml, ")).collect();
    assert_eq!(lines.len(), 3, "{refused}");
    let expected = [(7, "65 is outside of"), (8, "32 is outside of"), (17, "0 permits no run")];
    for (shown, (line, said)) in lines.iter().zip(expected) {
        assert!(shown.starts_with(&format!("challenge.toml, line {line}: ")), "{shown}");
        assert!(shown.contains(said), "{shown}");
    }
}

#[tokio::test]
async fn summary_groups_changes_by_phase() {
    let hall = Hall::new().await;
    let summary = hall.plan(FILE).await.expect("a good file").summary(SummaryStyle::default());
    let expected = [
        "+ phase practice: 3 episodes of split val, opens at once, scores public, replays public",
        "+ phase finals: 2 of 3 episodes per run of split hidden, opens at once, scores organiser, replays organiser",
        "phase practice: two methods differ visibly from over 25 points of SR (3 episodes, 1 scene, few scenes)",
        "phase finals: two methods differ visibly from over 25 points of SR (2 common episodes, 1 scene, few scenes)",
        "2 phases to add, 0 to change, 0 splits to take in; 0 unchanged",
    ];
    assert_eq!(summary, expected);
    hall.apply(FILE).await;
    let plan = hall.plan(&FILE.replace("total = 2", "total = 5")).await.expect("a good file");
    let applied = SummaryStyle { is_applied: true, is_verbose: false };
    let expected = [
        "~ phase finals",
        "    quota.total: 2 -> 5",
        "0 phases added, 1 changed, 0 splits taken in; 1 unchanged",
    ];
    assert_eq!(plan.summary(applied), expected);
    let unchanged = hall.plan(FILE).await.expect("a good file").summary(applied);
    assert_eq!(unchanged, ["nothing to change"]);
}

#[tokio::test]
async fn hidden_phase_with_public_missions_is_refused() {
    let hall = Hall::new().await;
    hall.make("twin", 6, 3).await;
    for public in ["hidden", "twin"] {
        let text = FILE.replacen("split = \"val\"", &format!("split = \"{public}\""), 1);
        let refused = hall.refused(&text).await;
        let said = "phase 'finals' is hidden, but shares 1 scene and 3 missions with public phase 'practice'; make another";
        assert!(refused.starts_with("challenge.toml, line 12: ") && refused.contains(said), "{refused}");
    }
    hall.apply(FILE).await;
    let refused = hall.refused(&single("late", "val", "team")).await;
    assert!(refused.contains("line 3: ") && refused.contains("public phase 'practice'"), "{refused}");
    let late = NewPhase { replays: Visibility::Team, ..NewPhase::public("late", "val") };
    let refused = open_phase(&hall.data, &hall.store, &late).await.expect_err("shared missions").to_string();
    assert!(refused.contains("public phase 'practice'") && refused.contains("hint: "), "{refused}");
}

#[tokio::test]
async fn closed_phase_shares_missions_with_public() {
    let hall = Hall::new().await;
    hall.apply(FILE).await;
    let published = single("published", "hidden", "public");
    let refused = hall.refused(&published).await;
    assert!(refused.contains("phase 'finals' is hidden"), "{refused}");
    hall.reschedule("finals", |schedule| schedule.closed = true).await;
    hall.apply(&published).await;
}

#[tokio::test]
async fn published_secret_refuses_hidden_phases() {
    let hall = Hall::new().await;
    hall.apply(FILE).await;
    let late = single("late", "hidden", "team");
    let early = hall.plan(&late).await.expect("the secret is not published");
    hall.reschedule("finals", |schedule| schedule.closed = true).await;
    let seed = seed_to_publish(&hall.data, &hall.store, "finals").await.expect("a readable split");
    let note = AuditNote::default();
    hall.store.reveal_phase("finals", seed.as_ref(), note, 1 << 42).await.expect("a closed phase");

    let said = "phase 'late' is hidden, but the secret of split 'hidden' is published with phase 'finals'; \
                make another split: avln data split make NAME";
    let refused = hall.refused(&late).await;
    assert!(refused.starts_with("challenge.toml, line 3: ") && refused.contains(said), "{refused}");
    let refused = hall.planner().apply(early).await.expect_err("published since the check").to_string();
    assert!(refused.contains(said), "{refused}");
    let opened = NewPhase { replays: Visibility::Team, ..NewPhase::public("late", "hidden") };
    let refused = open_phase(&hall.data, &hall.store, &opened).await.expect_err("published").to_string();
    assert!(refused.contains(said), "{refused}");

    assert_eq!(hall.plan(FILE).await.expect("the closed phase stays").notes, []);
    hall.apply(&single("published", "hidden", "public")).await;
}

#[tokio::test]
async fn old_overlap_is_only_a_warning() {
    let hall = Hall::new().await;
    hall.apply(FILE).await;
    let finals = hall.store.phase("finals").await.expect("the phase");
    let practice = hall.store.phase("practice").await.expect("the phase");
    let old = Phase { split: finals.split, episodes: finals.episodes, ..practice };
    hall.store.upsert_phase(&old, 1).await.expect("a phase from before the rule");
    let text = FILE.replacen("split = \"val\"", "split = \"hidden\"", 1);
    let plan = hall.plan(&text).await.expect("an old overlap");
    assert_eq!(plan.notes, []);
    let summary = plan.summary(SummaryStyle::default());
    assert!(summary[0].starts_with("warning: phase 'finals' is hidden, but shares"), "{summary:?}");
    let refused = hall.refused(&text.replace("scores = \"organiser\"", "scores = \"team\"")).await;
    assert!(refused.contains("phase 'finals' is hidden"), "{refused}");
}

#[tokio::test]
async fn published_replays_keep_the_episode_order() {
    let hall = Hall::new().await;
    hall.apply(FILE).await;
    let arena = Arena::open(&hall.data, hall.store.clone(), SCENE_MEMORY_MIB).await.expect("phases");
    arena.start_run(&account(), request("finals")).await.expect("a run");
    let published = FILE.replace("replays = \"organiser\"", "replays = \"public\"");
    let plan = hall.plan(&published).await.expect("published replays");
    assert_eq!(plan.notes.iter().map(|note| note.what.as_str()).collect::<Vec<_>>(), ["replays"]);
    let refused = hall.refused(&published.replace("sample = {", "shuffle = false\nsample = {")).await;
    assert!(
        refused.starts_with("challenge.toml, line 15: `shuffle = false`: existing runs fix"),
        "{refused}"
    );
    assert_eq!(refused.lines().count(), 2, "{refused}");
}

#[tokio::test]
async fn opened_hidden_phase_draws_the_order() {
    let hall = Hall::new().await;
    hall.make("many", 7, 8).await;
    let public = NewPhase::public("many", "many");
    let hidden = NewPhase { scores: Visibility::Organiser, replays: Visibility::Organiser, ..public.clone() };
    open_phase(&hall.data, &hall.store, &hidden).await.expect("a hidden phase");
    let arena = Arena::open(&hall.data, hall.store.clone(), SCENE_MEMORY_MIB).await.expect("phases");
    let mut orders = Vec::new();
    for _ in 0..2 {
        let run = arena.start_run(&account(), request("many")).await.expect("a run").run;
        let view =
            hall.store.reader().run(&Viewer::Organiser, &run).await.expect("readable").expect("the run");
        orders.push(view.episodes.into_iter().map(|line| line.episode).collect::<Vec<_>>());
    }
    assert_eq!(orders[0].len(), 8);
    assert_ne!(orders[0], orders[1]);
    let published = open_phase(&hall.data, &hall.store, &public).await.expect("published replays");
    assert!(published.sampling.shuffle, "runs fix the draw");
}
