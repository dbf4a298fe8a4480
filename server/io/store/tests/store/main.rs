//! The store on a real file: results, transactions, crashes, foreign files, upgrades and visibility. This file has the fixture: a
//! database with one phase, two teams and canary names.

mod leaderboard;
mod opening;
mod phases;
mod play;
mod quota;
mod views;

use avln_challenge::{GoalText, MethodInfo, PhaseEpisode, TimeAccount};
use avln_episode::{Action, EndReason, Modality, Order, Pose, Rules, Sensors};
use avln_scoring::{Metrics, score};
use avln_store::{
    AssignedEpisode, AuditNote, EpisodeResult, NewRun, Phase, RecordedResult, Scene, SceneMap, Split, Store,
    StoreError,
};
use avln_truth::{EpisodeTruth, Record, StepFacts, SubmitFacts};
use serde_json::json;
use std::{collections::BTreeMap, path::PathBuf, sync::LazyLock};
use tempfile::TempDir;

pub(crate) const SCENES: [&str; 2] = ["canary-scene-a", "canary-scene-b"];
pub(crate) const CATEGORY: &str = "canary-category";
pub(crate) const SENTENCE: &str = "canary-sentence";
pub(crate) const EPISODE: &str = "canary-episode";
pub(crate) const TEAM: &str = "red";

pub(crate) struct Arena {
    pub(crate) folder: TempDir,
    pub(crate) store: Store,
}

/// Returns an open phase of `episodes` episodes in two scenes, with two goals each.
pub(crate) fn phase(id: &str, episodes: usize) -> Phase {
    let goals = vec![
        GoalText { modality: Modality::Category, text: Some(CATEGORY.to_owned()) },
        GoalText { modality: Modality::Description, text: Some(SENTENCE.to_owned()) },
    ];
    let episode = |index: usize| PhaseEpisode {
        episode: format!("{EPISODE}-{index}"),
        scene: SCENES[index % 2].to_owned(),
        goals: goals.clone(),
    };
    Phase {
        title: "Practice".to_owned(),
        sensors: Sensors::all(256, 256),
        max_slots: 4,
        ..Phase::new(id, "val", Rules::paper(), (0..episodes).map(episode).collect())
    }
}

impl Arena {
    pub(crate) async fn new(phase: &Phase) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let store = Store::open(&folder.path().join("arena.db")).await.expect("a new database");
        let arena = Self { folder, store };
        arena.fill(phase).await.expect("a first phase");
        arena
    }

    async fn fill(&self, phase: &Phase) -> Result<(), StoreError> {
        let split = Split { name: "val".to_owned(), digest: "d".to_owned(), scenes: 2, episodes: 9 };
        self.store.upsert_split(&split).await?;
        for name in SCENES {
            let polygons = vec![vec![[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 0.0, 4.25]]];
            let map = SceneMap { min: [0.0; 3], max: [4.0, 3.0, 4.0], polygons };
            self.store.upsert_scene(&Scene { name: name.to_owned(), digest: name.to_owned(), map }).await?;
        }
        self.store.upsert_phase(phase, 1).await?;
        self.store.create_team(TEAM, None, 1).await?;
        self.store.create_team("blue", None, 1).await
    }

    pub(crate) fn path(&self) -> PathBuf {
        self.folder.path().join("arena.db")
    }

    /// Reopens the database as after a crash, without closing it first.
    pub(crate) async fn after_crash(self) -> Self {
        let Self { folder, store } = self;
        drop(store);
        let store = Store::open(&folder.path().join("arena.db")).await.expect("our own database");
        Self { folder, store }
    }

    /// Plays a run of the phase `practice` to its end; the agent finds the first `found` goals of each episode.
    pub(crate) async fn play(&self, run: &str, method: &str, order: Order, found: u8) {
        self.play_as(TEAM, run, method, order, found).await;
    }

    /// Plays a run of `team` as [`Arena::play`] does.
    pub(crate) async fn play_as(&self, team: &str, run: &str, method: &str, order: Order, found: u8) {
        self.play_method(team, run, &MethodInfo::new(method, "1"), order, found).await;
    }

    /// Plays a run of `team` as [`Arena::play`] does, with a described method.
    pub(crate) async fn play_method(
        &self,
        team: &str,
        run: &str,
        method: &MethodInfo,
        order: Order,
        found: u8,
    ) {
        let digests = BTreeMap::new();
        let new = NewRun { id: run, token: run, team, method, order, ..new_run(&digests) };
        self.store.start_run(&new, 10).await.expect("a run");
        let mut index = 0;
        while let Some(assigned) = self.assign(run, &format!("{run}-handle-{index}")).await {
            let played = Played::new(&assigned, order, found, EndReason::Stopped);
            self.record(run, &assigned.handle, &played).await.expect("a result");
            index += 1;
        }
    }

    pub(crate) async fn assign(&self, run: &str, handle: &str) -> Option<AssignedEpisode> {
        self.store.assign_next_episode(run, handle, 20).await.expect("an open run")
    }

    pub(crate) async fn record(
        &self,
        run: &str,
        handle: &str,
        played: &Played,
    ) -> Result<RecordedResult, StoreError> {
        self.store.record_result(&played.result(run, handle), 30).await
    }
}

