//! The commands in the documents work: bash runs them line by line in a folder like the reader's.

use avln_tests::machine::{self, files, root, shown, skipped, text, typed};
use std::{
    env, fs,
    net::TcpListener,
    os::unix::fs::symlink,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    sync::atomic::{AtomicU16, Ordering},
};

/// Longest time that a journey may take, seconds.
const LIMIT_S: &str = "900";

/// Documents followed in sequence, in one folder and against one server.
struct Journey {
    documents: &'static [&'static str],
    /// Commands before the first document.
    before: &'static str,
    /// Replacements of commands: shorter ones, or values left to the reader.
    instead: &'static [(&'static str, &'static str)],
    /// Skipped line prefixes, with the reason.
    not_typed: &'static [(&'static str, &'static str)],
}

const PARTICIPANT: Journey = Journey {
    documents: &[
        "README.md",
        "docs/QUICKSTART.md",
        "docs/python.md",
        "docs/performance.md",
        "docs/FAQ.md",
        "docs/VERIFYING.md",
    ],
    before: "mkdir -p path/to && avln scene export --seed 14 path/to/house.glb",
    instead: &[
        // First, because entries below add options to `avln demo`.
        ("avln demo", "avln demo --houses 1 --missions 1"),
        // Seed 8 draws a mission of which the agents end their episodes early.
        ("cargo run --release -- demo --scene", "avln demo --missions 1 --seed 8 --scene"),
        ("cargo run --release -- demo", "avln demo --houses 1 --missions 1"),
        // The demo in a scan has replaced the server.
        (
            "avln challenge team add \"My team\"",
            "avln demo --houses 1 --missions 1 && avln challenge team add \"My team\"",
        ),
        ("--houses 10 --missions 20", "--houses 1 --missions 2"),
        ("--houses 3 --missions 4", "--houses 1 --missions 2"),
        ("--episodes 2 --steps 900", "--episodes 1 --steps 9"),
        ("http://127.0.0.1:50051", "$AVLN_SERVER"),
        ("tcp://127.0.0.1:5555", "tcp://127.0.0.1:*"),
        ("https://arena.example:50051", "$AVLN_SERVER"),
        ("https://arena.example:8443", "http://$AVLN_WEB"),
        ("avln_account_…", "$TOKEN"),
        ("AVLN_TOKEN=…", "AVLN_TOKEN=$TOKEN"),
        ("/RUN/", "/$RUN/"),
        ("RUN.log", "$RUN.log"),
        ("--key KEY", "--key $(log_key)"),
    ],
    not_typed: &[
        ("cargo test", "it runs this test"),
        ("cargo build", "the program under test replaces it"),
        ("git clone", "the tests run in a clone"),
        ("docker", "an engine may be missing"),
        ("pip install", "the package is installed, or its lines are skipped"),
        ("cd .. && cargo new", "the check of the packages compiles and runs it"),
        ("cargo add", "the check of the packages compiles and runs it"),
        ("cargo run -r", "the check of the packages compiles and runs it"),
        ("cargo bench", "benchmarks take minutes"),
        ("python3 -m venv .venv", "the package is installed, or its lines are skipped"),
        ("python3 -m venv /tmp/venv", "peers of benchmarks are not installed"),
        ("apt-get install libgl1", "peers of benchmarks are not installed"),
        ("/tmp/venv/bin/python", "peers of benchmarks are not installed"),
    ],
};

const ORGANISER: Journey = Journey {
    documents: &["docs/ORGANISING.md", "docs/OPERATING.md"],
    before: "mkdir scans && avln scene export --seed 7 scans/house.glb --semantics hm3d",
    instead: &[
        ("--houses 4 --missions 4 --seed", "--houses 1 --missions 2 --seed"),
        ("--houses 4 --missions 4", "--houses 1 --missions 4"),
        ("scans/00800-TEEsavR23oF", "scans/house.glb"),
        ("https://arena.example:50051", "$AVLN_SERVER"),
        ("--token TOKEN", "--token $TOKEN"),
        ("AVLN_TOKEN=…", "AVLN_TOKEN=$ORGANISER"),
        ("/srv/avln", "avln-data"),
        ("avln serve --data /srv/new", "AVLN_SEAL_KEY_FILE=seal.key avln serve --data new"),
        ("/srv/new", "new"),
        ("/backups/", ""),
        ("--key KEY", "--key $(log_key)"),
    ],
    not_typed: &[
        ("cd agents/ada", "the tests of sealed runs cover it"),
        ("avln challenge sealed run --data /srv/avln", "the tests of sealed runs cover it"),
        ("avln serve --grpc 0.0.0.0:50051", "the TLS tests cover it"),
        ("avln serve --log warn,avln_grpc=debug", "the tests of the log cover it"),
        ("jq -r", "jq may be missing"),
    ],
};

