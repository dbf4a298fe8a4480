//! Logs: verification and rescoring of run logs, and the server's log.

/// `avln run verify` relies only on the run log. Teams download it; the check runs with and without the
/// organiser's data, and detects every forgery with valid hashes.
mod verification {
    use avln_arena::runlog::{Entry, History, RunLogs, SigningKey};
    use avln_client::{Client, RunOptions};
    use avln_tests::{PHASE, TestServer, TestSetup, clients::play_script, http};
    use std::{
        fs,
        path::{Path, PathBuf},
        process::Command,
    };
    use tempfile::TempDir;

    /// A server, a finished run, and its downloaded log.
    struct Played {
        server: TestServer,
        files: TempDir,
        log: PathBuf,
        key: String,
    }

    impl Played {
        async fn new() -> Self {
            let server = TestServer::open(&TestSetup::default()).await;
            let client = Client::connect(server.agents_url(), &server.token).await.expect("a connection");
            let open = client.start_run(RunOptions::new(PHASE, "idle")).await.expect("a run").id;
            let early = http::get(server.servers.web, &format!("/api/v1/runs/{open}/log")).await;
            assert_eq!(early.status, 400, "the run is not over: {}", early.body);
            let run = play_script(&server.agents_url(), &server.token, "walker").await;
            let answer = http::get(server.servers.web, &format!("/api/v1/runs/{run}/log")).await;
            assert_eq!(answer.status, 200, "{}", answer.body);
            let status = http::get(server.servers.web, "/api/v1/status").await;
            let status: serde_json::Value = serde_json::from_str(&status.body).expect("JSON");
            let files = TempDir::new().expect("a folder for temporary files");
            let log = files.path().join("fetched.log");
            fs::write(&log, answer.body).expect("a copy");
            Self { server, files, log, key: status["log_key"].as_str().expect("a key").to_owned() }
        }

        /// Runs `avln run verify` with the organiser's data; returns the exit code and output.
        fn verify(&self, log: &Path, more: &[&str]) -> (Option<i32>, String) {
            verify(self.server.folder.path(), log, more)
        }

        fn refused(&self, log: &Path, more: &[&str], words: &str) {
            let (code, text) = self.verify(log, more);
            assert!(code == Some(6) && text.contains(words), "'{words}' in: {text}");
        }

        /// An intact log whose end may be missing.
        fn unproven(&self, log: &Path, more: &[&str]) {
            let (code, text) = self.verify(log, more);
            assert!(code == Some(7) && text.contains("completeness is unproven"), "{text}");
            assert!(!text.contains("left out"), "{text}");
        }

        /// The log with other entries, in a chain that fits.
        fn forged(&self, forge: impl FnOnce(&mut Vec<Entry>)) -> PathBuf {
            let mut entries = History::read(&self.log).expect("the log").entries;
            forge(&mut entries);
            let folder = TempDir::new_in(self.files.path()).expect("a folder").keep();
            let logs = RunLogs::at(&folder);
            let mut entries = entries.into_iter();
            let first = entries.next().expect("a first line");
            let log = logs.open("forged", || first).expect("a log");
            entries.for_each(|entry| log.write(&entry).expect("a line"));
            logs.path("forged")
        }
    }

    fn verify(data: &Path, log: &Path, more: &[&str]) -> (Option<i32>, String) {
        let mut verify = Command::new(env!("CARGO_BIN_EXE_avln_under_test"));
        let output = verify
            .arg("--data")
            .arg(data)
            .args(["run", "verify"])
            .arg(log)
            .args(more)
            .output()
            .expect("the program runs");
        let text =
            String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
        (output.status.code(), text)
    }

