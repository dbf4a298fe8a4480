//! What containers run does what it should, here without an engine: the scripts and commands of the compose file, in order.

use avln_tests::{
    repository::{root, text},
    server::Server,
};
use std::{
    fs,
    os::unix::{fs::symlink, process::CommandExt},
    path::{Path, PathBuf},
    process::{Child, Command},
    time::{Duration, Instant},
};
use tempfile::TempDir;
use yaml_rust2::YamlLoader;

const PROGRAM: &str = env!("CARGO_BIN_EXE_avln_under_test");
/// Where images keep scripts.
const SCRIPTS: &str = "/usr/local/lib/avln";
const PATIENCE: Duration = Duration::from_secs(60);

/// A folder with what containers have in theirs.
struct Container {
    folder: TempDir,
}

impl Container {
    fn new() -> Self {
        let folder = TempDir::new().expect("a folder");
        fs::create_dir(folder.path().join("bin")).expect("a folder");
        symlink(PROGRAM, folder.path().join("bin/avln")).expect("a link");
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A command with the program on its path and the data folder that images have.
    fn command(&self, words: &[String]) -> Command {
        let local = |word: &String| word.replace(SCRIPTS, &root().join("docker").display().to_string());
        let words: Vec<String> = words.iter().map(local).collect();
        let path = std::env::var("PATH").unwrap_or_default();
        let mut command = Command::new(&words[0]);
        command.args(&words[1..]).env("PATH", format!("{}:{path}", self.path("bin").display()));
        command.env("AVLN_DATA", self.path("data")).env_remove("AVLN_TOKEN").env_remove("AVLN_CA");
        command.env("AVLN_TOKEN_FILE", self.path("token"));
        command
    }

    fn succeeds(&self, mut command: Command) -> String {
        let output = command.output().expect("it starts");
        let told = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success(), "{command:?}: {told}{}", String::from_utf8_lossy(&output.stderr));
        told
    }
}

/// The command of a service of the compose file.
fn command_of(service: &str) -> Vec<String> {
    let documents = YamlLoader::load_from_str(&text("docker/compose.yaml")).expect("YAML");
    let command = &documents[0]["services"][service]["command"];
    command.as_vec().expect("words").iter().map(|word| word.as_str().expect("a word").to_owned()).collect()
}

/// What the image of the agents begins each command with.
fn entry() -> String {
    let file = text("docker/agents.Dockerfile");
    let entry = file.lines().find_map(|line| line.strip_prefix("ENTRYPOINT [\"")).expect("an entry");
    entry.trim_end_matches("\"]").to_owned()
}

#[test]
fn a_trial_is_set_up_once_and_its_agent_plays_by_the_token_in_the_file() {
    let container = Container::new();
    let setup = || container.succeeds(container.command(&command_of("trial-setup")));
    assert!(setup().contains("phase practice is open"));
    let token = fs::read_to_string(container.path("token")).expect("a token");
    assert!(setup().is_empty(), "a second start finds it");
    assert_eq!(fs::read_to_string(container.path("token")).expect("a token"), token);

    let server = Server::start(PROGRAM, &container.path("data"));
    let words = [vec![entry()], command_of("trial-random")].concat();
    let mut agent = container.command(&words);
    agent.env("AVLN_SERVER", format!("http://{}", server.grpc));
    assert!(container.succeeds(agent).contains("6 of 6 episodes, complete"));
}

/// Backups that lie in `folder`.
fn backups(folder: &Path) -> Vec<PathBuf> {
    let files = fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path());
    files.filter(|file| file.extension().is_some_and(|end| end == "tar")).collect()
}

fn wait(what: &str, until: impl Fn() -> bool) {
    let begun = Instant::now();
    while !until() {
        assert!(begun.elapsed() < PATIENCE, "not within {PATIENCE:?}: {what}");
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// Ends a script and what it started.
fn end(mut script: Child) {
    let group = format!("-{}", script.id());
    assert!(Command::new("kill").args(["-KILL", "--", &group]).status().expect("kill").success());
    script.wait().expect("it is gone");
}

#[test]
fn the_latest_backups_are_kept() {
    let container = Container::new();
    let words = |line: &str| line.split(' ').map(str::to_owned).collect::<Vec<_>>();
    container.succeeds(container.command(&words("avln challenge team add Ada")));
    let folder = container.path("backups");
    fs::create_dir(&folder).expect("a folder");
    let mut known = Vec::new();
    for _ in 0..3 {
        let mut script = container.command(&command_of("challenge-backup"));
        script.env("BACKUPS", &folder).env("KEEP", "2").process_group(0);
        let script = script.spawn().expect("it starts");
        wait("a backup is made", || backups(&folder).iter().any(|file| !known.contains(file)));
        known.extend(backups(&folder));
        known.sort();
        known.dedup();
        wait("what is too old goes", || backups(&folder).len() <= 2);
        // Names tell seconds.
        std::thread::sleep(Duration::from_secs(1));
        end(script);
    }
    assert_eq!(known.len(), 3, "{known:?}");
    let mut kept = backups(&folder);
    kept.sort();
    assert_eq!(kept, known[1..]);
    let restored = container.path("restored");
    let mut restore = container.command(&words("avln data db restore"));
    restore.arg(&kept[1]).env("AVLN_DATA", &restored);
    assert!(container.succeeds(restore).contains("1 teams"));
}
