//! Backups, old runs, and refused changes of the database.

/// A backup of a busy server restores the same leaderboard, the same logs and the open run.
mod backups {
    use avln_client::{Action, Client, Observation, Order, Play, RunOptions};
    use avln_tests::{
        PHASE, Server, TestSetup,
        clients::{NO_SENSORS, play_script},
        http,
        proxies::FaultProxy,
        set_up,
    };
    use serde_json::Value;
    use std::{
        fs,
        net::SocketAddr,
        path::Path,
        process::Command,
        sync::atomic::{AtomicBool, AtomicU32, Ordering},
        time::Duration,
    };
    use tokio::task::JoinSet;

    const PROGRAM: &str = env!("CARGO_BIN_EXE_avln_under_test");
    /// Steps after which the wanderer stops.
    const STEPS: u32 = 120;
    /// Slots of the continued run.
    const SLOTS: u32 = 3;

    /// Runs the program on the data folder `data`; returns success and output.
    fn avln(data: &Path, arguments: &[&str]) -> (bool, String) {
        let output =
            Command::new(PROGRAM).arg("--data").arg(data).args(arguments).output().expect("it starts");
        let text =
            String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
        (output.status.success(), text)
    }

    fn done(data: &Path, arguments: &[&str]) -> String {
        let (content, text) = avln(data, arguments);
        assert!(content, "{arguments:?}: {text}");
        text
    }

    /// Chooses actions from the observation only, so interruptions do not change them.
    fn wander(seen: &Observation) -> Action {
        let place = seen.pose.position().map(f32::to_bits);
        let mixed = place.into_iter().chain([seen.pose.heading_rad().to_bits(), seen.step]);
        let draw =
            mixed.fold(0x9e37_79b9_u32, |hash, word| (hash ^ word).wrapping_mul(0x85eb_ca6b).rotate_left(13));
        match draw % 100 {
            _ if seen.step >= STEPS => Action::Stop,
            0..=20 => Action::TurnLeft,
            21..=30 => Action::TurnRight,
            _ => Action::MoveForward,
        }
    }

    /// Step counter and brake of the players.
    struct Pace {
        steps: AtomicU32,
        held: AtomicBool,
        hold_at: u32,
        pause: Duration,
    }

    impl Pace {
        const fn new(hold_at: u32, pause: Duration) -> Self {
            Self { steps: AtomicU32::new(0), held: AtomicBool::new(false), hold_at, pause }
        }

        async fn step(&self) {
            tokio::time::sleep(self.pause).await;
            if self.steps.fetch_add(1, Ordering::AcqRel) + 1 == self.hold_at {
                self.held.store(true, Ordering::Release);
            }
            while self.held.load(Ordering::Acquire) {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
        }
    }

    async fn play_slot(mut play: Play, pace: &Pace) -> Play {
        while let Some(mut episode) = play.next_episode().await.expect("a slot that plays to the end") {
            while !episode.is_over() {
                let action = wander(episode.observation());
                pace.step().await;
                episode.step(action).await.expect("a legal step");
            }
        }
        play
    }

    /// Plays a run in several slots; returns the id.
    async fn play_run(url: String, token: String, method: &str, pace: &'static Pace) -> String {
        let client = Client::connect(url, &token).await.expect("a connection");
        let run =
            client.start_run(RunOptions::new(PHASE, method).order(Order::Unordered)).await.expect("a run");
        let mut players = JoinSet::new();
        for play in client.play_slots(&run, NO_SENSORS, SLOTS).await.expect("a stream") {
            players.spawn(play_slot(play, pace));
        }
        let mut last = None;
        while let Some(joined) = players.join_next().await {
            last = Some(joined.expect("no panic"));
        }
        assert!(last.expect("a slot").finish().await.expect("a summary").complete);
        run.id
    }

    /// Episode results from the API.
    async fn worth(web: SocketAddr, run: &str) -> Vec<Value> {
        let body = http::get(web, &format!("/api/v1/runs/{run}")).await;
        let run: Value = serde_json::from_str(&body.body).expect("JSON");
        let episodes = run["episodes"].as_array().expect("episodes");
        episodes
            .iter()
            .map(|line| serde_json::json!([line["ordinal"], line["end"], line["metrics"]]))
            .collect()
    }

