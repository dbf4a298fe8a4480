//! The command line: help, hints and exit codes.

use avln_tests::{TEAM, TestSetup, set_up, share_cache};
use std::{
    fs,
    net::TcpListener,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};
use tempfile::TempDir;

/// Call result.
#[derive(Debug)]
struct Outcome {
    code: Option<i32>,
    out: String,
    err: String,
}

/// Runs the program with the data folder `data` and an empty environment.
fn avln(data: &Path, arguments: &[&str]) -> Outcome {
    avln_with(data, arguments, "AVLN_NOTHING", "")
}

/// Runs the program with an additional environment variable.
fn avln_with(data: &Path, arguments: &[&str], name: &str, value: &str) -> Outcome {
    let mut command = Command::new(env!("CARGO_BIN_EXE_avln_under_test"));
    for name in [
        "AVLN_LOG",
        "AVLN_LOG_FORMAT",
        "AVLN_GRPC",
        "AVLN_WEB",
        "AVLN_SERVER",
        "AVLN_TOKEN",
        "AVLN_ALLOW_PLAIN_TEXT",
        "AVLN_SEAL_KEY",
        "AVLN_SEAL_KEY_FILE",
    ] {
        command.env_remove(name);
    }
    let output = command
        .args(arguments)
        .env(name, value)
        .env("AVLN_DATA", data)
        .stdin(Stdio::null())
        .output()
        .expect("the program starts");
    Outcome {
        code: output.status.code(),
        out: String::from_utf8(output.stdout).expect("text"),
        err: String::from_utf8(output.stderr).expect("text"),
    }
}

/// Runs a call that must fail with `code`, one error line and at most one hint.
fn refused(data: &Path, arguments: &[&str], code: i32) -> String {
    let outcome = avln(data, arguments);
    assert_eq!(outcome.code, Some(code), "{outcome:?}");
    let lines: Vec<_> = outcome.err.lines().collect();
    assert!(lines.first().is_some_and(|line| line.starts_with("error: ")), "{outcome:?}");
    assert!(lines.len() == 1 || (lines.len() == 2 && lines[1].starts_with("hint: ")), "{outcome:?}");
    assert!(!outcome.err.contains("panicked") && !outcome.err.contains("backtrace"), "{outcome:?}");
    outcome.err
}

fn hinted(data: &Path, arguments: &[&str], code: i32, words: &[&str]) {
    let err = refused(data, arguments, code);
    assert!(err.contains("\nhint: "), "{err}");
    assert!(words.iter().all(|word| err.contains(word)), "{words:?} in: {err}");
}

const COMMANDS: [&str; 10] =
    ["demo", "serve", "admin", "agent", "challenge", "data", "run", "lab", "scene", "sim"];
const FREE: [&str; 4] = ["--grpc", "127.0.0.1:0", "--web", "127.0.0.1:0"];

fn data_folder() -> (TempDir, PathBuf) {
    let folder = TempDir::new().expect("a folder for temporary files");
    let data = folder.path().join("data");
    (folder, data)
}

#[test]
fn split_is_prepared_once() {
    let (_folder, data) = data_folder();
    let done = |arguments: &[&str]| {
        let outcome = avln(&data, arguments);
        assert_eq!(outcome.code, Some(0), "{outcome:?}");
        outcome.out
    };
    let kept = || {
        let files =
            fs::read_dir(data.join("cache/scenes")).expect("a folder").map(|file| file.expect("a file"));
        let mut names: Vec<_> = files.map(|file| file.file_name().into_string().expect("a name")).collect();
        names.sort();
        names
    };
    done(&["data", "split", "make", "few", "--houses", "1", "--missions", "1"]);
    let said = done(&["data", "split", "prepare", "few"]);
    let sources = kept().iter().filter(|name| name.ends_with(".sound")).count();
    assert!((2..=4).contains(&sources), "{sources}");
    assert!(said.contains(&format!("1 scene and {sources} sources")), "{said}");
    let before = kept();
    done(&["data", "split", "prepare", "few", "--threads", "1"]);
    assert_eq!(kept(), before);
    done(&["data", "split", "prepare", "few", "--cache-size", "9"]);
    assert_eq!(fs::read_to_string(data.join("cache/scenes/limit_gib")).expect("noted down"), "9");
    hinted(&data, &["data", "split", "prepare", "many"], 3, &["'many'", "avln data split make"]);
    refused(&data, &["data", "split", "prepare", "few", "--rules", "none"], 5);
}