const RESEARCHER: Journey = Journey {
    documents: &["docs/DATASET.md", "docs/HABITAT.md", "docs/checking-sound.md", "docs/perception.md"],
    before: r#"echo '["MoveForward", "TurnLeft"]' > actions.json
echo '[{"position": [1, 1.25, -2], "rotation": [0, 0.7071, 0, 0.7071]}]' > poses.json"#,
    instead: &[
        ("build paper", "build journeys/few.json"),
        ("--houses 240 --views 60", "--houses 1 --views 2"),
        ("--houses 11 --views 60", "--houses 1 --views 2"),
        ("--episodes 2000", "--episodes 1"),
        (" --head listener.sofa", ""),
        ("cargo run --release -p avln-perception --example measure --", "example measure"),
        ("cargo run --release -p avln-kit --example recognise --", "example recognise"),
    ],
    not_typed: &[
        ("avln data split export val --dataset imported", "the import tests cover it"),
        ("avln data dataset import auto", "the import tests cover it"),
    ],
};

/// Container commands, without an engine, in the same order and folders.
const DEPLOYER: Journey = Journey {
    documents: &["docs/deploying.md"],
    before: "mkdir backups && export AVLN_SEAL_KEY_FILE=docker/secrets/seal.key",
    instead: &[
        ("sudo chown -R 10001 docker/secrets && sudo chmod", "chmod"),
        ("docker compose run --rm challenge-server ", ""),
        ("docker compose exec challenge-server ", ""),
        ("docker compose exec -e AVLN_TOKEN=avln_account_… challenge-server ", "AVLN_TOKEN=$ORGANISER "),
        ("--houses 4 --missions 4 --seed", "--houses 1 --missions 2 --seed"),
        ("--houses 4 --missions 4", "--houses 1 --missions 4"),
        ("apply /challenge/", "apply docker/challenge/"),
        ("docker compose up --detach", "avln serve"),
        (
            "docker compose run --rm --no-deps challenge-backup ls /backups",
            "avln data db backup backups/NAME.tar",
        ),
        (
            "docker run --rm --volume avln-restored:/data --volume avln-backups:/backups:ro avln-server avln",
            "avln --data restored",
        ),
        ("restore /backups/", "restore backups/"),
        (
            "docker compose exec challenge-backup avln data db backup /backups/",
            "avln data db backup backups/",
        ),
        ("avln_account_…", "$TOKEN"),
        ("AVLN_TOKEN=…", "AVLN_TOKEN=$ORGANISER"),
        ("python3 play.py --phase challenge", "avln agent random --phase challenge"),
        ("docker compose up --exit-code-from sealed-agent", "avln serve && $AVLN_AGENT_COMMAND"),
        // The trial, after the longer forms above.
        ("docker compose up", "true"),
        ("sudo install -d -o avln -g avln -m 700 /var/lib/avln", "install -d -m 700 service"),
        ("sudo -u avln avln", "avln"),
        ("/var/lib/avln", "service"),
    ],
    not_typed: &[
        ("openssl req", "the TLS tests run it"),
        ("just dist", "the build of a release takes too long"),
        ("sha256sum --check", "there is no release to check"),
        ("gh attestation", "there is no release to check"),
        ("openssl pkeyutl", "the tests of releases run it"),
        ("docker compose build", "an engine may be missing"),
        ("docker image rm", "an engine may be missing"),
        ("docker builder prune", "an engine may be missing"),
        ("docker compose down", "a later server replaces the running one"),
        ("docker volume create", "an engine may be missing"),
        ("docker run --rm --user 0", "an engine may be missing"),
        ("sudo install avln", "root is required"),
        ("sudo install -D", "root is required"),
        ("sudo install -m 644", "root is required"),
        ("sudo systemd-sysusers", "root is required"),
        ("sudo systemctl", "root is required"),
    ],
};

const JOURNEYS: [&Journey; 4] = [&PARTICIPANT, &ORGANISER, &RESEARCHER, &DEPLOYER];

/// Documents that are not followed, with the reason.
const NOT_FOLLOWED: [(&str, &str); 6] = [
    ("CONTRIBUTING.md", "its commands run these tests"),
    ("agents/perception/training/README.md", "training takes hours"),
    (
        "client-sdk/python/README.md",
        "docs/python.md contains its lines, or the tests of the package run them",
    ),
    ("client-sdk/javascript/README.md", "the tests of the JavaScript client run its lines"),
    ("docs/languages.md", "the tests of the JavaScript client run its lines"),
    ("docs/models.md", "the models are not part of the repository"),
];

/// Programs with which documents are followed.
const TOOLS: [&str; 3] = ["bash", "timeout", "curl"];

/// Line prefixes that need the Python package.
const PYTHON: [&str; 3] = ["avln-py", "avln-bridge", "python "];

/// Free addresses below the ephemeral port range.
fn free_addresses() -> [String; 3] {
    static NEXT: AtomicU16 = AtomicU16::new(0);
    // Other processes of the same tests look for ports at the same time.
    let first = 20_000 + (std::process::id() % 400) as u16 * 24;
    [(); 3].map(|()| {
        loop {
            let address = format!("127.0.0.1:{}", first + NEXT.fetch_add(1, Ordering::Relaxed));
            if TcpListener::bind(&address).is_ok() {
                break address;
            }
        }
    })
}

