//! Teams, organisers and operators.

/// Sign-in on the web server: team pages and organiser pages.
mod sign_in {
    use avln_client::{Action, Client, EndReason, Error, Order, Reason, RunOptions, Sensors};
    use avln_store::AuditLine;
    use avln_tests::{
        PHASE, TEAM, TestServer, TestSetup,
        clients::play_script,
        http::{self, Answer, Visitor},
        store,
    };
    use std::time::Duration;
    use tokio::time::sleep;
    use tokio_stream::StreamExt;

    /// The token that a page shows.
    fn shown_token(page: &Answer) -> String {
        let secret = page.body.split("<code>avln_").nth(1).and_then(|rest| rest.split('<').next());
        format!("avln_{}", secret.unwrap_or_else(|| panic!("no token in {}", page.body)))
    }

    async fn audit(server: &TestServer) -> Vec<AuditLine> {
        let store = store(server.folder.path()).await;
        let lines = store.audit().await.expect("the audit list");
        store.close().await;
        lines
    }

    async fn start(server: &TestServer) -> Result<String, Error> {
        let client = Client::connect(server.agents_url(), &server.token).await.expect("a connection");
        Ok(client.start_run(RunOptions::new(PHASE, "walker").order(Order::Unordered)).await?.id)
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn team_manages_tokens_and_cancels_runs() {
        let server = TestServer::open(&TestSetup::default()).await;
        let team = Visitor::sign_in(server.servers.web, &server.token).await;
        let page = team
            .act("/me", &[("action", "issue"), ("name", "laptop"), ("kind", "read_only"), ("days", "2")])
            .await;
        let token = shown_token(&page);
        let looking = Client::connect(server.agents_url(), &token).await.expect("a connection");
        let account = looking.whoami().await.expect("an account");
        assert_eq!((account.team.as_str(), account.token_name.as_str()), (TEAM, "laptop"));
        let refused =
            looking.start_run(RunOptions::new(PHASE, "walker")).await.expect_err("it is for looking");
        assert_eq!(refused.reason(), Some(Reason::TokenScope), "{refused}");
        let looker = Visitor::sign_in(server.servers.web, &token).await;
        assert_eq!(looker.get("/me").await.status, 200);

        let run = start(&server).await.expect("a run");
        let cancelled = team.act("/me", &[("action", "cancel"), ("run", &run)]).await;
        assert_eq!(cancelled.status, 303, "{}", cancelled.body);
        assert!(team.get("/me").await.body.contains(&format!("Run {run} is cancelled.")));
        let again = team.act("/me", &[("action", "cancel"), ("run", &run)]).await;
        assert_eq!((again.status, again.body.contains("is cancelled")), (409, true), "{}", again.body);

        let tokens = store(server.folder.path()).await.tokens().await.expect("tokens");
        let id = tokens.iter().find(|token| token.name == "laptop").expect("the token").id.clone();
        assert_eq!(team.act("/me", &[("action", "revoke"), ("id", &id)]).await.status, 303);
        looking.whoami().await.expect_err("it is void");
        assert_eq!(looker.get("/me").await.status, 303, "its session is over too");
        let deeds: Vec<_> =
            audit(&server).await.into_iter().filter(|line| line.actor.starts_with("token ")).collect();
        let output: Vec<_> = deeds.iter().map(|line| (line.subject.as_str(), line.what.as_str())).collect();
        let (of_team, of_run, of_token) =
            (format!("team {TEAM}"), format!("run {run}"), format!("token {id}"));
        let expected = [
            (of_team.as_str(), "token for looking"),
            (of_run.as_str(), "cancelled"),
            (of_token.as_str(), "revoked"),
        ];
        assert_eq!(output, expected);
        assert!(deeds.iter().all(|line| line.actor.ends_with(&format!(" of team {TEAM}"))), "{deeds:?}");
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn cancelling_on_page_ends_agent_run() {
        let server = TestServer::open(&TestSetup { houses: 1, missions: 2, ..TestSetup::default() }).await;
        let client = Client::connect(server.agents_url(), &server.token).await.expect("a connection");
        let run = client.start_run(RunOptions::new(PHASE, "walker")).await.expect("a run");
        let blind = Sensors { rgb: false, depth: false, audio: false, width: 64, height: 64, hfov_rad: 1.57 };
        let mut episodes = client.play(&run, blind).await.expect("a stream").episodes();
        let mut episode = episodes.try_next().await.expect("an answer").expect("an episode");
        episode.step(Action::TurnLeft).await.expect("it is open");
        let team = Visitor::sign_in(server.servers.web, &server.token).await;
        assert_eq!(team.act("/me", &[("action", "cancel"), ("run", &run.id)]).await.status, 303);
        let mut steps = 0;
        while steps < 500 && episode.end().is_none() && episode.step(Action::TurnLeft).await.is_ok() {
            steps += 1;
            sleep(Duration::from_millis(20)).await;
        }
        assert!(steps < 500, "it plays on");
        assert!(episode.end().is_none_or(|end| end.reason == EndReason::Abandoned), "{:?}", episode.end());
        drop(episode);
        let over = episodes.try_next().await.expect_err("nothing is left to play");
        assert_eq!(over.reason(), Some(Reason::RunOver), "{over}");
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn team_cannot_change_other_teams() {
        let server = TestServer::open(&TestSetup::default()).await;
        let organiser = server.organiser().await;
        let office = Visitor::sign_in(server.servers.web, &organiser).await;
        let page =
            office.act("/organise/teams", &[("action", "admit"), ("team", "blue"), ("reason", "")]).await;
        let blue = Visitor::sign_in(server.servers.web, &shown_token(&page)).await;
        let run = start(&server).await.expect("a run");
        for (what, id) in [("cancel", run.as_str()), ("cancel", "run_of_nobody")] {
            let refused = blue.act("/me", &[("action", what), ("run", id)]).await;
            assert_eq!(refused.status, 409, "{}", refused.body);
            assert!(refused.body.contains("there is no run"), "{}", refused.body);
        }
        let tokens = store(server.folder.path()).await.tokens().await.expect("tokens");
        for token in tokens.iter().filter(|token| token.team.as_deref() != Some("blue")) {
            assert_eq!(blue.act("/me", &[("action", "revoke"), ("id", &token.id)]).await.status, 409);
        }
        start(&server).await.expect("the other team goes on");
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn the_organiser_pauses_rules_and_grants() {
        let server = TestServer::open(&TestSetup::default()).await;
        let organiser = Visitor::sign_in(server.servers.web, &server.organiser().await).await;
        let phase = format!("/organise/phases/{PHASE}");
        let paused = organiser.act(&phase, &[("action", "pause"), ("reason", "the roof leaks")]).await;
        assert_eq!(paused.status, 303, "{}", paused.body);
        let refused = start(&server).await.expect_err("a paused phase");
        assert_eq!(refused.reason(), Some(Reason::PhasePaused), "{refused}");
        assert!(refused.to_string().contains("the roof leaks"), "{refused}");
        assert_eq!(organiser.act(&phase, &[("action", "resume"), ("reason", "it is dry")]).await.status, 303);
        let run = play_script(&server.agents_url(), &server.token, "walker").await;
        let change_phase = format!("/organise/runs/{run}");
        assert_eq!(
            organiser.act(&change_phase, &[("action", "verify"), ("reason", "we ran it")]).await.status,
            303
        );
        let board = format!("/leaderboard/{PHASE}?order=unordered");
        assert!(http::get(server.servers.web, &board).await.body.contains(">verified</span>"));
        let out = [("action", "disqualify"), ("reason", "it knew the houses")];
        assert_eq!(organiser.act(&change_phase, &out).await.status, 303);
        assert!(!http::get(server.servers.web, &board).await.body.contains(&run));
        assert!(
            http::get(server.servers.web, &format!("/runs/{run}")).await.body.contains("it knew the houses")
        );
        let grant =
            [("action", "grant"), ("team", TEAM), ("phase", PHASE), ("runs", "2"), ("reason", "a full disk")];
        assert_eq!(organiser.act("/organise/teams", &grant).await.status, 303);
        let unknown =
            [("action", "grant"), ("team", "nobody"), ("phase", PHASE), ("runs", "2"), ("reason", "x")];
        assert_eq!(organiser.act("/organise/teams", &unknown).await.status, 409);
        assert!(organiser.get("/organise/health").await.body.contains("Steps since the start"));
        let reveal = [("action", "reveal"), ("reason", ""), ("typed", PHASE)];
        assert_eq!(organiser.act(&phase, &reveal).await.status, 409, "it is open");
        let close = [("action", "close"), ("reason", "it is over"), ("typed", PHASE)];
        assert_eq!(organiser.act(&phase, &close).await.status, 303);
        assert_eq!(organiser.act(&phase, &reveal).await.status, 303);
        assert!(organiser.get(&phase).await.body.contains("; revealed"));
        let lines = audit(&server).await;
        let output = |what: &str, reason: &str| {
            lines.iter().any(|line| {
                line.what == what && line.reason == reason && line.actor.ends_with(" of the organiser")
            })
        };
        let granted = format!("granted in phase {PHASE}");
        for (what, reason) in [
            ("paused", "the roof leaks"),
            ("paused", "it is dry"),
            ("verified", "we ran it"),
            ("disqualified", "it knew the houses"),
            (granted.as_str(), "a full disk"),
            ("closed", "it is over"),
            ("revealed", ""),
        ] {
            assert!(output(what, reason), "{what} because {reason}: {lines:?}");
        }
    }
}

/// The admin server, and its protection.
mod admin_server {
    use avln_arena::{
        admin::{Drain, Notice, Status, ask},
        data::DataFolder,
        now_unix_ms,
    };
    use avln_client::{Action, Client, ConnectOptions, Error, Reason, RunOptions};
    use avln_store::AuditNote;
    use avln_tests::{PHASE, TestServer, TestSetup, clients::NO_SENSORS, clients::RawClient, http};
    use serde::Serialize;
    use std::time::Duration;
    use tokio::time::{sleep, timeout};

    struct Operator {
        url: String,
        token: String,
    }

    impl Operator {
        async fn of(server: &TestServer) -> Self {
            let token = server.organiser().await;
            Self { url: format!("http://{}", server.servers.admin.unwrap()), token }
        }

        async fn ask(&self, path: &str, token: &str, body: Option<&impl Serialize>) -> (u16, String) {
            let body = body.map(|body| serde_json::to_vec(body).unwrap());
            let answer = ask(&self.url, path, token, body).await.unwrap();
            (answer.status.as_u16(), String::from_utf8(answer.body.to_vec()).unwrap())
        }

        async fn status(&self, path: &str, body: Option<&impl Serialize>) -> Status {
            let (code, words) = self.ask(path, &self.token, body).await;
            assert_eq!(code, 200, "{words}");
            serde_json::from_str(&words).unwrap()
        }

        async fn metrics(&self) -> String {
            self.ask("/metrics", "", None::<&()>).await.1
        }
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn only_operator_sees_open_episodes() {
        let server = TestServer::open_with_admin(&TestSetup::default()).await;
        let operator = Operator::of(&server).await;
        let client = Client::connect(server.agents_url(), &server.token).await.unwrap();
        let run = client.start_run(RunOptions::new(PHASE, "secretive method")).await.unwrap();
        let mut play = client.play(&run, NO_SENSORS).await.unwrap();
        let mut episode = play.next_episode().await.unwrap().unwrap();
        for _ in 0..3 {
            episode.step(Action::TurnLeft).await.unwrap();
        }

        let status = operator.status("/v1/status", None::<&()>).await;
        let slots: Vec<_> =
            status.slots.iter().map(|slot| (slot.run.as_str(), slot.slot, slot.step)).collect();
        assert_eq!(slots, [(run.id.as_str(), 0, 3)]);
        let metrics = operator.metrics().await;
        for line in [
            "avln_steps_total 3\n",
            "avln_open_episodes 1\n",
            "avln_step_seconds_count{part=\"thinking\"} 3\n",
        ] {
            assert!(metrics.contains(line), "{line} is missing in {metrics}");
        }
        for hidden in ["secretive", run.id.as_str(), avln_tests::TEAM] {
            assert!(!metrics.contains(hidden), "{hidden} occurs in {metrics}");
        }
        episode.step(Action::Stop).await.unwrap();
        let metrics = operator.metrics().await;
        assert!(metrics.contains("avln_episodes_ended_total{end=\"stopped\"} 1\n"), "{metrics}");
        assert!(metrics.contains("avln_episodes{state=\"terminated\",end=\"stopped\"} 1\n"), "{metrics}");

        for token in ["", "wrong", &server.token, &run.token] {
            for path in ["/v1/status", "/v1/drain", "/v1/notice"] {
                let body = (path != "/v1/status").then(|| Notice { text: "x".into() });
                let (code, words) = operator.ask(path, token, body.as_ref()).await;
                assert_eq!(code, 401, "{path} with '{token}': {words}");
            }
        }
        for path in ["/metrics", "/v1/status", "/v1/drain", "/v1/notice", "/admin"] {
            assert_eq!(http::get(server.servers.web, path).await.status, 404, "{path} on the web server");
        }
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn drain_lets_open_episodes_end() {
        let server = TestServer::open_with_admin(&TestSetup::default()).await;
        let operator = Operator::of(&server).await;
        let link = ConnectOptions { patience: Some(Duration::from_secs(2)), ..ConnectOptions::default() };
        let client = Client::connect_with(server.agents_url(), &server.token, &link).await.unwrap();
        let run = client.start_run(RunOptions::new(PHASE, "patient")).await.unwrap();
        let mut play = client.play(&run, NO_SENSORS).await.unwrap();
        let mut episode = play.next_episode().await.unwrap().unwrap();

        operator.status("/v1/notice", Some(&Notice { text: "closed on Sunday".into() })).await;
        assert_eq!(client.server_info().await.unwrap().notice, "closed on Sunday");
        assert!(http::get(server.servers.web, "/").await.body.contains("closed on Sunday"));
        let (code, words) =
            operator.ask("/v1/drain", &operator.token, Some(&Drain { reason: " ".into(), minutes: 1 })).await;
        assert_eq!(code, 422, "{words}");

        let mut probe = RawClient::connect(&server.agents_url(), &server.token).await;
        assert!(probe.health("").await.unwrap());
        let drain = Drain { reason: "new disks".into(), minutes: 10 };
        let status = operator.status("/v1/drain", Some(&drain)).await;
        assert_eq!(status.draining.as_deref(), Some("new disks"));
        for service in ["", "avln.v1.RunService"] {
            let stopping = async {
                while probe.health(service).await.unwrap() {
                    sleep(Duration::from_millis(20)).await;
                }
            };
            timeout(Duration::from_secs(60), stopping).await.expect("no run starts any more");
        }
        for service in ["avln.v1.PlayService", "avln.v1.InfoService"] {
            assert!(probe.health(service).await.unwrap(), "{service} goes on");
        }
        let info = client.server_info().await.unwrap();
        assert!(info.draining && info.notice == "new disks", "{info:?}");
        let refused = client.start_run(RunOptions::new(PHASE, "late")).await.unwrap_err();
        assert_eq!(refused.reason(), Some(Reason::Draining), "{refused}");
        assert!(refused.to_string().contains("new disks"), "{refused}");

        let closing = tokio::spawn(server.servers.wait());
        episode.step(Action::TurnLeft).await.unwrap();
        episode.step(Action::Stop).await.unwrap();
        assert!(episode.is_over());
        let output: Vec<_> = play.take_notices().into_iter().map(|notice| notice.message).collect();
        assert!(output.iter().any(|message| message.contains("new disks")), "{output:?}");
        // The server asks to wait for 30 seconds, longer than the client's patience.
        let refused = timeout(Duration::from_secs(20), play.next_episode()).await.expect("patience is over");
        let refused = refused.unwrap_err();
        let is_refusal = refused.reason() == Some(Reason::Draining) || matches!(refused, Error::Lost { .. });
        assert!(is_refusal, "{refused}");
        drop((play, client, probe));
        timeout(Duration::from_secs(60), closing).await.expect("it stops").unwrap().unwrap();
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn drain_extends_phases_and_records_it() {
        let server = TestServer::open_with_admin(&TestSetup::default()).await;
        let operator = Operator::of(&server).await;
        let store = DataFolder::open(server.folder.path()).unwrap().store().await.unwrap();
        let mut phase = store.phase(PHASE).await.unwrap();
        let closes = now_unix_ms() + 3_600_000;
        phase.schedule.closes_unix_ms = Some(closes);
        store.change_phases(&[phase], &[AuditNote::default()], 1).await.unwrap();
        let before = now_unix_ms();
        operator.status("/v1/drain", Some(&Drain { reason: "new disks".into(), minutes: 0 })).await;
        timeout(Duration::from_secs(60), server.servers.wait()).await.expect("it stops").unwrap();
        tokio::time::sleep(Duration::from_millis(1500)).await;
        let next = avln_tests::start_servers(server.folder.path()).await;
        let away = now_unix_ms() - before;
        let later = store.phase(PHASE).await.unwrap().schedule.closes_unix_ms.unwrap() - closes;
        assert!((1500..=away).contains(&later), "{later} ms later after {away} ms");
        let audit = store.audit().await.unwrap();
        let output: Vec<_> = audit.iter().filter(|line| line.actor == "server").collect();
        let words: Vec<_> = output.iter().map(|line| (line.subject.as_str(), line.what.as_str())).collect();
        assert_eq!(words, [("server", "drain"), ("phase trial", "closes")]);
        assert!(output.iter().all(|line| line.reason == "new disks"), "{output:?}");
        next.close().await.unwrap();
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn the_admin_server_rejects_public_addresses() {
        let free = "127.0.0.1:0".parse().unwrap();
        let addresses = avln_arena::servers::Addresses { grpc: free, web: free };
        let servers = avln_arena::servers::Servers::bind(&addresses).await.unwrap();
        let Err(refused) = servers.with_admin("0.0.0.0:0".parse().unwrap()).await else {
            panic!("it was opened")
        };
        assert!(refused.to_string().contains("ssh -L"), "{refused}");
    }
}

/// A data folder in use: a second server is refused before it changes anything.
mod locked_folder {
    use avln_arena::data::DataFolder;
    use avln_store::TokenLine;
    use avln_tests::{PHASE, TEAM, TestSetup, set_up, store};
    use std::{path::Path, process::Command};

    async fn tokens(folder: &Path) -> Vec<TokenLine> {
        let store = store(folder).await;
        let tokens = store.tokens().await.expect("tokens");
        store.close().await;
        tokens
    }

    /// Calls every command that hosts the folder; none may succeed.
    fn host(folder: &Path) {
        let serve = "serve --cache-size 9 --admin off --grpc 127.0.0.1:0 --web 127.0.0.1:0".to_owned();
        let demo = "demo --once --houses 1 --missions 1 --grpc 127.0.0.1:0 --web 127.0.0.1:0".to_owned();
        let oracle = format!("challenge leaderboard oracle --phase {PHASE}");
        for line in [serve, demo, oracle] {
            let mut program = Command::new(env!("CARGO_BIN_EXE_avln_under_test"));
            let output = program.arg("--data").arg(folder).args(line.split(' ')).output();
            let output = output.expect("the program runs");
            let words = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(3), "{line}: {words}");
            assert!(words.contains("a server is already running on data folder"), "{line}: {words}");
        }
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn second_server_is_refused_before_any_change() {
        let [folder, empty] = [(); 2].map(|()| tempfile::tempdir().expect("a folder"));
        set_up(folder.path(), &TestSetup::default()).await;
        let before = tokens(folder.path()).await;
        assert_eq!(before.iter().map(|token| token.team.as_deref()).collect::<Vec<_>>(), [Some(TEAM)]);
        for place in [&folder, &empty] {
            let data = DataFolder::open(place.path()).expect("the folder");
            let _lock = data.lock().expect("no other server");
            host(place.path());
        }
        assert_eq!(tokens(folder.path()).await, before);
        assert!(!folder.path().join("cache/scenes/limit_gib").exists(), "the limit of the cache");
        assert!(!empty.path().join("avln.db").exists(), "the database was opened");
    }
}

/// `avln lab doctor` finds obstacles to a run, plays uncounted episodes and ends its run.
mod doctor {
    use avln_arena::{challenge::notes, data::DataFolder, now_unix_ms};
    use avln_store::{QuotaLimits, RunState, Viewer};
    use avln_tests::{PHASE, TestServer, TestSetup};
    use serde_json::Value;
    use std::process::Command;

    /// The doctor's exit code, report and standard error for `url`.
    fn doctor(url: &str, token: &str, phase: &str) -> (Option<i32>, Value, String) {
        let mut avln = Command::new(env!("CARGO_BIN_EXE_avln_under_test"));
        let arguments = ["lab", "doctor", "--server", url, "--token", token, "--phase", phase, "--json"];
        let output = avln.args(arguments).args(["--steps", "20", "--episodes", "2", "--size", "64"]).output();
        let output = output.expect("the program runs");
        let report = serde_json::from_slice(&output.stdout).expect("JSON");
        (output.status.code(), report, String::from_utf8_lossy(&output.stderr).into_owned())
    }

    fn verdict<'a>(report: &'a Value, name: &str) -> &'a str {
        let checks = report["checks"].as_array().expect("checks");
        let check = checks.iter().find(|check| check["name"] == name);
        check.and_then(|check| check["verdict"].as_str()).unwrap_or("none")
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn doctor_leaves_healthy_server_unchanged() {
        let server = TestServer::open(&TestSetup { missions: 3, ..TestSetup::default() }).await;
        let (code, report, said) = doctor(&server.agents_url(), &server.token, PHASE);
        assert_eq!((code, said.as_str()), (Some(0), ""), "{report}");
        for name in [
            "server",
            "versions",
            "state",
            "round trip",
            "clock",
            "token",
            "phase",
            "quota",
            "practice",
            "speed",
        ] {
            assert_eq!(verdict(&report, name), "ok", "{name}: {report}");
        }
        let measured = &report["measured"];
        assert_eq!((&measured["step_s"]["count"], &measured["begin_s"]["count"]), (&40.into(), &2.into()));
        assert_eq!(measured["observation_bytes"], 64 * 64 * 7 + 2 * 4 * 4000);
        let (per_s, longest_s) = (measured["steps_per_s"].as_f64(), measured["longest_run_s"].as_f64());
        assert!(longest_s > per_s.map(|per_s| 3.0 * 1000.0 / per_s) && per_s > Some(1.0), "{measured}");
        assert!(measured["clock_ahead_s"].as_f64().is_some_and(|ahead| ahead.abs() < 1.0), "{measured}");

        let store = DataFolder::open(server.folder.path()).unwrap().store().await.unwrap();
        let runs = store.reader().runs(&Viewer::Organiser, None, 10).await.unwrap();
        assert_eq!(
            runs.iter().map(|run| (run.method.as_str(), run.state)).collect::<Vec<_>>(),
            [("doctor", RunState::Cancelled)]
        );
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn doctor_reports_obstacles_without_spending_quota() {
        let server = TestServer::open(&TestSetup::default()).await;
        let (code, report, said) = doctor(&server.agents_url(), "wrong", PHASE);
        assert_eq!((code, verdict(&report, "token")), (Some(6), "failed"), "{report}");
        assert!(said.contains("a run would fail: token") && verdict(&report, "round trip") == "ok", "{said}");
        let (code, report, _) = doctor(&server.agents_url(), &server.token, "finals");
        assert_eq!((code, verdict(&report, "phase")), (Some(6), "failed"), "{report}");
        let (code, report, _) = doctor("http://127.0.0.1:1", &server.token, PHASE);
        assert_eq!((code, verdict(&report, "server")), (Some(6), "failed"), "{report}");

        let store = DataFolder::open(server.folder.path()).unwrap().store().await.unwrap();
        let before = store.phase(PHASE).await.unwrap();
        let mut after = before.clone();
        after.quotas = QuotaLimits { total: Some(1), ..QuotaLimits::default() };
        store
            .change_phases(&[after.clone()], &notes("test", Some(&before), &after, ""), now_unix_ms())
            .await
            .unwrap();
        let (code, report, _) = doctor(&server.agents_url(), &server.token, PHASE);
        assert_eq!(
            (code, verdict(&report, "quota"), verdict(&report, "practice")),
            (Some(0), "ok", "skipped"),
            "{report}"
        );
        let (code, report, _) = doctor(&server.agents_url(), &server.token, "");
        assert_eq!((code, verdict(&report, "phase")), (Some(6), "failed"), "{report}");
        let output = report.to_string();
        assert!(output.contains(&format!("known phases: {PHASE}; choose a phase with --phase")), "{output}");
        assert_eq!(store.reader().runs(&Viewer::Organiser, None, 10).await.unwrap(), []);
    }
}