#[test]
fn help_names_every_command_and_every_exit_code() {
    let (_folder, data) = data_folder();
    let help = avln(&data, &["--help"]);
    assert_eq!(help.code, Some(0));
    for command in COMMANDS {
        assert!(help.out.contains(&format!("\n  {command} ")), "{command} in: {}", help.out);
    }
    for code in [0, 1, 2, 3, 4, 5, 6] {
        assert!(help.out.contains(&format!("\n  {code}  ")), "exit code {code} in: {}", help.out);
    }
}

#[test]
fn wrong_command_line_exits_with_code_2() {
    let (_folder, data) = data_folder();
    for arguments in [&["dance"][..], &["demo", "--houses", "many"], &["scene", "info"], &[]] {
        let outcome = avln(&data, arguments);
        assert_eq!(outcome.code, Some(2), "{outcome:?}");
        assert!(outcome.err.contains("--help") || outcome.err.contains("Usage: avln"), "{outcome:?}");
    }
    assert!(!data.exists(), "nothing was made");
}

#[test]
fn unusable_data_folder_exits_with_code_3() {
    let (folder, _) = data_folder();
    let file = folder.path().join("file");
    fs::write(&file, "not a folder").expect("a file");
    hinted(&file.join("data"), &["challenge", "team", "add", "A"], 3, &["data folder", "--data FOLDER"]);

    let data = folder.path().join("data");
    hinted(
        &data,
        &["serve", "--admin", "off", FREE[0], FREE[1], FREE[2], FREE[3]],
        3,
        &["no phase to host", "avln challenge phase open"],
    );
    hinted(
        &data,
        &["challenge", "phase", "open", "p", "--split", "absent"],
        3,
        &["'absent'", "avln data split make"],
    );
}

#[test]
fn foreign_file_exits_with_code_3_unchanged() {
    let (_folder, data) = data_folder();
    fs::create_dir_all(&data).expect("a folder");
    let letter = "Dear diary, this is no database at all.\n".repeat(100);
    fs::write(data.join("avln.db"), &letter).expect("a file");
    let err = refused(&data, &["challenge", "team", "add", "A"], 3);
    assert!(err.contains("avln.db is not an LH-AVLN Arena database"), "{err}");
    assert_eq!(fs::read_to_string(data.join("avln.db")).expect("still a text"), letter);
}

#[test]
fn taken_port_exits_with_code_4_and_hint() {
    let (_folder, data) = data_folder();
    let taken = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let address = taken.local_addr().expect("its address").to_string();
    for (flag, other) in [("--grpc", "--web"), ("--web", "--grpc")] {
        let arguments = ["serve", "--admin", "off", flag, &address, other, "127.0.0.1:0"];
        hinted(&data, &arguments, 4, &[&address, flag]);
    }
    let open = ["serve", "--admin", "off", "--grpc", "0.0.0.0:0", "--web", "127.0.0.1:0"];
    hinted(&data, &open, 4, &["0.0.0.0:0", "plain text"]);
}

#[test]
fn corrupt_scene_exits_with_code_5() {
    let (folder, data) = data_folder();
    let scene = folder.path().join("house.glb");
    let path = scene.to_str().expect("a path in Unicode");
    let exported = avln(&data, &["scene", "export", "--seed", "3", path]);
    assert_eq!(exported.code, Some(0), "{exported:?}");
    let whole = fs::read(&scene).expect("the file that was written");
    let mut scrambled = whole.clone();
    scrambled[40..4000].reverse();
    let mut wrong_length = whole.clone();
    wrong_length[8..12].copy_from_slice(&u32::MAX.to_le_bytes());
    let truncated = whole[..whole.len() / 2].to_vec();
    let noise = b"glTF is a fine format, but this is a letter".to_vec();
    for corrupt in [scrambled, wrong_length, truncated, noise, vec![]] {
        fs::write(&scene, corrupt).expect("a file");
        refused(&data, &["scene", "info", "--scene", path], 5);
    }
    let demo = ["demo", "--once", "--scene", path, FREE[0], FREE[1], FREE[2], FREE[3]];
    let outcome = avln(&data, &demo);
    assert_eq!(outcome.code, Some(5), "{outcome:?}");
    assert_eq!(outcome.err.lines().count(), 1, "{outcome:?}");
    let absent = folder.path().join("absent.glb");
    refused(&data, &["scene", "info", "--scene", absent.to_str().expect("Unicode")], 5);
}