    async fn board(web: SocketAddr) -> String {
        http::get(web, &format!("/api/v1/phases/{PHASE}/leaderboard?order=unordered")).await.body
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn backup_of_busy_server_continues_elsewhere() {
        static CALM: Pace = Pace::new(u32::MAX, Duration::ZERO);
        static HELD: Pace = Pace::new(200, Duration::ZERO);
        // Long enough for the backup to be made meanwhile.
        static BUSY: Pace = Pace::new(u32::MAX, Duration::from_millis(10));
        let place = tempfile::tempdir().expect("a folder");
        let (old, new, file) =
            (place.path().join("old"), place.path().join("new"), place.path().join("backup.tar"));
        let token = set_up(&old, &TestSetup { houses: 1, missions: 8, ..TestSetup::default() }).await;
        let server = Server::start(PROGRAM, &old);
        let proxy = FaultProxy::open(server.grpc).await;
        let over = play_script(&proxy.url(), &token, "over before").await;
        let calm = play_run(proxy.url(), token.clone(), "calm", &CALM).await;
        let (before, verified) = (board(server.web).await, check(&old, &over));

        // One run is paused; another continues during the backup.
        let held = tokio::spawn(play_run(proxy.url(), token.clone(), "held", &HELD));
        while !HELD.held.load(Ordering::Acquire) {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        tokio::time::sleep(Duration::from_millis(300)).await;
        let busy = tokio::spawn(play_run(format!("http://{}", server.grpc), token.clone(), "busy", &BUSY));
        while BUSY.steps.load(Ordering::Acquire) < 60 {
            tokio::time::sleep(Duration::from_millis(2)).await;
        }
        let said = done(&old, &["data", "db", "backup", &file.display().to_string()]);
        assert!(!busy.is_finished(), "the run was over before the backup was");
        assert!(said.contains("4 runs (2 open)") && said.contains("4 run logs"), "{said}");
        let (content, said) = avln(&old, &["data", "db", "backup", &file.display().to_string()]);
        assert!(!content && said.contains("already exists"), "{said}");
        busy.abort();
        server.kill();

        let said = done(&new, &["data", "db", "restore", &file.display().to_string()]);
        assert!(said.contains("4 runs (2 open)"), "{said}");
        let (content, said) = avln(&new, &["data", "db", "restore", &file.display().to_string()]);
        assert!(!content && said.contains("new or empty folder"), "{said}");
        assert_eq!(check(&new, &over), verified, "the same log by the same key");
        let logs = fs::read_dir(new.join("runs")).expect("logs").map(|log| log.expect("a log").path());
        for log in logs {
            let (content, said) = avln(&new, &["run", "verify", &log.display().to_string()]);
            assert!(content || said.contains("completeness is unproven"), "an open run: {said}");
        }
        let server = Server::start(PROGRAM, &new);
        assert_eq!(board(server.web).await, before);
        proxy.redirect(server.grpc);
        proxy.cut();
        HELD.held.store(false, Ordering::Release);
        let held = held.await.expect("no panic");
        assert_eq!(worth(server.web, &held).await, worth(server.web, &calm).await, "it went on where it was");
        check(&new, &held);
    }

    /// Output of `avln run verify` for a run.
    fn check(data: &Path, run: &str) -> String {
        let log = data.join("runs").join(format!("{run}.log"));
        done(data, &["run", "verify", &log.display().to_string()])
    }
}

/// Old logs and traces can be deleted; results remain.
mod pruning {
    use avln_arena::backup::{self, PruneOptions, Pruned};
    use avln_arena::now_unix_ms;
    use avln_tests::{PHASE, TestServer, TestSetup, clients::play_script, http};
    use std::process::Command;

    #[tokio::test(flavor = "multi_thread")]
    async fn old_logs_and_records_go_and_scores_stay() {
        let server = TestServer::open(&TestSetup::default()).await;
        let run = play_script(&server.agents_url(), &server.token, "walker").await;
        let log = server.folder.path().join("runs").join(format!("{run}.log"));
        let page = async |path: &str| http::get(server.servers.web, path).await;
        let board = page(&format!("/api/v1/phases/{PHASE}/leaderboard?order=unordered")).await.body;
        let prune = |more: &[&str]| {
            let mut avln = Command::new(env!("CARGO_BIN_EXE_avln_under_test"));
            let output = avln
                .arg("--data")
                .arg(server.folder.path())
                .args(["data", "db", "prune"])
                .args(more)
                .output();
            let output = output.expect("the program runs");
            let text = String::from_utf8_lossy(&output.stdout).into_owned()
                + &String::from_utf8_lossy(&output.stderr);
            (output.status.code(), text)
        };
        let (code, text) = prune(&["--older-than", "1d", "--records"]);
        assert!(code == Some(0) && text.contains("0 runs ended before"), "{text}");
        assert!(log.exists(), "it is not a day old");
        assert_eq!(prune(&["--older-than", "yesterday"]).0, Some(2));

        // Two days later.
        let later = now_unix_ms() + 2 * 86_400_000;
        let prune = async |records, dry_run| {
            let options = PruneOptions { older_than_days: 1, records, dry_run };
            backup::prune(server.folder.path(), &options, later).await.expect("it can go")
        };
        let trial = prune(true, true).await;
        assert_eq!((trial.runs, trial.logs, trial.records), (1, 1, 2));
        assert!(log.exists() && trial.bytes == log.metadata().expect("a log").len(), "nothing went");
        assert_eq!(prune(false, false).await, Pruned { records: 0, ..trial });
        assert!(!log.exists());
        assert_eq!(page(&format!("/api/v1/runs/{run}/log")).await.status, 404);
        assert_eq!(prune(true, false).await, Pruned { logs: 0, bytes: 0, ..trial });
        let after = page(&format!("/api/v1/phases/{PHASE}/leaderboard?order=unordered")).await.body;
        assert_eq!(after, board);
        assert_eq!(page(&format!("/runs/{run}/episodes/0")).await.status, 200, "without a replay");
    }
}

/// Attempts lost while the database refuses changes.
mod refusals {
    use crate::faults::{begin, end_of, expect, hanging, play_on, server, verdict};
    use avln_client::{Action, EndReason};
    use avln_store::RunState;
    use sqlx::{Connection, SqliteConnection, sqlite::SqliteConnectOptions};
    use std::{path::Path, time::Duration};
    use tokio::time::sleep;

    /// Lets the database refuse changes of episodes, or accept them again.
    async fn refuse_episodes(folder: &Path, refuses: bool) {
        let database = SqliteConnectOptions::new().filename(folder.join("avln.db"));
        let mut other = SqliteConnection::connect_with(&database).await.expect("the database");
        let change = match refuses {
            true => {
                "CREATE TRIGGER refusal BEFORE UPDATE ON episodes BEGIN SELECT RAISE(ABORT, 'no space'); END"
            }
            false => "DROP TRIGGER refusal",
        };
        sqlx::query(change).execute(&mut other).await.expect("a change of the schema");
        other.close().await.expect("the end of it");
    }

    /// Time in which the server looks for episodes that it could not return.
    const NEXT_LOOK: Duration = Duration::from_millis(2500);

    #[tokio::test(flavor = "multi_thread")]
    async fn unstored_loss_of_hanging_step_is_stored_later() {
        let (server, go_on) = hanging().await;
        let (run, mut play) = begin(&server.agents_url(), &server.token).await;
        let mut episode = play.next_episode().await.expect("an answer").expect("an episode");
        refuse_episodes(server.folder.path(), true).await;
        episode.step(Action::TurnLeft).await.expect("it learns of the end");
        assert_eq!(end_of(&episode), Some(EndReason::ServerFault));
        refuse_episodes(server.folder.path(), false).await;
        sleep(NEXT_LOOK).await;
        play_on(play).await.expect("to the end");
        let expected = expect("stopped stopped", RunState::Completed, true);
        assert_eq!(verdict(server.folder.path(), &run.id).await, expected);
        drop(go_on);
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn restart_keeps_an_announced_loss() {
        let server = server(|_| ()).await;
        let (run, mut play) = begin(&server.agents_url(), &server.token).await;
        let mut episode = play.next_episode().await.expect("an answer").expect("an episode");
        refuse_episodes(server.folder.path(), true).await;
        episode.step(Action::Stop).await.expect("it learns of the end");
        assert_eq!(end_of(&episode), Some(EndReason::ServerFault), "the result is not stored");
        drop(play);
        let server = server.reopen().await;
        refuse_episodes(server.folder.path(), false).await;
        sleep(NEXT_LOOK).await;
        let expected = expect("- -", RunState::Running, true);
        assert_eq!(
            verdict(server.folder.path(), &run.id).await,
            expected,
            "the result in the log does not count"
        );
    }
}
