//! An attacker guesses the seed of a hidden split, with the program, the public facts of the phase, and the observations of an
//! episode.

use avln_arena::{
    data::DataFolder,
    setup::{NewPhase, NewSplit, make_split, open_phase},
};
use avln_client::{Action, Client, RunOptions, Sensors};
use avln_dataset::{CueSpec, EpisodeSpec, SceneSource, Seed, Split, SplitSecret};
use avln_store::Visibility;
use avln_tests::{PHASE, TestServer, TestSetup, http, proxies::RecordingProxy};
use std::{
    collections::BTreeSet,
    fs,
    path::Path,
    process::{Command, Output},
};

/// Candidates of the attacker.
const CANDIDATES: u64 = 10_000;
/// Candidates whose houses and missions are made completely.
const MADE: usize = 3;

async fn split(folder: &Path, name: &str, seed: Seed) -> Split {
    let data = DataFolder::open(folder).expect("writable");
    let store = data.store().await.expect("a database");
    let new = NewSplit {
        name: name.to_owned(),
        houses: 1,
        scenes: vec![],
        missions: 2,
        seed,
        rules: "lh-avln-v1".to_owned(),
    };
    make_split(&data, &store, new, |_| ()).await.expect("a house with missions")
}

/// Seeds of all houses and missions.
fn seeds(split: &Split) -> BTreeSet<u64> {
    let house = |source: &SceneSource| match source {
        SceneSource::Procedural { seed, .. } => *seed,
        SceneSource::File { .. } => 0,
    };
    let houses = split.scenes.iter().map(|scene| house(&scene.source));
    houses.chain(split.episodes.iter().map(|episode| episode.seed)).collect()
}

/// Sentences of all missions.
fn sentences(split: &Split) -> BTreeSet<String> {
    let of = |episode: &EpisodeSpec| -> Vec<String> {
        let sentence = |cue: &CueSpec| match cue {
            CueSpec::Description(description) => Some(description.text.clone()),
            _ => None,
        };
        episode.goals.iter().filter_map(|goal| sentence(&goal.cue)).collect()
    };
    split.episodes.iter().flat_map(of).collect()
}

/// Numbers that a program could have used as a seed: all counts of low bits of the secret, and all small numbers.
fn candidates(secret: &SplitSecret) -> BTreeSet<u64> {
    let json = serde_json::to_string(secret).expect("JSON");
    let words =
        (0..4).map(|word| u64::from_str_radix(&json[1 + 16 * word..17 + 16 * word], 16).expect("digits"));
    let low = |word: u64| (1..=64).map(move |bits| word & (u64::MAX >> (64 - bits)));
    let words = words.flat_map(|word| low(word).chain(low(word.swap_bytes())));
    words.chain(0..CANDIDATES).collect()
}

/// Everything that an agent and a visitor receive: the phase, a run, and the observations of an episode.
async fn observe(server: &TestServer) -> Vec<u8> {
    let proxy = RecordingProxy::open(server.servers.grpc).await;
    let client = Client::connect(proxy.url(), &server.token).await.expect("a connection");
    client.phases().await.expect("an answer");
    let run = client.start_run(RunOptions::new(PHASE, "attacker")).await.expect("a run");
    let mut play = client.play(&run, Sensors::square(64)).await.expect("a stream");
    let mut episode = play.next_episode().await.expect("a stream").expect("an episode");
    for action in [Action::TurnLeft, Action::MoveForward, Action::Stop] {
        episode.step(action).await.expect("a legal step");
    }
    let mut seen = proxy.recorded();
    let pages = ["/api/v1/phases".to_owned(), format!("/phases/{PHASE}"), format!("/api/v1/runs/{}", run.id)];
    for page in pages {
        seen.extend(http::get(server.servers.web, &page).await.bytes);
    }
    seen
}

fn contains(bytes: &[u8], part: &[u8]) -> bool {
    bytes.windows(part.len()).any(|window| window == part)
}

