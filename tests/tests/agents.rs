//! Agents against a real server.

/// The Rust client: episode stream, and calls during a server restart.
mod rust_client {
    use avln_client::{Action, Client, EndReason, Episode, Error, Order, RunOptions};
    use avln_tests::{PHASE, TestServer, TestSetup, clients::NO_SENSORS, proxies::FaultProxy};
    use std::{net::SocketAddr, time::Duration};
    use tokio::time::{sleep, timeout};
    use tokio_stream::StreamExt;

    async fn server(missions: usize) -> TestServer {
        TestServer::open(&TestSetup { houses: 1, missions, ..TestSetup::default() }).await
    }

    fn options() -> RunOptions {
        RunOptions::new(PHASE, "streamer").order(Order::Unordered)
    }

    /// Plays one step and a Stop.
    async fn play(mut episode: Episode<'static>) -> Result<EndReason, Error> {
        episode.step(Action::TurnLeft).await?;
        episode.step(Action::Stop).await?;
        Ok(episode.end().expect("it is over").reason)
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn episode_stream_ends_with_run() {
        let server = server(3).await;
        let client = Client::connect(server.agents_url(), &server.token).await.expect("a connection");
        let run = client.start_run(options()).await.expect("a run");
        let mut episodes = client.play(&run, NO_SENSORS).await.expect("a stream").episodes();
        assert_eq!(episodes.task().rules, "lh-avln-v1");
        let mut ends = Vec::new();
        while let Some(episode) = episodes.try_next().await.expect("an answer") {
            // The episode is owned, so another task can play it.
            ends.push(tokio::spawn(play(episode)).await.expect("no panic").expect("to its end"));
        }
        assert_eq!(ends, [EndReason::Stopped; 3]);
        assert!(episodes.next().await.is_none(), "it has ended for good");
        let summary = episodes.finish().await.expect("a summary");
        assert!(summary.complete && summary.ends == [(EndReason::Stopped, 3)], "{summary:?}");
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn next_episode_waits_for_previous() {
        let server = server(2).await;
        let client = Client::connect(server.agents_url(), &server.token).await.expect("a connection");
        let run = client.start_run(options()).await.expect("a run");
        let mut episodes = client.play(&run, NO_SENSORS).await.expect("a stream").episodes();
        let first = episodes.try_next().await.expect("an answer").expect("an episode");
        assert!(timeout(Duration::from_millis(200), episodes.next()).await.is_err(), "one at a time");
        drop(first);
        let second = episodes.try_next().await.expect("an answer").expect("another episode");
        assert_eq!(second.ordinal(), 2);
        assert_eq!(second.progress().done, 1, "the first was given up");
        drop(second);
        let summary = episodes.finish().await.expect("a summary");
        assert_eq!(summary.ends, [(EndReason::Abandoned, 2)]);
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn stream_survives_connection_loss_but_not_error() {
        let server = server(2).await;
        let proxy = FaultProxy::open(server.servers.grpc).await;
        let client = Client::connect(proxy.url(), &server.token).await.expect("a connection");
        let run = client.start_run(options()).await.expect("a run");
        let mut episodes = client.play(&run, NO_SENSORS).await.expect("a stream").episodes();
        let mut first = episodes.try_next().await.expect("an answer").expect("an episode");
        proxy.cut();
        first.step(Action::TurnLeft).await.expect("the client comes back");
        drop(first);
        let cancelled = client.cancel_run(&run.id).await.expect("it is its own");
        assert_eq!(cancelled.progress.in_flight, 0);
        let mut items = Vec::new();
        while let Some(item) = episodes.next().await {
            items.push(item.map(|episode| episode.ordinal()));
        }
        assert!(items.len() <= 1 && items.iter().all(Result::is_err), "{items:?}");
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn calls_survive_server_restart_with_one_run() {
        let server = server(1).await;
        let proxy = FaultProxy::open(server.servers.grpc).await;
        let client = Client::connect(proxy.url(), &server.token).await.expect("a connection");
        let nowhere = SocketAddr::from(([127, 0, 0, 1], 9));
        for call in 0..2 {
            proxy.redirect(nowhere);
            proxy.cut();
            let asking = {
                let client = client.clone();
                tokio::spawn(async move {
                    match call {
                        0 => client.start_run(options()).await.map(|_| ()),
                        _ => client.quota().await.map(|_| ()),
                    }
                })
            };
            sleep(Duration::from_millis(500)).await;
            assert!(!asking.is_finished(), "it waits");
            proxy.redirect(server.servers.grpc);
            asking.await.expect("no panic").expect("an answer in the end");
        }
        assert_eq!(client.runs().await.expect("a list").len(), 1);
    }
}

/// The Python package: tests against this program, types and style.
mod python_client {
    use avln_tests::machine::{self, root};

    /// Runs a Python module in the package folder if the modules `needed` are installed.
    fn run(module: &str, arguments: &[&str], needed: &[&str]) {
        let what = format!("{module} of client-sdk/python");
        let Some(mut command) = machine::python(&what, needed, "pip install -e \"client-sdk/python[dev]\"")
        else {
            return;
        };
        command.args(["-m", module]).args(arguments).current_dir(root().join("client-sdk/python"));
        command.env("AVLN_BIN", env!("CARGO_BIN_EXE_avln_under_test"));
        command.env("AVLN_NATIVE", machine::native_module());
        for name in ["AVLN_SERVER", "AVLN_TOKEN", "AVLN_CA", "AVLN_DATA"] {
            command.env_remove(name);
        }
        machine::succeeds(&what, command);
    }

    #[test]
    fn its_tests_pass_over_this_server() {
        let needed = ["avln", "pytest", "gymnasium", "grpc_tools", "msgpack", "zmq"];
        // A hanging test ends the run and prints its stack.
        let ends = ["-o", "faulthandler_timeout=300", "-o", "faulthandler_exit_on_timeout=true"];
        run("pytest", &[&["-q", "-p", "no:cacheprovider"], &ends[..]].concat(), &needed);
    }

    #[test]
    fn its_style_is_kept() {
        run("ruff", &["check", "--no-cache"], &["ruff"]);
        run("ruff", &["format", "--check", "--no-cache"], &["ruff"]);
    }

    #[test]
    fn its_types_hold() {
        run(
            "mypy",
            &["--cache-dir", concat!(env!("CARGO_TARGET_TMPDIR"), "/mypy")],
            &["avln", "mypy", "pytest", "gymnasium", "msgpack", "zmq"],
        );
    }
}

/// The play page for people: the same gRPC server, rules and limits as for agents.
mod human {
    use avln_client::Order;
    use avln_human::{HumanArgs, HumanError, RunArgs, run_with};
    use avln_tests::{PHASE, TestServer, TestSetup, http};
    use serde_json::Value;
    use std::net::SocketAddr;
    use tokio::{
        io::{AsyncReadExt, AsyncWriteExt},
        net::TcpStream,
        sync::oneshot,
    };

    fn args(server: &TestServer, page: &str) -> HumanArgs {
        let run = RunArgs {
            server: format!("http://{}", server.servers.grpc),
            ca: None,
            token: server.token.clone(),
            phase: PHASE.to_owned(),
            order: Order::Unordered,
        };
        HumanArgs { run, size: 64, page: page.parse().expect("an address") }
    }

    /// Returns a page request's JSON text and binary tail.
    async fn request(page: SocketAddr, word: &str) -> (Value, usize) {
        let mut stream = TcpStream::connect(page).await.expect("the page is there");
        let text = format!(
            "POST /request/{word} HTTP/1.1\r\nHost: {page}\r\nX-Avln-Page: 1\r\nConnection: close\r\nContent-Length: 0\r\n\r\n"
        );
        stream.write_all(text.as_bytes()).await.expect("it listens");
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).await.expect("it answers");
        let head = answer.windows(4).position(|window| window == b"\r\n\r\n").expect("a head") + 4;
        let body = &answer[head..];
        let length = u32::from_le_bytes(body[..4].try_into().expect("four bytes")) as usize;
        let output = serde_json::from_slice(&body[4..4 + length]).expect("JSON");
        (output, body.len() - 4 - length)
    }

    /// Plays an open episode: some steps, then Submits until its end.
    async fn play(page: SocketAddr, begun: &Value) -> Value {
        let goals = begun["goals"].as_array().expect("goals").len() as u64;
        assert_eq!((begun["step"].as_u64(), begun["remaining_submits"].as_u64()), (Some(0), Some(goals - 1)));
        for (step, word) in (1..).zip(["left", "forward", "right"]) {
            let (output, bytes) = request(page, word).await;
            assert_eq!((output["state"].as_str(), output["step"].as_u64()), (Some("playing"), Some(step)));
            let samples = output["senses"]["audio"][1].as_u64().expect("sound") as usize;
            assert_eq!(bytes, 64 * 64 * (3 + 4) + 2 * 4 * samples, "colours, depth and both ears");
        }
        for _ in 1..goals {
            request(page, "submit").await;
        }
        request(page, "stop").await.0
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn human_run_appears_on_leaderboard() {
        let server = TestServer::open(&TestSetup::default()).await;
        let (found, page) = oneshot::channel();
        let options = args(&server, "127.0.0.1:0");
        let run = tokio::spawn(async move {
            let on_page = |address| found.send(address).expect("a receiver");
            run_with(options, on_page, &mut |_| {}).await
        });
        let page = page.await.expect("a page");
        let (before, _) = request(page, "look").await;
        assert_eq!(
            (before["state"].as_str(), before["progress"]["total"].as_u64()),
            (Some("waiting"), Some(2))
        );
        for episode in 1..=2 {
            let (begun, bytes) = request(page, "next").await;
            assert_eq!(
                (begun["state"].as_str(), begun["episode"].as_u64()),
                (Some("playing"), Some(episode))
            );
            assert_eq!(request(page, "look").await, (begun.clone(), bytes), "looking changes nothing");
            let ended = play(page, &begun).await;
            assert_eq!(
                (ended["state"].as_str(), ended["end"]["steps"].as_u64()),
                (Some("waiting"), Some(3 + begun["goals"].as_array().map_or(0, Vec::len) as u64))
            );
        }
        assert_eq!(request(page, "next").await.0["state"], "over");
        let summary = run.await.expect("no panic").expect("a summary");
        assert!(summary.complete, "{summary:?}");
        let board = http::get(server.servers.web, &format!("/leaderboard/{PHASE}?order=unordered")).await;
        assert!(
            board.body.contains(">human</a>") && board.body.contains("colour, depth, sound"),
            "{}",
            board.body
        );
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn the_page_is_for_this_machine_alone() {
        let server = TestServer::open(&TestSetup::default()).await;
        let open = run_with(args(&server, "0.0.0.0:0"), |_| {}, &mut |_| {}).await;
        assert!(matches!(open, Err(HumanError::Open(_))), "{open:?}");
        let taken = server.servers.web.to_string();
        let taken = run_with(args(&server, &taken), |_| {}, &mut |_| {}).await;
        assert!(matches!(taken, Err(HumanError::Page { .. })), "{taken:?}");
    }
}

/// The baseline suite end to end: play, resume, report page.
mod baselines {
    use avln_lab::suite::{self, AgentVariant, Results, SuiteOptions, SuiteSize, Track};
    use std::{fs, io::Write as _, path::Path};

    fn lines(folder: &Path) -> Vec<String> {
        let text = fs::read_to_string(folder.join("results.jsonl")).expect("results");
        text.lines().map(str::to_owned).collect()
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn suite_resumes_and_writes_its_page() {
        let place = tempfile::tempdir().expect("a folder");
        let folder = place.path();
        assert!(suite::report(folder).is_err(), "nothing was played");
        let size = SuiteSize { houses: 1, missions: 2, ..Track::Quick.size() };
        let agents = vec![AgentVariant::Random, AgentVariant::ShortestPath];
        let setup = |episodes| SuiteOptions {
            track: Track::Quick,
            agents: agents.clone(),
            episodes: Some(episodes),
            size,
            ..SuiteOptions::default()
        };

        assert_eq!(suite::run(folder, &setup(1)).await.expect("one mission"), 4);
        let first = lines(folder);
        assert_eq!(suite::run(folder, &setup(2)).await.expect("the other mission"), 4);
        assert_eq!(suite::run(folder, &setup(2)).await.expect("nothing"), 0);
        let all = lines(folder);
        assert!(all.len() == 8 && all[..4] == first[..], "{all:?}");

        // A truncated line is played again; the same seed repeats the result.
        let cut = all[..7].join("\n") + "\n" + &all[7][..40];
        fs::write(folder.join("results.jsonl"), cut).expect("the file");
        assert_eq!(suite::run(folder, &setup(2)).await.expect("the last one"), 1);
        let results = Results::open(&folder.join("results.jsonl")).expect("results");
        let before: suite::ResultLine = serde_json::from_str(&all[7]).expect("a line");
        let after = results.lines().find(|line| line.key == before.key).expect("it was played");
        assert_eq!((&after.metrics, &after.wrong, after.end), (&before.metrics, &before.wrong, before.end));

        let mut other = before.clone();
        other.key.seed = 7;
        let mut file = fs::File::options().append(true).open(folder.join("results.jsonl")).expect("the file");
        writeln!(file, "{}", serde_json::to_string(&other).expect("JSON")).expect("space on the disk");
        let suite::SuiteReport { page, episodes, charts, left_out } = suite::report(folder).expect("a page");
        assert_eq!(left_out, 1, "the result with another seed");
        assert_eq!(episodes.lines().count(), 9, "{episodes}");
        let oracle = episodes
            .lines()
            .find(|line| line.starts_with("quick,none,shortest-path,unordered,"))
            .expect("a row");
        assert!(oracle.contains(",3,3,1,1,1,1,") && oracle.contains(",stopped,0,0,"), "{oracle}");
        let row = |name: &str| page.lines().find(|line| line.starts_with(name)).expect("a row").to_owned();
        assert!(row("| random |").starts_with("| random | training-free | - | 2 |"), "{page}");
        assert!(row("| shortest-path †").contains("| 100.0 [100.0, 100.0] |"), "{page}");
        assert!(
            page.contains("| PAG-Nav | training-free | yes | 2.3 |") && page.contains("other missions"),
            "{page}"
        );
        assert_eq!(charts.len(), 1, "{page}");
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn baseline_suite_locks_its_folder() {
        let place = tempfile::tempdir().expect("a folder");
        let lock = fs::File::create(place.path().join("lock")).expect("the lock");
        lock.lock().expect("it is free");
        let refused = suite::run(place.path(), &SuiteOptions::default()).await.expect_err("it is taken");
        assert!(refused.to_string().contains("another baseline suite is running"), "{refused}");
    }
}

/// The bundled perception network was trained on houses outside every evaluation split.
mod perception {
    use avln_dataset::{Recipe, SceneSource};
    use avln_perception::VisionNetwork;
    use std::collections::BTreeSet;

    /// House seeds in the recipe splits selected by `wanted`.
    fn seeds(recipe: &Recipe, wanted: impl Fn(&str) -> bool) -> BTreeSet<u64> {
        let jobs = recipe.jobs().filter(|job| wanted(&recipe.splits[job.split].name));
        let draws = jobs.flat_map(|job| (0..Recipe::HOUSE_DRAWS).map(move |attempt| (job, attempt)));
        let seed = |(job, attempt)| match recipe.house(job, attempt) {
            Ok(SceneSource::Procedural { seed, .. }) => seed,
            other => panic!("expected a house, got {other:?}"),
        };
        draws.map(seed).collect()
    }

    #[test]
    fn network_was_not_trained_on_evaluation_houses() {
        let network = VisionNetwork::new().expect("the bundled weights are valid");
        let training = &network.info().training;
        let learnt: BTreeSet<u64> = training.seeds.iter().copied().collect();
        assert_eq!(training.split, "train");
        assert!(!learnt.is_empty());
        for (name, text) in Recipe::EMBEDDED {
            let recipe = Recipe::from_json(text).expect("a recipe");
            let evaluated = seeds(&recipe, |split| split != "train");
            assert!(!evaluated.is_empty() && learnt.is_disjoint(&evaluated), "recipe {name}");
            if name == training.recipe {
                assert!(learnt.is_subset(&seeds(&recipe, |split| split == "train")));
            }
        }
    }
}

/// PAG-Nav uses undiscovered stairs between storeys.
mod storeys {
    use avln_tests::Server;
    use std::{fs, path::Path, process::Command};

    const PROGRAM: &str = env!("CARGO_BIN_EXE_avln_under_test");
    /// A house with stairs.
    const RECIPE: &str = r#"{
    "name": "two", "rules": "lh-avln-v1", "seed": 6,
    "missions": { "goals": [2, 4], "min_start_m": 3.0, "min_separation_m": 2.0, "distractors": [0, 6] },
    "splits": [{
        "name": "two", "missions_per_scene": 1,
        "scenes": { "houses": { "count": 1, "rooms": [12, 14], "storeys": [2, 2], "pool": "train" } }
    }]
}"#;
    /// Take stairs as soon as they are known.
    const WEIGHTS: &str = "storey_steps = 1\n";
    /// Height difference that only another storey has, metres.
    const STOREY_M: f64 = 2.5;

    /// Runs the program in a folder and returns the output.
    fn avln(folder: &Path, arguments: &[&str]) -> String {
        let mut command = Command::new(PROGRAM);
        command.env_remove("AVLN_TOKEN").current_dir(folder).args(["--data", "data"]).args(arguments);
        let output = command.output().expect("the program runs");
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8_lossy(&output.stdout).into_owned()
    }

    /// Body heights in a trace, metres above the start.
    fn heights_m(trace: &Path) -> Vec<f64> {
        let text = fs::read_to_string(trace).expect("a trace");
        let lines = text.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).expect("JSON"));
        lines.filter_map(|line| line["pose"]["position_m"][1].as_f64()).collect()
    }

    #[tokio::test]
    async fn pag_nav_uses_stairs() {
        let place = tempfile::tempdir().expect("a folder");
        let folder = place.path();
        fs::write(folder.join("recipe.json"), RECIPE).expect("a recipe");
        fs::write(folder.join("weights.toml"), WEIGHTS).expect("weights");
        avln(folder, &["data", "dataset", "build", "recipe.json", "--out", "set"]);
        avln(folder, &["challenge", "phase", "open", "stairs", "--dataset", "set", "--split", "two"]);
        let output = avln(folder, &["challenge", "team", "add", "ada"]);
        let token = output.split_whitespace().find(|word| word.starts_with("avln_")).expect("a token");
        let server = Server::start(PROGRAM, &folder.join("data"));
        let url = format!("http://{}", server.grpc);
        let agent = ["agent", "pag-nav", "--preset", "pag-nav-plus", "--server", &url, "--token", token];
        let agent = [&agent[..], &["--phase", "stairs"]].concat();
        let said = avln(folder, &[&agent[..], &["--weights", "weights.toml", "--trace", "traces"]].concat());
        assert!(said.contains(&format!("  http://{}/runs/run_", server.web)), "a link to the run: {said}");
        let traces = fs::read_dir(folder.join("traces")).expect("traces").flatten();
        let heights_m: Vec<f64> = traces.flat_map(|trace| heights_m(&trace.path())).collect();
        let most_m = heights_m.iter().fold(0.0, |most: f64, height_m| most.max(height_m.abs()));
        assert!(heights_m.len() > 100 && most_m > STOREY_M, "it came no farther up or down than {most_m} m");
    }
}
