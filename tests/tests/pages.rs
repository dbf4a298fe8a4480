//! Real web pages.

/// Separates the test of event rates from the browser, which uses all cores.
static ALONE: tokio::sync::Mutex<()> = tokio::sync::Mutex::const_new(());

/// Pages in a real browser: light and dark, wide and narrow, with a keyboard only.
mod browser {
    use avln_client::Order;
    use avln_human::{HumanArgs, RunArgs, run_with};
    use avln_tests::{
        PHASE, TestServer, TestSetup,
        clients::{AUDIO_ONLY, play_script, play_script_with},
        machine::{self, root, skipped},
    };
    use std::{env, path::PathBuf};
    use tokio::{sync::oneshot, task::spawn_blocking};

    const REMEDY: &str = "pip install playwright axe-playwright-python";
    const CHROMIUM: [&str; 3] = ["chromium", "chromium-browser", "google-chrome"];

    /// The installed browser; `None` with an install hint if there is none.
    fn chromium() -> Option<PathBuf> {
        let path = env::var_os("PATH").unwrap_or_default();
        let folders: Vec<_> = env::split_paths(&path).collect();
        let mut programs =
            CHROMIUM.iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name)));
        let found = programs.find(|program| program.is_file());
        if found.is_none() {
            skipped(&format!("pages in a browser, for none of {CHROMIUM:?} is here"), "install Chromium");
        }
        found
    }

    fn person(server: &TestServer) -> HumanArgs {
        let run = RunArgs {
            server: server.agents_url(),
            ca: None,
            token: server.token.clone(),
            phase: PHASE.to_owned(),
            order: Order::Unordered,
        };
        HumanArgs { run, size: 64, page: "127.0.0.1:0".parse().expect("an address") }
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn every_page_is_accessible() {
        let needed = ["playwright", "axe_playwright_python"];
        let Some(mut check) = machine::python("pages in a browser", &needed, REMEDY) else { return };
        let Some(chromium) = chromium() else { return };
        let _alone = super::ALONE.lock().await;
        let server = TestServer::open(&TestSetup::default()).await;
        for method in ["stroller", "wanderer"] {
            play_script(&server.agents_url(), &server.token, method).await;
        }
        let heard =
            play_script_with(&server.agents_url(), &server.token, "listener", AUDIO_ONLY, |_, _| ()).await;
        let (found, page) = oneshot::channel();
        let options = person(&server);
        let run = tokio::spawn(async move {
            let on_page = |address| found.send(address).expect("a receiver");
            run_with(options, on_page, &mut |_| {}).await
        });
        let page = page.await.expect("a page");
        check.arg(root().join("tests/browser/check.py")).arg(chromium);
        check.arg(format!("http://{}", server.servers.web)).arg(format!("http://{page}"));
        check.arg(format!("http://{}/runs/{heard}/episodes/0", server.servers.web));
        check.arg(&server.token).arg(server.organiser().await);
        spawn_blocking(|| machine::succeeds("pages in a browser", check)).await.expect("nothing is wrong");
        run.abort();
    }

    /// Runs a Python module in the check folder.
    fn run(module: &str, arguments: &[&str], needed: &[&str]) {
        let what = format!("{module} of tests/browser");
        let remedy = format!("{REMEDY} {module}");
        let Some(mut command) = machine::python(&what, needed, &remedy) else { return };
        command.args(["-m", module]).args(arguments).arg(".").current_dir(root().join("tests/browser"));
        machine::succeeds(&what, command);
    }

    #[test]
    fn checks_follow_the_style() {
        let rules = ["--no-cache", "--config", "../../client-sdk/python/pyproject.toml"];
        run("ruff", &[&["check"][..], &rules].concat(), &["ruff"]);
        run("ruff", &[&["format", "--check"][..], &rules].concat(), &["ruff"]);
    }

    #[test]
    fn check_types_hold() {
        let rules = ["--strict", "--cache-dir", "/dev/null", "--config-file="];
        run("mypy", &rules, &["mypy", "playwright"]);
    }
}

/// Every change to a frozen copy is detected.
mod frozen_copy {
    use avln_tests::{TestSetup, set_up};
    use std::{fs, path::Path, process::Command};

    const PROGRAM: &str = env!("CARGO_BIN_EXE_avln_under_test");

    /// Runs the program; returns success and output.
    fn avln(data: &Path, arguments: &[&str]) -> (bool, String) {
        let output = Command::new(PROGRAM).arg("--data").arg(data).args(arguments).output().expect("it runs");
        let text = [output.stdout, output.stderr].concat();
        (output.status.success(), String::from_utf8_lossy(&text).into_owned())
    }