#[tokio::test(flavor = "multi_thread")]
async fn no_candidate_seed_is_confirmed() {
    let setup = TestSetup { visible_to: Visibility::Organiser, ..TestSetup::default() };
    let server = TestServer::open(&setup).await;
    let data = DataFolder::open(server.folder.path()).expect("the data folder");
    let folder = data.missions(PHASE).expect("the split");
    let hidden = data.split(PHASE).expect("the split");
    let secret = folder.secret().expect("readable").expect("a hidden split has a secret").secret;
    let seen = observe(&server).await;

    // The digest of the true split confirms a guess only if the attacker receives it.
    assert!(!contains(&seen, folder.digest().as_bytes()), "the plain digest of the split");
    let binary: Vec<u8> = (0..folder.digest().len())
        .step_by(2)
        .map(|at| u8::from_str_radix(&folder.digest()[at..at + 2], 16).expect("digits"))
        .collect();
    assert!(!contains(&seen, &binary), "the plain digest of the split, in binary");
    let json = serde_json::to_string(&secret).expect("JSON");
    assert!(!contains(&seen, json.trim_matches('"').as_bytes()), "the secret");

    let (true_seeds, candidates) = (seeds(&hidden), candidates(&secret));
    assert!(candidates.len() as u64 >= CANDIDATES);
    for candidate in &candidates {
        // Houses of `avln scene --seed`, and of a numbered split with up to ten houses.
        let houses = (0..10).map(|house| candidate.wrapping_mul(1000).wrapping_add(house));
        let is_unknown = |seed: u64| !true_seeds.contains(&seed);
        assert!(houses.chain([*candidate]).all(is_unknown), "the seed {candidate} makes a hidden house");
    }
    let low_bits = candidates.iter().rev().take(MADE);
    for candidate in low_bits {
        let elsewhere = tempfile::tempdir().expect("a folder");
        let guess = split(elsewhere.path(), PHASE, Seed::Number(*candidate)).await;
        assert_ne!(guess.scenes[0].digest, hidden.scenes[0].digest, "the house of {candidate}");
        assert!(sentences(&guess).is_disjoint(&sentences(&hidden)), "the sentences of {candidate}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn hidden_phases_require_a_secret() {
    let folder = tempfile::tempdir().expect("a folder");
    split(folder.path(), "numbered", Seed::Number(4242)).await;
    let data = DataFolder::open(folder.path()).expect("writable");
    let store = data.store().await.expect("a database");
    let public = NewPhase::public("finals", "numbered");
    let replays = NewPhase { replays: Visibility::Team, ..public.clone() };
    for hidden in [NewPhase { scores: Visibility::Organiser, ..public.clone() }, replays] {
        let refused = open_phase(&data, &store, &hidden).await.expect_err("guessable").to_string();
        assert!(refused.contains("the number 4242") && refused.contains("without --seed"), "{refused}");
    }
    open_phase(&data, &store, &public).await.expect("a practice phase");
}

fn avln(data: &Path, arguments: &[&str]) -> Output {
    let mut program = Command::new(env!("CARGO_BIN_EXE_avln_under_test"));
    program.arg("--data").arg(data).args(arguments).output().expect("the program runs")
}

fn text(output: Output) -> String {
    assert!(output.status.success(), "{output:?}");
    String::from_utf8(output.stdout).expect("text")
}

#[test]
fn revealed_secret_rebuilds_the_split() {
    let folder = tempfile::tempdir().expect("a folder");
    let (data, file) = (folder.path().join("data"), folder.path().join("revealed.json"));
    let done = |line: &str| text(avln(&data, &line.split(' ').collect::<Vec<_>>()));
    done("data split make test --houses 1 --missions 2");
    for phase in ["first", "second"] {
        done(&format!("challenge phase open {phase} --split test --scores organiser --replays organiser"));
        done(&format!("challenge phase close {phase}"));
    }
    done("challenge phase resume second");
    assert!(!done("challenge reveal first").contains("avln-seed"), "the second phase still plays the split");
    done("challenge phase close second");
    let revealed = done("challenge reveal first");
    for reopened in ["open third --split test --scores organiser --replays organiser", "resume second"]
        .map(|line| format!("challenge phase {line}"))
    {
        let refused = avln(&data, &reopened.split(' ').collect::<Vec<_>>());
        let words = String::from_utf8(refused.stderr).expect("text");
        let said = "the secret of split 'test' is published with phase 'first'; make another split";
        assert!(!refused.status.success() && words.contains(said), "{reopened}: {words}");
    }
    fs::write(&file, &revealed).expect("a file");
    let verify = |at: &str| {
        let at = folder.path().join(at);
        let paths = [&file, &at].map(|path| path.to_str().expect("a path in Unicode"));
        avln(&data, &["challenge", "verify-reveal", paths[0], "--rebuild", paths[1]])
    };
    assert!(text(verify("again")).contains("the episodes of split test are those of phase first"));
    let digits = revealed.split("\"secret\": \"").last().expect("the secret of the split");
    let other = revealed.replace(&digits[..8], "00000000");
    fs::write(&file, other).expect("a file");
    let refused = String::from_utf8(verify("other").stderr).expect("text");
    assert!(refused.contains("has the pool"), "{refused}");
}