static WALKER: LazyLock<MethodInfo> = LazyLock::new(|| MethodInfo::new("walker", "1"));

/// Returns an audit note about `what`.
pub(crate) fn note(what: &str) -> AuditNote {
    AuditNote { actor: "ada".to_owned(), what: what.to_owned(), ..AuditNote::default() }
}

/// Returns a request of the team `red` for the phase `practice`.
pub(crate) fn new_run(digests: &BTreeMap<String, String>) -> NewRun<'_> {
    NewRun {
        id: "run_1",
        token: "secret-of-run-1",
        phase: "practice",
        team: TEAM,
        method: &WALKER,
        order: Order::Unordered,
        client_request_id: None,
        digests,
    }
}

/// A finished episode.
pub(crate) struct Played {
    pub(crate) truth: EpisodeTruth,
    pub(crate) record: Record,
    pub(crate) metrics: Metrics,
    pub(crate) time: TimeAccount,
}

impl Played {
    /// Returns an episode with four steps of 0.3125 m and two Submits; the first `found` complete a goal.
    pub(crate) fn new(assigned: &AssignedEpisode, order: Order, found: u8, end: EndReason) -> Self {
        let truth = truth(&assigned.episode, &assigned.scene, order);
        let record = record(found, end);
        let metrics = score(&truth, &record, &Rules::paper());
        let time = TimeAccount { simulation_s: 0.5, thinking_s: 1.5, ..TimeAccount::default() };
        Self { truth, record, metrics, time }
    }

    pub(crate) fn result<'a>(&'a self, run: &'a str, handle: &'a str) -> EpisodeResult<'a> {
        let Self { truth, record, metrics, time } = self;
        EpisodeResult { run, handle, truth, record, metrics, time }
    }
}

fn truth(episode: &str, scene: &str, order: Order) -> EpisodeTruth {
    let target = |category: &str, modality: &str| {
        json!({
            "instance": 54321, "category": category, "modality": modality,
            "bounds": { "min": [1.0, 0.0, 1.0], "max": [2.0, 1.0, 2.0] }, "source": [1.5, 0.5, 1.5],
            "floor_y_m": 0.0, "region": [[1.0, 0.0, 0.5]], "viewpoints": [], "start_distance_m": 1.0,
        })
    };
    serde_json::from_value(json!({
        "episode": episode, "scene": scene, "seed": 77_777, "order": order,
        "start": { "position": [0.1, 0.0, 0.25], "heading_rad": 0.1 },
        "targets": [target(CATEGORY, "category"), target("vase", "description")],
        "reference_m": 1.1, "reference_path": [[0.1, 0.0, 0.2], [3.875, 0.0, 0.5]],
    }))
    .expect("a truth in JSON")
}

fn record(found: u8, end: EndReason) -> Record {
    let start = Pose { position: [0.1, 0.0, 0.25].into(), heading_rad: 0.1 };
    let step = |index: u8| {
        let walks = index < 4;
        let mut pose = start;
        pose.position.z -= f32::from(index.min(3) + 1) * 0.3125;
        StepFacts {
            action: if walks { Action::MoveForward } else { Action::Submit },
            pose,
            collided: index == 2,
            in_region: 0,
            sounding: Some(index % 2),
            state_hash: u64::from(index) << 60,
        }
    };
    let submit = |goal: u8| SubmitFacts {
        step: 5 + u32::from(goal),
        completed: (goal < found).then_some(goal),
        skipped: None,
        wrong_instance: None,
    };
    Record {
        rules: Rules::PAPER.to_owned(),
        start,
        steps: (0..6).map(step).collect(),
        submits: (0..2).map(submit).collect(),
        in_region_at_start: vec![false, false],
        final_distance_m: vec![Some(0.75), None],
        end,
    }
}