    /// Changes a copy, checks it, and restores it.
    fn found(copy: &Path, key: &str, file: &str, text: Option<&str>) -> String {
        let path = copy.join(file);
        let before = fs::read(&path).ok();
        match text {
            Some(text) => fs::write(&path, text).expect("a file"),
            None => fs::remove_file(&path).expect("a file"),
        }
        let (content, output) =
            avln(copy, &["challenge", "leaderboard", "check", &copy.display().to_string(), "--key", key]);
        assert!(!content, "{output}");
        match before {
            Some(bytes) => fs::write(&path, bytes).expect("a file"),
            None => fs::remove_file(&path).expect("a file"),
        }
        output
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn changes_to_a_copy_are_detected() {
        let (data, elsewhere) =
            (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
        set_up(data.path(), &TestSetup { houses: 1, missions: 1, ..TestSetup::default() }).await;
        let copy = elsewhere.path().join("frozen");
        let place = copy.display().to_string();
        let (content, output) = avln(data.path(), &["challenge", "leaderboard", "freeze", "--out", &place]);
        assert!(content, "{output}");
        let key =
            output.lines().find_map(|line| line.strip_prefix("signed by    ")).expect("a key").to_owned();

        // A copy is checked without a data folder.
        let check = |more: &[&str]| {
            avln(elsewhere.path(), &[&["challenge", "leaderboard", "check", place.as_str()], more].concat())
        };
        let (content, output) = check(&["--key", &key]);
        assert!(content && output.contains(", as expected"), "{output}");
        let (content, output) = check(&[]);
        assert!(content && output.contains(&key), "{output}");
        let (content, output) = check(&["--key", "0123"]);
        assert!(!content && output.contains("not by 0123"), "{output}");

        let list = fs::read_to_string(copy.join("SHA256SUMS")).expect("a list");
        assert!(found(&copy, &key, "index.html", Some("<p>We won.")).contains("index.html was changed"));
        assert!(found(&copy, &key, "index.html", None).contains("cannot read"));
        assert!(found(&copy, &key, "more.html", Some("We won.")).contains("more.html is not in SHA256SUMS"));
        let forged = list.replacen(&list[..8], "01234567", 1);
        assert!(found(&copy, &key, "SHA256SUMS", Some(&forged)).contains("does not fit SHA256SUMS"));
        assert!(found(&copy, &key, "SHA256SUMS.sig", Some(&key)).contains("does not fit SHA256SUMS"));
        let link = copy.join("link");
        std::os::unix::fs::symlink("/", &link).expect("a link");
        let (content, output) = check(&["--key", &key]);
        assert!(!content && output.contains("link is not in SHA256SUMS"), "{output}");
        fs::remove_file(link).expect("a link");
        assert!(check(&["--key", &key]).0, "all is as it was");
    }
}

/// Live events on the web server.
mod live_run {
    use avln_client::{Action, Client, RunOptions};
    use avln_tests::{PHASE, TestServer, TestSetup, clients::NO_SENSORS, http};
    use serde_json::Value;
    use std::time::Duration;
    use tokio::time::sleep;

    /// An answer's events, in order.
    fn events(answer: &http::Answer) -> Vec<Value> {
        let data = answer.body.lines().filter_map(|line| line.strip_prefix("data: "));
        data.map(|data| serde_json::from_str(data).expect("JSON")).collect()
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn live_events_show_progress_and_waiting() {
        let _alone = super::ALONE.lock().await;
        let server = TestServer::open(&TestSetup::default()).await;
        let client = Client::connect(server.agents_url(), &server.token).await.expect("a connection");
        let run = client.start_run(RunOptions::new(PHASE, "walker")).await.expect("a run");
        let (web, path) = (server.servers.web, format!("/api/v1/runs/{}/events", run.id));
        let before = events(&http::get_events(web, &path, Duration::from_millis(500)).await);
        assert_eq!((before.len(), &before[0]["state"]), (1, &"created".into()));
        assert_eq!(before[0]["words"]["waits"], "the run waits for its agent to connect");

        let mut play = client.play(&run, NO_SENSORS).await.expect("a stream");
        let mut episode = play.next_episode().await.expect("a stream").expect("an episode");
        let walk = async {
            for _ in 0..20 {
                episode.step(Action::TurnLeft).await.expect("a legal step");
                sleep(Duration::from_millis(150)).await;
            }
        };
        let (heard, ()) = tokio::join!(http::get_events(web, &path, Duration::from_millis(3500)), walk);
        let output = events(&heard);
        assert!(
            heard.body.contains("retry: 2000") && (3..=5).contains(&output.len()),
            "once a second: {}",
            heard.body
        );
        let steps: Vec<u64> = output.iter().filter_map(|event| event["slots"][0]["step"].as_u64()).collect();
        assert!(steps.len() >= 3 && steps.is_sorted_by(|a, b| a < b), "{steps:?}");
        let last = &output[output.len() - 1];
        assert_eq!(
            (&last["connected"], &last["playing"], &last["state"]),
            (&true.into(), &1.into(), &"running".into())
        );
        let rate = last["steps_per_s"].as_f64().expect("a rate");
        assert!((2.0..8.0).contains(&rate), "{rate} steps a second");
        let list = events(&http::get_events(web, "/api/v1/runs/events", Duration::from_millis(500)).await);
        assert_eq!(list[0]["runs"][0]["run"], run.id.as_str());
        let page = http::get(web, "/runs").await.body;
        assert!(page.contains("1 open run.") && page.contains("steps per second"), "{page}");

        drop(episode);
        drop(play);
        drop(client);
        let lost = http::get_events(web, &path, Duration::from_millis(2500)).await;
        assert!(lost.body.contains("waits for its agent to reconnect"), "{}", lost.body);
    }
}

/// A replay plays the agent's sound, sample by sample; hidden replays have no sound.
mod replay_sound {
    use avln_client::{Audio, Sensors};
    use avln_store::Visibility;
    use avln_tests::{
        TestServer, TestSetup,
        clients::{AUDIO_ONLY, STEPS, play_script, play_script_with},
        http,
    };
    use std::collections::BTreeMap;

    /// Bytes before the samples.
    const HEAD_BYTES: usize = 68;

    /// Plays a run with sound; returns the id and the received samples per episode.
    async fn play(server: &TestServer, sensors: Sensors) -> (String, BTreeMap<u32, Vec<Audio>>) {
        let mut heard: BTreeMap<u32, Vec<Audio>> = BTreeMap::new();
        let url = server.agents_url();
        let run = play_script_with(&url, &server.token, "listener", sensors, |ordinal, observation| {
            heard.entry(ordinal).or_default().extend(observation.audio.clone());
        });
        let run = run.await;
        (run, heard)
    }

    /// Interleaved samples, as in a file.
    fn interleaved(steps: &[Audio]) -> Vec<u8> {
        let frames = steps.iter().flat_map(|audio| audio.left.iter().zip(&audio.right));
        frames.flat_map(|(left, right)| [left.to_le_bytes(), right.to_le_bytes()].concat()).collect()
    }

    /// An answer's body bytes.
    fn body(answer: &http::Answer) -> &[u8] {
        let head = answer.bytes.windows(4).position(|end| end == b"\r\n\r\n").expect("a head");
        &answer.bytes[head + 4..]
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn replay_sound_equals_agent_sound() {
        let server = TestServer::open(&TestSetup::default()).await;
        let (run, heard) = play(&server, AUDIO_ONLY).await;
        assert_eq!(heard.len(), 2);
        for (ordinal, steps) in &heard {
            let last = steps.len() - 1;
            assert!(
                last as u32 <= STEPS
                    && steps.iter().any(|audio| audio.left.iter().any(|sample| *sample != 0.0))
            );
            let all =
                http::get(server.servers.web, &format!("/runs/{run}/episodes/{ordinal}/ears/0-{last}.wav"))
                    .await;
            assert_eq!(all.status, 200, "{}", all.body);
            assert!(body(&all)[HEAD_BYTES..] == interleaved(steps)[..], "episode {ordinal}");
            let some =
                http::get(server.servers.web, &format!("/runs/{run}/episodes/{ordinal}/ears/7-9.wav")).await;
            assert!(
                body(&some)[HEAD_BYTES..] == interleaved(&steps[7..=9])[..],
                "a part of episode {ordinal}"
            );
            let levels =
                http::get(server.servers.web, &format!("/api/v1/runs/{run}/episodes/{ordinal}/levels.csv"))
                    .await;
            assert_eq!(levels.body.lines().count(), steps.len() + 1, "{}", levels.body);
        }
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn hidden_replays_have_no_sound() {
        let server = TestServer::open(&TestSetup::default()).await;
        let deaf = play_script(&server.agents_url(), &server.token, "deaf").await;
        let hidden =
            TestServer::open(&TestSetup { visible_to: Visibility::Organiser, ..TestSetup::default() }).await;
        let (run, _) = play(&hidden, AUDIO_ONLY).await;
        for (server, run) in [(&server, &deaf), (&hidden, &run)] {
            for path in ["runs/RUN/episodes/0/ears/0-1.wav", "api/v1/runs/RUN/episodes/0/levels.csv"] {
                let answer = http::get(server.servers.web, &format!("/{}", path.replace("RUN", run))).await;
                assert_eq!(answer.status, 404, "{path}");
            }
            let page = http::get(server.servers.web, &format!("/runs/{run}/episodes/0?ears=on")).await;
            assert!(!page.body.contains("<audio"), "{}", page.body);
        }
    }
}