#[test]
fn exported_scene_contains_same_objects() {
    let (folder, data) = data_folder();
    let path = folder.path().join("house.glb");
    let path = path.to_str().expect("a path in Unicode");
    assert_eq!(avln(&data, &["scene", "export", "--seed", "3", path]).code, Some(0));
    let lines = |outcome: &Outcome| {
        let counts =
            outcome.out.lines().filter(|line| line.starts_with("triangles") || line.starts_with("objects"));
        counts.map(str::to_owned).collect::<Vec<_>>()
    };
    let (grown, read) =
        (avln(&data, &["scene", "info", "--seed", "3"]), avln(&data, &["scene", "info", "--scene", path]));
    assert_eq!(lines(&grown).len(), 2, "{grown:?}");
    assert_eq!(lines(&grown), lines(&read));
}

#[test]
fn a_test_room_is_measured_and_written() {
    let (folder, data) = data_folder();
    let (wav, setup) = (folder.path().join("rir.wav"), folder.path().join("plan.json"));
    let [wav, setup] = [&wav, &setup].map(|path| path.to_str().expect("a path in Unicode"));
    let rir = ["sim", "rir", "--source", "1,1.2,1", "--listener", "3,1.2,1,-90"];
    let dead = ["--shoebox", "4x3x2.5", "--absorption", "1", "--omni", "--json", "--out", wav];
    let measured = avln(&data, &[&rir[..], &dead].concat());
    assert_eq!(measured.code, Some(0), "{measured:?}");
    let report: serde_json::Value = serde_json::from_str(&measured.out).expect("JSON");
    let number = |path: &str| report.pointer(path).and_then(serde_json::Value::as_f64).expect(path);
    assert!((number("/direct_delay_s") - 2.0 / 343.0).abs() < 1e-6, "{report}");
    assert!((number("/first_arrival_azimuth_deg").abs() - 180.0).abs() < 1e-3, "{report}");
    assert!((number("/level_db/1000") + 6.02).abs() < 0.1 && number("/itd_us") == 0.0, "{report}");
    for name in ["t20_s", "t30_s", "edt_s", "c50_db", "ild_db"] {
        for band in ["125", "250", "500", "1000", "2000", "4000"] {
            assert!(report.pointer(&format!("/{name}/{band}")).is_some(), "{name} at {band} Hz in {report}");
        }
    }
    assert_eq!(fs::read(wav).expect("a sound file").get(..4), Some(&b"RIFF"[..]));

    fs::write(setup, r#"{"vertices": [[0,0],[4,3],[4,0],[0,3]], "height_m": 2.5}"#).expect("a file");
    hinted(&data, &[&rir[..], &["--polygon", setup]].concat(), 3, &["corner 0", "corner 2", "once around"]);
    hinted(&data, &[&rir[..], &["--polygon", "absent.json"]].concat(), 3, &["absent.json"]);
    hinted(&data, &[&rir[..], &["--shoebox", "2x3x2.5"]].concat(), 5, &["the listener", "outside"]);
    refused(&data, &[&rir[..], &["--shoebox", "4x3x900"]].concat(), 5);
    for wrong in [
        &["--shoebox", "4x3"][..],
        &["--shoebox", "4x3x2", "--seed", "1"],
        &["--seed", "1", "--absorption", "7"],
        &[],
    ] {
        assert_eq!(avln(&data, &[&rir[..], wrong].concat()).code, Some(2), "{wrong:?}");
    }
}

#[test]
fn a_walk_is_rendered_and_rings_out() {
    let (folder, data) = data_folder();
    let [poses, empty, wav] = ["poses.json", "empty.json", "walk.wav"].map(|name| folder.path().join(name));
    fs::write(&poses, r#"{"poses": [[1,0,1,0],[1,0,1,-30],[1.2,0,1,-30]], "collided": [false,false,true]}"#)
        .expect("a file");
    fs::write(&empty, "[]").expect("a file");
    let [poses, empty, out] = [&poses, &empty, &wav].map(|path| path.to_str().expect("a path in Unicode"));
    let listen = ["sim", "listen", "--shoebox", "4x3x2.5", "--rays", "500", "--seconds", "0.3", "--out", out];
    let sources = ["--source", "3,1.2,2", "--source", "3,1.2,0.5", "--turn", "2"];
    let heard = avln(&data, &[&listen[..], &sources, &["--poses", poses]].concat());
    assert_eq!(heard.code, Some(0), "{heard:?}");
    // Three steps plus three for the reverberation, 4000 samples each, two channels of four bytes.
    let bytes = fs::read(&wav).expect("a sound file");
    assert_eq!(bytes.len() / 32_000, 6, "{} bytes", bytes.len());
    let last = bytes.len() - 16_000;
    assert!(bytes[last..].iter().all(|byte| *byte == 0), "the end is silent");
    assert!(bytes[100_000..110_000].iter().any(|byte| *byte != 0), "what rings is not");

    hinted(&data, &[&listen[..], &sources, &["--poses", empty]].concat(), 3, &["0 poses", "4000"]);
    let unknown = ["--poses", poses, "--clip", "whale-song"];
    hinted(&data, &[&listen[..], &sources, &unknown].concat(), 3, &["whale-song", "pink-bursts-0"]);
    let no_head = ["--poses", poses, "--head", poses];
    hinted(&data, &[&listen[..], &sources, &no_head].concat(), 3, &["poses.json", "SOFA"]);
    let outside = ["--poses", poses, "--ear-height", "9"];
    hinted(&data, &[&listen[..], &sources, &outside].concat(), 5, &["the listener", "outside"]);
}

#[test]
fn an_agent_without_a_server_is_code_6() {
    let (_folder, data) = data_folder();
    let nobody = TcpListener::bind("127.0.0.1:0").expect("a free port").local_addr().expect("its address");
    let url = format!("http://{nobody}");
    let err = refused(&data, &["agent", "random", "--server", &url, "--token", "t", "--phase", "p"], 6);
    assert!(err.contains(&url) && err.contains("--server"), "{err}");
}

#[tokio::test(flavor = "multi_thread")]
async fn wrong_token_or_phase_exits_with_code_6() {
    let data_folder = avln_tests::TestServer::open(&TestSetup::default()).await;
    let (url, token) = (data_folder.agents_url(), data_folder.token.clone());
    let data = data_folder.folder.path().to_owned();
    let calls = tokio::task::spawn_blocking(move || {
        let agent = |token: &str, phase: &str| {
            refused(&data, &["agent", "random", "--server", &url, "--token", token, "--phase", phase], 6)
        };
        (agent("wrong", avln_tests::PHASE), agent(&token, "finals"))
    });
    let (token, phase) = calls.await.expect("the calls end");
    assert!(token.contains("--token"), "{token}");
    assert!(phase.contains("'finals'") && phase.contains(avln_tests::PHASE), "{phase}");
}

#[tokio::test(flavor = "multi_thread")]
async fn teams_are_admitted_and_refused_by_name() {
    let (_folder, data) = data_folder();
    set_up(&data, &TestSetup { missions: 1, ..TestSetup::default() }).await;
    let added = avln(&data, &["challenge", "team", "add", "Another"]);
    assert_eq!(added.code, Some(0), "{added:?}");
    assert!(added.out.contains("token  "), "{added:?}");
    let revoked = avln(&data, &["challenge", "team", "revoke", TEAM]);
    assert!(revoked.out.starts_with("1 tokens"), "{revoked:?}");
    hinted(&data, &["challenge", "team", "add", "two\nlines"], 3, &["printable"]);
    hinted(
        &data,
        &["challenge", "phase", "open", "../up", "--split", avln_tests::PHASE],
        5,
        &["'../up'", "letters"],
    );
}

#[test]
fn demo_prints_two_tables_and_reuses_data() {
    let (_folder, data) = data_folder();
    share_cache(&data);
    let demo = || {
        // Seed 8 draws a mission of which the agents end their episodes early.
        let small = ["demo", "--once", "--houses", "1", "--missions", "1", "--seed", "8"];
        let outcome = avln(&data, &[&small[..], &FREE[..]].concat());
        assert_eq!(outcome.code, Some(0), "{outcome:?}");
        outcome.out
    };
    let (first, second) = (demo(), demo());
    let tables = |out: &str| out[out.find("\nordered (").expect("a table of ordered missions")..].to_owned();
    for words in ["\nordered (1 episodes", "\nunordered (1 episodes", "Data folder"] {
        assert!(first.contains(words), "'{words}' in: {first}");
    }
    for method in ["random", "PAG-Nav"] {
        let rows = first.lines().filter(|line| line.contains(&format!("  {method} "))).count();
        assert_eq!(rows, 2, "{method} in both tables: {first}");
    }
    assert!(second.contains("Found phase"), "{second}");
    assert_eq!(tables(&first), tables(&second));
}

#[test]
fn organising_page_commands_work() {
    let (folder, data) = data_folder();
    let done = |arguments: &[&str]| {
        let outcome = avln(&data, arguments);
        assert_eq!(outcome.code, Some(0), "{arguments:?}: {outcome:?}");
        outcome.out
    };
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/challenge.toml");
    let missing = avln(&data, &["challenge", "check", page]).err;
    assert_eq!(missing.matches("challenge.toml, line ").count(), 3, "both splits are missing: {missing}");
    done(&["data", "split", "make", "val", "--houses", "1", "--missions", "1", "--seed", "7"]);
    done(&["data", "split", "make", "hidden", "--houses", "1", "--missions", "4"]);
    assert!(done(&["challenge", "check", page]).contains("\n3 phases to add, 0 to change, 0 splits"));
    assert_eq!(done(&["challenge", "show"]).trim(), "phases = []");
    done(&["challenge", "apply", page, "--reason", "first version"]);
    assert_eq!(done(&["challenge", "apply", page]).trim(), "nothing to change");
    let shown = folder.path().join("shown.toml");
    fs::write(&shown, done(&["challenge", "show"])).expect("a file");
    let shown = shown.to_str().expect("Unicode");
    assert_eq!(done(&["challenge", "apply", shown]).trim(), "nothing to change");
    let json: serde_json::Value =
        serde_json::from_str(&done(&["challenge", "show", "--json"])).expect("JSON");
    assert_eq!(json.pointer("/phases/1/opens"), Some(&"2026-07-01T00:00:00Z".into()));

    assert!(
        done(&["challenge", "token", "new", "--organiser", "--name", "my laptop"])
            .contains("token    avln_organiser_")
    );
    done(&["challenge", "team", "add", "Ada"]);
    done(&["challenge", "token", "new", "--team", "Ada", "--read-only", "--expires", "30d"]);
    let tokens: Vec<String> = done(&["challenge", "token", "list"]).lines().map(str::to_owned).collect();
    assert_eq!(tokens.len(), 3, "{tokens:?}");
    let id = tokens.iter().find(|line| line.contains("read_only")).expect("a token for looking");
    done(&["challenge", "token", "revoke", id.split_whitespace().next().expect("an id")]);
    done(&["challenge", "team", "approve", "Ada", "--phase", "challenge"]);
    let reason = "full disk";
    done(&["challenge", "team", "grant", "Ada", "--phase", "standard", "--runs", "2", "--reason", reason]);
    done(&["challenge", "team", "member", "add", "Ada", "ada@example.org", "--phase", "challenge"]);
    done(&["challenge", "team", "add", "Bob"]);
    let second = ["challenge", "team", "member", "add", "Bob", "Ada@Example.org", "--phase", "challenge"];
    assert!(refused(&data, &second, 3).contains("'ada@example.org' is in team 'Ada'"));
    done(&["challenge", "phase", "pause", "standard", "--reason", "the server moves"]);
    done(&["challenge", "phase", "resume", "standard"]);
    let of_nobody = ["challenge", "ruling", "disqualified", "run_of_nobody", "--reason", "why"];
    assert!(refused(&data, &of_nobody, 3).contains("there is no run 'run_of_nobody'"));
    hinted(&data, &["challenge", "ruling", "verified", "run_of_nobody", "--reason", " "], 3, &["say why"]);
    assert!(refused(&data, &["challenge", "reveal", "practice"], 3).contains("not closed"));
    done(&["challenge", "phase", "close", "challenge"]);
    let revealed = folder.path().join("revealed.json");
    let published = done(&["challenge", "reveal", "challenge"]);
    fs::write(&revealed, &published).expect("a file");
    let revealed = revealed.to_str().expect("a path in Unicode");
    let own = data.join("splits/hidden").display().to_string();
    let whole = ["challenge", "verify-reveal", revealed, "--dataset", &own, "--split", "hidden"];
    assert!(done(&whole).contains("the episodes of split hidden are those of phase challenge"));
    fs::write(revealed, published.replace("\"scorer\": \"2", "\"scorer\": \"3")).expect("a file");
    hinted(&data, &["challenge", "verify-reveal", revealed], 3, &["do not give its commitment"]);
    let audit = done(&["challenge", "audit"]);
    for words in ["because first version", "the server moves", "revealed", "granted in phase standard"] {
        assert!(audit.contains(words), "{words} in {audit}");
    }
    assert!(!audit.contains("ada@example.org"), "people are not named in {audit}");
}

#[test]
fn sealed_split_requires_its_passphrase() {
    let (folder, data) = data_folder();
    assert_eq!(
        avln(&data, &["data", "split", "make", "val", "--houses", "1", "--missions", "1"]).code,
        Some(0)
    );
    let [good, other, weak] = ["good", "other", "weak"].map(|name| folder.path().join(name));
    fs::write(&good, "V3ry-l0ng.and/unlike+others\n").expect("a file");
    fs::write(&other, "An0ther-long.and/good+one\n").expect("a file");
    fs::write(&weak, "password12345678").expect("a file");
    let sealed = |key: &Path| {
        let key = key.to_str().expect("a path in Unicode");
        avln(&data, &["data", "split", "seal", "val", "--key-file", key])
    };
    assert!(sealed(&weak).err.contains("too weak"));
    assert!(sealed(&good).out.contains("4 files are sealed now, 0 were before"));
    assert!(sealed(&good).out.contains("0 files are sealed now, 4 were before"));
    assert!(sealed(&other).err.contains("wrong passphrase"));
    let mut files = vec![data.join("splits/val")];
    let mut read = 0;
    while let Some(path) = files.pop() {
        if path.is_dir() {
            files.extend(fs::read_dir(path).expect("a folder").map(|entry| entry.expect("an entry").path()));
        } else if !path.ends_with("dataset.json") {
            assert!(fs::read(&path).expect("a file").starts_with(b"avln sealed 1\n"), "{}", path.display());
            read += 1;
        }
    }
    assert_eq!(read, 4);
    let open = ["challenge", "phase", "open", "p", "--split", "val"];
    hinted(&data, &open, 3, &["is sealed", "AVLN_SEAL_KEY_FILE"]);
    let with = |key: &Path| avln_with(&data, &open, "AVLN_SEAL_KEY_FILE", key.to_str().expect("Unicode"));
    assert!(with(&other).err.contains("wrong passphrase"));
    let opened = with(&good);
    assert!(opened.out.contains("phase p is open: 1 episodes"), "{opened:?}");
}

/// All help texts on a page.
fn manual(data: &Path) -> String {
    let mut page =
        "# Command line of `avln`\n\nThe help texts of all commands. `AVLN_BLESS=1 cargo test -p avln-tests \
                    command_line` writes this page.\n"
            .to_owned();
    let mut waiting = vec![Vec::<String>::new()];
    while let Some(command) = waiting.pop() {
        let arguments: Vec<&str> = command.iter().map(String::as_str).chain(["--help"]).collect();
        let help = avln(data, &arguments);
        assert_eq!(help.code, Some(0), "{help:?}");
        let shown = help.out.replace(&format!("[env: AVLN_DATA={}]", data.display()), "[env: AVLN_DATA=]");
        let name = [&["avln".to_owned()], &command[..]].concat().join(" ");
        let trimmed: Vec<_> = shown.lines().map(str::trim_end).collect();
        page += &format!("\n## {name}\n\n```text\n{}\n```\n", trimmed.join("\n").trim_end());
        waiting.extend(children(&shown).rev().map(|child| [&command[..], &[child]].concat()));
    }
    page
}

/// Names below `Commands:` in a help text.
fn children(help: &str) -> impl DoubleEndedIterator<Item = String> {
    let below = help.split_once("Commands:\n").map_or("", |(_, below)| below);
    let section = below.split("\n\n").next().unwrap_or_default();
    let names = section.lines().filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    let names = names.filter_map(|line| line.split_whitespace().next()).filter(|name| *name != "help");
    names.map(str::to_owned).collect::<Vec<_>>().into_iter()
}

#[test]
fn command_line_page_matches_program_help() {
    let (_folder, data) = data_folder();
    let page = manual(&data);
    assert!(page.contains("## avln scene export\n"), "{page}");
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/CLI.md");
    if std::env::var_os("AVLN_BLESS").is_some() {
        fs::write(&path, &page).expect("the page can be written");
    }
    let written = fs::read_to_string(&path).unwrap_or_default();
    assert!(written == page, "docs/CLI.md is out of date; run this test with AVLN_BLESS=1");
}