    /// Removes signatures, so that only the replay can detect a forgery.
    fn unsign(entries: &mut Vec<Entry>) {
        entries.retain(|entry| !matches!(entry, Entry::Signed { .. }));
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn log_is_verified_with_and_without_organiser_data() {
        let played = Played::new().await;
        let (code, text) = played.verify(&played.log, &["--key", &played.key]);
        assert_eq!(code, Some(0), "{text}");
        for words in ["episodes   2 played again: all 82 actions", "metrics    2 recomputed", &played.key] {
            assert!(text.contains(words), "'{words}' in: {text}");
        }
        let nowhere = played.files.path().join("nowhere");
        for (data, more) in [(nowhere.as_path(), &[][..]), (played.server.folder.path(), &["--log-only"])] {
            let (code, text) = verify(data, &played.log, more);
            assert!(code == Some(0) && text.contains("2 with 82 actions, not played again"), "{text}");
            assert!(
                text.contains("none changed, left out or put in") && text.contains(&played.key),
                "{text}"
            );
        }
        assert!(!nowhere.exists(), "looking makes no folder");
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn forgeries_are_found() {
        let played = Played::new().await;
        let text = fs::read_to_string(&played.log).expect("the log");
        let spoiled = played.files.path().join("spoiled.log");
        fs::write(&spoiled, text.replacen("\"thought_us\":", "\"thought_us\":1", 1)).expect("a copy");
        played.refused(&spoiled, &[], "its hash does not match");

        let action = played.forged(|entries| {
            unsign(entries);
            let act = entries.iter_mut().find_map(|entry| match entry {
                Entry::Acted { step: 9, action, .. } => Some(action),
                _ => None,
            });
            *act.expect("a ninth step") = serde_json::from_str("\"TurnRight\"").expect("an action");
        });
        played.refused(&action, &["--key", &played.key], "not signed");
        played.refused(&action, &[], "step 9");

        let worth = played.forged(|entries| {
            unsign(entries);
            for entry in entries {
                if let Entry::Ended { metrics, .. } = entry {
                    metrics.sr = 1.0;
                }
            }
        });
        played.refused(&worth, &[], "the log contains");
        let other = SigningKey::at(&played.files.path().join("other.key")).expect("a key");
        RunLogs::at(worth.parent().expect("a folder")).sign("forged", &other).expect("a signature");
        played.refused(&worth, &["--key", &played.key], "not by");
        let (code, text) = played.verify(&worth, &["--log-only"]);
        assert!(code == Some(0) && text.contains(&other.public()) && !text.contains(&played.key), "{text}");

        let signature = played.forged(|entries| {
            if let Some(Entry::Signed { signature, .. }) = entries.last_mut() {
                let flipped = if signature.starts_with('0') { "1" } else { "0" };
                signature.replace_range(..1, flipped);
            }
        });
        played.refused(&signature, &["--log-only"], "the signature does not fit");

        let longer = played.forged(|entries| {
            let again = entries.iter().find(|entry| matches!(entry, Entry::Ended { .. })).cloned();
            entries.extend(again);
        });
        played.refused(&longer, &["--log-only"], "lines come after the signature");
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn missing_ends_are_found_or_declared_unproven() {
        let played = Played::new().await;
        let unsigned = played.forged(unsign);
        played.unproven(&unsigned, &["--log-only"]);
        played.refused(&unsigned, &["--log-only", "--key", &played.key], "not signed");
        played.refused(&unsigned, &[], "its log has no signature: lines are missing at its end");
        let cut = played.forged(|entries| entries.truncate(entries.len() / 2));
        played.unproven(&cut, &["--log-only"]);
        played.refused(&cut, &[], "lines are missing at its end");
        // Another data folder with the same phase does not contain the run.
        let elsewhere = TestServer::open(&TestSetup::default()).await;
        let (code, text) = verify(elsewhere.folder.path(), &cut, &[]);
        assert_eq!(code, Some(7), "{text}");
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn repeated_server_starts_are_found() {
        let played = Played::new().await;
        let forked = played.forged(|entries| {
            unsign(entries);
            let start = entries.iter().find(|entry| matches!(entry, Entry::ServerStarted { .. })).cloned();
            entries.push(start.expect("the start of the server"));
        });
        played.refused(&forked, &["--log-only"], "server start 1 follows start 1");
    }
}

/// Rescoring from the log: the same scorer results in the same bits, another scorer's result is stored
/// separately.
mod rescoring {
    use avln_arena::{
        data::DataFolder,
        replays::{Scorer, rescore},
    };
    use avln_store::Store;
    use avln_tests::{PHASE, TestServer, TestSetup, clients::play_script, http};
    use std::{path::Path, process::Command};

    /// Runs `avln run rescore`; returns the exit code and output.
    fn avln_rescore(folder: &Path, arguments: &[&str]) -> (Option<i32>, String) {
        let mut avln = Command::new(env!("CARGO_BIN_EXE_avln_under_test"));
        let output = avln
            .arg("--data")
            .arg(folder)
            .args(["run", "rescore"])
            .args(arguments)
            .output()
            .expect("the program runs");
        let text =
            String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
        (output.status.code(), text)
    }

    /// A different scorer: no goal is found, a collision counts twice.
    const STRICT: Scorer = Scorer {
        version: "9.0.0",
        score: |truth, record, rules| {
            let mut metrics = (Scorer::OURS.score)(truth, record, rules);
            metrics.collisions *= 2;
            metrics
        },
    };

    async fn store(server: &TestServer) -> Store {
        DataFolder::open(server.folder.path()).expect("the folder").store().await.expect("its database")
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn rescoring_repeats_bits_and_stores_other_scorers() {
        let server = TestServer::open(&TestSetup::default()).await;
        let run = play_script(&server.agents_url(), &server.token, "walker").await;
        let folder = server.folder.path();
        for arguments in [&[run.as_str()][..], &["--phase", PHASE]] {
            let (code, text) = avln_rescore(folder, arguments);
            assert_eq!(code, Some(0), "{text}");
            assert!(text.contains("nothing changed") && text.contains("1 run scored by benchmark"), "{text}");
        }
        let (code, json) = avln_rescore(folder, &[&run, "--json"]);
        let output: serde_json::Value = serde_json::from_str(&json).expect("JSON");
        assert_eq!(
            (code, &output[0]["is_kept"], &output[0]["episodes"]),
            (Some(0), &false.into(), &2.into())
        );

        let page = async |path: &str| http::get(server.servers.web, path).await.body;
        let board = page(&format!("/api/v1/phases/{PHASE}/leaderboard?order=unordered")).await;
        let store = store(&server).await;
        let row = store.run(&run).await.expect("the run");
        let compared = rescore(&store, &row, &STRICT, 77).await.expect("records");
        assert!(compared.is_kept && !compared.contradicts());
        let (before, after) = (compared.before.expect("a summary"), compared.after.expect("a summary"));
        assert!(before.collisions > 0.0, "the scripted run collides");
        assert_eq!(after.collisions, 2.0 * before.collisions);
        assert_eq!(after.sr, before.sr);
        assert_eq!(
            page(&format!("/api/v1/phases/{PHASE}/leaderboard?order=unordered")).await,
            board,
            "boards show the first scores"
        );
        assert!(board.contains(&format!("\"scorer\":\"{}\"", row.scorer())), "{board}");
        let shown = page(&format!("/runs/{run}")).await;
        assert!(shown.contains("Rescoring") && shown.contains("9.0.0"), "{shown}");
        assert!(page(&format!("/leaderboard/{PHASE}?order=unordered")).await.contains("Scored by benchmark"));
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn calibration_reports_conflicts_and_missing_records() {
        let server = TestServer::open(&TestSetup::default()).await;
        let run = play_script(&server.agents_url(), &server.token, "walker").await;
        let store = store(&server).await;
        let row = store.run(&run).await.expect("the run");
        let forged = Scorer { version: Scorer::OURS.version, ..STRICT };
        let compared = rescore(&store, &row, &forged, 77).await.expect("records");
        assert!(compared.contradicts() && !compared.is_kept && !compared.changed.is_empty());

        let (code, text) = avln_rescore(server.folder.path(), &["run_of_nobody"]);
        assert!(code == Some(3) && text.contains("run_of_nobody"), "{text}");
        let (code, text) = avln_rescore(server.folder.path(), &[]);
        assert!(code == Some(2) && text.contains("--phase"), "{text}");
        let note = avln_store::AuditNote::default();
        store.prune_records(i64::MAX, note, 78).await.expect("records go");
        let (code, text) = avln_rescore(server.folder.path(), &[&run]);
        assert!(code == Some(3) && text.contains("2 episode records"), "{text}");
    }
}

/// The server's log as JSON.
mod server_log {
    use avln_tests::Server;
    use serde_json::Value;
    use std::{fs, path::Path, process::Command};

    const PROGRAM: &str = env!("CARGO_BIN_EXE_avln_under_test");

    /// Runs the program with a data folder and returns the output.
    fn avln(data: &Path, arguments: &[&str]) -> String {
        let mut command = Command::new(PROGRAM);
        command.env_remove("AVLN_TOKEN").arg("--data").arg(data).args(arguments);
        let output = command.output().expect("the program runs");
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8_lossy(&output.stdout).into_owned()
    }

    /// Returns the field of the span `name` around a log line.
    fn around<'a>(line: &'a Value, name: &str, field: &str) -> &'a Value {
        let spans = line["spans"].as_array().expect("spans");
        &spans.iter().find(|span| span["name"] == name).expect(name)[field]
    }

    #[test]
    fn json_log_has_each_step_with_its_durations() {
        let folder = tempfile::tempdir().expect("a folder");
        let data = folder.path();
        avln(data, &["data", "split", "make", "val", "--houses", "1", "--missions", "1", "--seed", "7"]);
        avln(data, &["challenge", "phase", "open", "practice", "--split", "val"]);
        let output = avln(data, &["challenge", "team", "add", "ada"]);
        let token = output.split_whitespace().find(|word| word.starts_with("avln_")).expect("a token");
        // The options of docs/OPERATING.md.
        let options = ["--log", "warn,avln_grpc=debug,avln_arena=debug", "--log-format", "json"];
        let server = Server::start_with(PROGRAM, data, &options);
        let url = format!("http://{}", server.grpc);
        let played = avln(data, &["agent", "random", "--server", &url, "--token", token]);
        let run = played.split(':').next().expect("a run");

        let log = fs::read_to_string(data.join("server.log")).expect("a log");
        let lines: Vec<Value> = log.lines().map(|line| serde_json::from_str(line).expect(line)).collect();
        let steps: Vec<&Value> =
            lines.iter().filter(|line| line["fields"]["message"] == "step ended").collect();
        for (number, step) in steps.iter().enumerate() {
            assert_eq!(step["span"]["step"], number as u64 + 1, "{step}");
            let parts_ms =
                ["queue_ms", "simulation_ms", "encoding_ms"].map(|part| step["span"][part].as_f64());
            let sum_ms = parts_ms.iter().map(|part| part.expect("a duration")).sum::<f64>();
            let duration_ms = step["span"]["duration_ms"].as_f64().expect("a duration");
            // Each part is rounded to milliseconds.
            assert!(sum_ms <= duration_ms + 3.0, "{step}");
            assert_eq!(step["spans"][0]["run"], run, "{step}");
            assert!(around(step, "episode", "episode").as_str().is_some_and(|id| !id.is_empty()), "{step}");
        }
        let ended = lines.iter().find(|line| line["fields"]["message"] == "episode ended").expect("an end");
        assert_eq!(ended["span"]["steps"], steps.len() as u64, "{ended}");
        assert!(!log.contains(token), "tokens are never logged");
    }
}