fn is_there(program: &str) -> bool {
    let mut version = Command::new(program);
    version.arg("--version").stdout(Stdio::null()).status().is_ok_and(|status| status.success())
}

fn needs_python(line: &str) -> bool {
    PYTHON.iter().any(|start| line.starts_with(start))
}

fn has_python() -> bool {
    let modules = ["avln", "zmq", "msgpack"];
    machine::python("lines of Python", &modules, "pip install \"./client-sdk/python[bridge]\"").is_some()
}

impl Journey {
    /// All typed lines, each preceded by an echo.
    fn script(&self) -> String {
        let lines: Vec<_> = self.documents.iter().flat_map(|document| typed(&text(document))).collect();
        for (what, _) in self.instead {
            assert!(
                lines.iter().any(|line| line.contains(what)),
                "no document contains {what:?}, which would be replaced"
            );
        }
        for (start, why) in self.not_typed {
            assert!(lines.iter().any(|line| line.starts_with(start)), "nothing begins with {start:?}: {why}");
        }
        let leaves_python_out = lines.iter().any(|line| needs_python(line)) && !has_python();
        let is_left_out = |line: &String| {
            self.not_typed.iter().any(|(start, _)| line.starts_with(start))
                || (leaves_python_out && needs_python(line))
        };
        let typed = lines.iter().filter(|line| !is_left_out(line)).map(|line| {
            let line = self.instead.iter().fold(line.clone(), |line, (from, to)| line.replace(from, to));
            format!("cat <<'LINE'\n$ {line}\nLINE\n{line}\n")
        });
        let terminal = root().join("tests/journeys/terminal.bash");
        format!("source '{}'\n{}\n{}", terminal.display(), self.before, typed.collect::<String>())
    }

    /// Runs the script; a failing command fails the test with the whole output.
    fn make(&self) {
        if let Some(missing) = TOOLS.iter().find(|tool| !is_there(tool)) {
            let part = format!("{:?}, for there is no {missing}", self.documents);
            skipped(&part, "install bash, coreutils and curl");
            return;
        }
        let folder = tempfile::tempdir().expect("a folder");
        for part in ["client-sdk", "docs", "tests/journeys"] {
            let name = Path::new(part).file_name().expect("a name");
            symlink(root().join(part), folder.path().join(name)).expect("a link");
        }
        let script = folder.path().join("journey.bash");
        fs::write(&script, self.script()).expect("a script");
        let said = folder.path().join("said.txt");
        let output =
            || Stdio::from(fs::File::options().create(true).append(true).open(&said).expect("a file"));
        let mut terminal = Command::new("timeout");
        terminal.args([LIMIT_S, "bash"]).arg(&script).current_dir(folder.path());
        surround(&mut terminal);
        let status = terminal.stdout(output()).stderr(output()).status().expect("bash runs");
        let said = fs::read_to_string(&said).expect("what was said");
        assert!(status.success(), "{:?}: {status}\n{said}", self.documents);
        println!("{said}");
    }
}

/// Sets the environment: this journey's ports, none of the developer's variables.
fn surround(terminal: &mut Command) {
    let [grpc, web, admin] = free_addresses();
    for name in ["AVLN_TOKEN", "AVLN_CA", "AVLN_DATA", "AVLN_SEAL_KEY", "AVLN_SEAL_KEY_FILE"] {
        terminal.env_remove(name);
    }
    let program = Path::new(env!("CARGO_BIN_EXE_avln_under_test"));
    terminal.env("AVLN_BIN", program).env("EXAMPLES", program.with_file_name("examples"));
    terminal.env("AVLN_SERVER", format!("http://{grpc}"));
    terminal.env("AVLN_GRPC", grpc).env("AVLN_WEB", web).env("AVLN_ADMIN", admin);
    if let Some(python) = env::var_os("AVLN_PYTHON") {
        let beside = Path::new(&python).parent().expect("a folder").to_owned();
        let path = env::var_os("PATH").unwrap_or_default();
        let paths = std::iter::once(beside).chain(env::split_paths(&path));
        terminal.env("PATH", env::join_paths(paths).expect("a path"));
    }
}

#[test]
fn each_document_with_commands_is_followed_or_named() {
    let with_commands = |page: &PathBuf| !typed(&fs::read_to_string(page).expect("a text")).is_empty();
    let pages: Vec<_> =
        files(&root(), ".md").into_iter().filter(with_commands).map(|page| shown(&page)).collect();
    let followed = JOURNEYS.iter().flat_map(|journey| journey.documents).copied();
    let mut known: Vec<_> = followed.chain(NOT_FOLLOWED.map(|(page, _)| page)).collect();
    known.sort_unstable();
    assert_eq!(pages, known);
}

#[test]
fn participants_get_a_score() {
    PARTICIPANT.make();
}

#[test]
fn organisers_hold_a_challenge() {
    ORGANISER.make();
}

#[test]
fn researchers_get_data() {
    RESEARCHER.make();
}

#[test]
fn servers_are_deployed_and_restored() {
    DEPLOYER.make();
}
