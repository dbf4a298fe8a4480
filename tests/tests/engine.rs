//! The compose profiles on a container engine: images with the compiled program, runs, a killed server, escape attempts.
//!
//! `AVLN_DOCKER` names the `docker` program, if it is not the one on the path. Project, volumes, images and ports of the tests are
//! their own.

use avln_tests::machine::{self, excluded, root, skipped, text};
use std::{
    fs,
    net::{Ipv4Addr, TcpListener},
    path::{Path, PathBuf},
    process::{Command, Output, Stdio},
    sync::{Mutex, PoisonError},
    thread::sleep,
    time::{Duration, Instant},
};
use tempfile::TempDir;

const PROJECT: &str = "avln-test";
const DATA: &str = "avln-test-data";
const BACKUPS: &str = "avln-test-backups";
const PROBE: &str = "avln-test-probe";
/// A network with an address of this machine, as engines before Docker 28 create it, and with another size than by default.
const NOT_ISOLATED: &str = "networks: { sealed: { ipam: { config: [{ subnet: 10.213.7.64/26 }] }, driver_opts: {
    com.docker.network.bridge.gateway_mode_ipv4: nat, com.docker.network.bridge.gateway_mode_ipv6: nat } } }\n";
/// Longest wait for a condition.
const PATIENCE: Duration = Duration::from_secs(180);
/// Separates the tests, which share project and images.
static ALONE: Mutex<()> = Mutex::new(());

/// Attempts to leave the sealed network or the container, one line per attempt. The argument is the first address of the network.
const PROBE_SCRIPT: &str = r#"#!/bin/bash
reach() {
    error=$(timeout 3 bash -c ": </dev/tcp/$1/$2" 2>&1) && echo "$3: open" && return
    case "$error" in *refused*) echo "$3: refused" ;; *) echo "$3: unreachable" ;; esac
}
reach sealed-server 50051 "gRPC server"
reach sealed-server 8080 "web server"
reach sealed-server 50052 "admin server"
first=$1
if [ "$first" = "$(hostname -i)" ] || [ "$first" = "$(getent hosts sealed-server | cut -d' ' -f1)" ]; then
    echo "host: no address"
else
    reach "$first" 22 "host"
fi
reach 192.0.2.1 80 "Internet"
getent hosts deb.debian.org >/dev/null && echo "names: known" || echo "names: unknown"
touch /x 2>/dev/null && echo "root: writable" || echo "root: read-only"
cp /bin/true /tmp/t && /tmp/t && echo "/tmp: executable"
unshare --user true 2>/dev/null && echo "namespaces: allowed" || echo "namespaces: refused"
mount -t tmpfs none /mnt 2>/dev/null && echo "mounts: allowed" || echo "mounts: refused"
[ -e /data ] && ls /data 2>/dev/null | sed 's/^/data: /'
grep -E '^Cap(Eff|Bnd)' /proc/self/status | tr -d '\t' | sed 's/00*$/0/'
exit 7
"#;

/// Output of the attempts in a sealed container.
const CONFINED: [&str; 11] = [
    "gRPC server: open",
    "web server: refused",
    "admin server: refused",
    "Internet: unreachable",
    "names: unknown",
    "root: read-only",
    "/tmp: executable",
    "namespaces: refused",
    "mounts: refused",
    "CapEff:0",
    "CapBnd:0",
];

/// A copy of the container files, with the program as the result of the compile stage.
struct Engine {
    folder: TempDir,
    grpc_port: u16,
    web_port: u16,
}

impl Engine {
    /// Builds the images; `None` without an engine.
    fn start(test: &str) -> Option<Self> {
        let remedy = "install Docker with Compose 2, or name the program in AVLN_DOCKER";
        let Some(mut engine) = machine::docker() else {
            excluded(test, remedy);
            return None;
        };
        let answers = engine.arg("info").stdout(Stdio::null()).stderr(Stdio::null()).status();
        if !answers.is_ok_and(|status| status.success()) {
            skipped(test, remedy);
            return None;
        }
        // Not in the system's folder for temporary files, which an engine in another mount namespace does not see.
        let folder = TempDir::new_in(env!("CARGO_TARGET_TMPDIR")).expect("a folder");
        let port = || {
            let free = TcpListener::bind("127.0.0.1:0").expect("a free port");
            free.local_addr().expect("an address").port()
        };
        let engine = Self { grpc_port: port(), web_port: port(), folder };
        engine.copy_files();
        engine.remove_all();
        engine.compose("trial", &["build"]);
        engine.docker(&["volume", "create", DATA]);
        engine.docker(&["volume", "create", BACKUPS]);
        Some(engine)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn copy_files(&self) {
        for folder in ["docker/secrets", "docker/challenge", "built/built", "built/etc/ssl/certs", "probe"] {
            fs::create_dir_all(self.path(folder)).expect("a folder");
        }
        let files = fs::read_dir(root().join("docker")).expect("a folder").flatten();
        for file in files.filter(|file| file.path().is_file()) {
            fs::copy(file.path(), self.path("docker").join(file.file_name())).expect("a copy");
        }
        fs::copy(root().join(".env"), self.path(".env")).expect("a copy");
        fs::copy(env!("CARGO_BIN_EXE_avln_under_test"), self.path("built/built/avln")).expect("a copy");
        fs::write(self.path("built/etc/ssl/certs/ca-certificates.crt"), "").expect("a file");
        fs::write(self.path("docker/challenge/challenge.toml"), text("docs/challenge.toml")).expect("a file");
        fs::write(self.path("docker/secrets/seal.key"), "a passphrase of the container tests")
            .expect("a file");
        fs::write(self.path("probe/probe.sh"), PROBE_SCRIPT).expect("a file");
        let from = "FROM avln-agents:test\nCOPY --chmod=755 probe.sh /probe.sh\n";
        fs::write(self.path("probe/Dockerfile"), from).expect("a file");
        let stage = format!(
            "{{ build: {{ additional_contexts: {{ build: '{}' }} }} }}",
            self.path("built").display()
        );
        let services = ["trial-setup", "trial-random", "challenge-server", "sealed-server"];
        let services = services.map(|service| format!("  {service}: {stage}\n")).concat();
        fs::write(self.path("stage.yaml"), format!("services:\n{services}")).expect("a file");
        fs::write(self.path("agent.yaml"), "services: {}\n").expect("a file");
    }

    /// Runs Compose for a profile; fails the test with the output.
    fn compose(&self, profile: &str, words: &[&str]) -> String {
        let output = self.try_compose(profile, words);
        assert!(output.status.success(), "{profile} {words:?}: {}", said(&output));
        said(&output)
    }

    fn try_compose(&self, profile: &str, words: &[&str]) -> Output {
        let ports =
            [format!("AVLN_GRPC_PORT={}", self.grpc_port), format!("AVLN_WEB_PORT={}", self.web_port)];
        let variables = [
            format!("AVLN_DATA_VOLUME={DATA}"),
            format!("AVLN_BACKUP_VOLUME={BACKUPS}"),
            "AVLN_TAG=test".to_owned(),
            "AVLN_MEMORY=2g".to_owned(),
        ];
        let mut command = docker();
        // The wrapper of an engine in another namespace passes no variables: an env file does.
        let file = self.path("test.env");
        fs::write(&file, variables.into_iter().chain(ports).collect::<Vec<_>>().join("\n")).expect("a file");
        command.args(["compose", "--env-file"]).arg(file);
        for part in ["docker/compose.yaml", "stage.yaml", "agent.yaml"] {
            command.arg("--file").arg(self.path(part));
        }
        command.args(["--project-name", PROJECT, "--profile", profile]).args(words);
        command.output().expect("docker starts")
    }

    fn docker(&self, words: &[&str]) -> String {
        let output = docker().args(words).output().expect("docker starts");
        assert!(output.status.success(), "{words:?}: {}", said(&output));
        String::from_utf8_lossy(&output.stdout).trim().to_owned()
    }

    /// Removes containers and volumes of an earlier test.
    fn remove_all(&self) {
        for profile in ["trial", "challenge", "sealed"] {
            self.try_compose(profile, &["down", "--volumes", "--timeout", "5"]);
        }
        let _ = docker().args(["volume", "rm", "--force", DATA, BACKUPS]).output();
    }

    /// Runs a sealed agent; returns exit code and output.
    fn seal(&self, image: &str, command: &str, token: &str) -> (Option<i32>, String) {
        self.seal_with(image, command, token, "")
    }

    /// Runs a sealed agent with additional lines of the Compose file.
    fn seal_with(&self, image: &str, command: &str, token: &str, lines: &str) -> (Option<i32>, String) {
        let agent =
            format!("{{ image: '{image}', command: '{command}', environment: {{ AVLN_TOKEN: '{token}' }} }}");
        fs::write(self.path("agent.yaml"), format!("services: {{ sealed-agent: {agent} }}\n{lines}"))
            .expect("a file");
        let output = self.try_compose("sealed", &["up", "--no-color", "--exit-code-from", "sealed-agent"]);
        (output.status.code(), said(&output))
    }

    /// Returns the first address of the sealed network.
    fn sealed_address(&self) -> Ipv4Addr {
        fs::write(self.path("agent.yaml"), "services: {}\n").expect("a file");
        self.compose("sealed", &["create", "sealed-server"]);
        let format = "{{(index .IPAM.Config 0).Subnet}}";
        let subnet = self.docker(&["network", "inspect", "--format", format, &format!("{PROJECT}_sealed")]);
        let network: Ipv4Addr = subnet.split('/').next().and_then(|at| at.parse().ok()).expect("a subnet");
        (u32::from(network) + 1).into()
    }

    /// Returns whether the engine can isolate a network from the host.
    fn isolates(&self) -> bool {
        let version = self.docker(&["version", "--format", "{{.Server.Version}}"]);
        version.split('.').next().and_then(|major| major.parse().ok()).is_some_and(|major: u32| major >= 28)
    }

    fn inspect(&self, service: &str, field: &str) -> String {
        self.docker(&["inspect", "--format", field, &format!("{PROJECT}-{service}-1")])
    }

    fn wait_for_exit(&self, service: &str) -> String {
        wait(&format!("{service} ends"), || self.inspect(service, "{{.State.Status}}") == "exited");
        self.inspect(service, "{{.State.ExitCode}}")
    }

    /// Returns the response of a published port.
    fn page(&self, path: &str) -> String {
        let request = format!(
            "exec 3<>/dev/tcp/127.0.0.1/{}; printf 'GET {path} HTTP/1.1\\r\\nHost: localhost\\r\\nConnection: close\\r\\n\\r\\n' >&3; cat <&3",
            self.web_port
        );
        self.docker(&["run", "--rm", "--network", "host", "avln-server:test", "bash", "-c", &request])
    }
}

impl Drop for Engine {
    fn drop(&mut self) {
        self.remove_all();
    }
}

fn docker() -> Command {
    machine::docker().expect("an engine")
}

fn said(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

fn wait(condition: &str, is_true: impl Fn() -> bool) {
    let begun = Instant::now();
    while !is_true() {
        assert!(begun.elapsed() < PATIENCE, "not within {PATIENCE:?}: {condition}");
        sleep(Duration::from_millis(500));
    }
}

/// Creates a certificate with the documented command, for the name of the server's container.
fn write_certificate(folder: &Path) {
    let mut openssl = Command::new("openssl");
    openssl.args([
        "req",
        "-x509",
        "-newkey",
        "rsa:2048",
        "-nodes",
        "-days",
        "30",
        "-subj",
        "/CN=challenge-server",
    ]);
    openssl.args(["-addext", "basicConstraints=critical,CA:FALSE"]);
    openssl.args([
        "-addext",
        "subjectAltName=DNS:challenge-server",
        "-keyout",
        "tls-key.pem",
        "-out",
        "tls-cert.pem",
    ]);
    let output = openssl.current_dir(folder).output().expect("openssl is installed");
    assert!(output.status.success(), "{}", said(&output));
    // Readable for the user of the containers.
    for name in ["tls-key.pem", "tls-cert.pem", "seal.key"] {
        let path = folder.join(name);
        let mode = std::os::unix::fs::PermissionsExt::from_mode(0o644);
        fs::set_permissions(&path, mode).expect("our file");
    }
}

/// Prepares splits, phases and a team; returns the team's token.
fn prepare_challenge(engine: &Engine) -> String {
    let run = |words: &[&str]| {
        let words = [&["run", "--rm", "--no-deps", "challenge-server", "avln"], words].concat();
        engine.compose("challenge", &words)
    };
    run(&["data", "split", "make", "val", "--houses", "1", "--missions", "4", "--seed", "7"]);
    run(&["data", "split", "make", "hidden", "--houses", "2", "--missions", "2"]);
    run(&["data", "split", "seal", "hidden"]);
    run(&["challenge", "apply", "/challenge/challenge.toml", "--reason", "test"]);
    let team = run(&["challenge", "team", "add", "Ada"]);
    run(&["challenge", "team", "approve", "Ada", "--phase", "challenge"]);
    let token =
        team.lines().find_map(|line| line.split_whitespace().find(|word| word.starts_with("avln_account_")));
    token.unwrap_or_else(|| panic!("no token in {team}")).to_owned()
}

/// Gives a volume to another user; the error of a command contains the command that gives it back.
fn check_foreign_volume(engine: &Engine, volume: &str, command: &[&str], message: &str) {
    let own = |user: &str| {
        let volume = format!("{volume}:/data");
        engine.docker(&[
            "run",
            "--rm",
            "--user",
            "0",
            "--volume",
            &volume,
            "avln-server:test",
            "chown",
            "-R",
            user,
            "/data",
        ])
    };
    own("0");
    let command = [&["run", "--rm", "--no-deps"], command].concat();
    let refused = said(&engine.try_compose("challenge", &command));
    assert!(refused.contains(message) && refused.contains("chown -R 10001 /data"), "{refused}");
    own("10001");
}

fn check_foreign_volumes(engine: &Engine) {
    let add = ["challenge-server", "avln", "challenge", "team", "add", "Bea"];
    check_foreign_volume(engine, DATA, &add, "cannot write to data folder /data");
    let back_up = ["challenge-backup", "avln", "data", "db", "backup", "/backups/new.tar"];
    check_foreign_volume(engine, BACKUPS, &back_up, "cannot write /backups/new.tar");
    let restore = "challenge-server avln data db restore /backups/old.tar --data /data/restored";
    let restore: Vec<_> = restore.split(' ').collect();
    check_foreign_volume(engine, DATA, &restore, "cannot restore to /data/restored");
}

#[test]
fn trial_survives_killed_server() {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let Some(engine) = Engine::start("trial_survives_killed_server") else { return };
    engine.compose("trial", &["up", "--build", "--detach"]);
    let started = |service: &str| engine.inspect(service, "{{.State.StartedAt}}");
    let before = ["trial-server", "trial-random", "trial-pag-nav"].map(started);
    engine.compose("trial", &["up", "--build", "--detach"]);
    assert_eq!(
        ["trial-server", "trial-random", "trial-pag-nav"].map(started),
        before,
        "a second up restarts nothing"
    );

    let limits = engine.inspect("trial-pag-nav", "{{.HostConfig.Memory}} {{.HostConfig.LogConfig.Config}}");
    assert_eq!(limits, format!("{} map[max-file:3 max-size:10m]", 2_u64 << 30));

    let runs = || engine.page("/api/v1/runs.csv");
    wait("an episode ends while both runs are open", || {
        let runs = runs();
        let one_ended = (1..6).any(|ended| runs.contains(&format!(",running,6,{ended},")));
        one_ended && runs.matches(",running,6,").count() == 2
    });
    let kill = "for p in /proc/[0-9]*; do [ \"$(cat $p/comm 2>/dev/null)\" = avln ] && kill -9 ${p#/proc/}; done; true";
    engine.compose("trial", &["exec", "--no-TTY", "trial-server", "bash", "-c", kill]);
    for agent in ["trial-random", "trial-pag-nav"] {
        assert_eq!(
            engine.wait_for_exit(agent),
            "0",
            "{agent}: {}",
            engine.compose("trial", &["logs", agent])
        );
    }
    assert_ne!(started("trial-server"), before[0], "the server was killed");
    let logs = engine.compose("trial", &["logs", "trial-random", "trial-pag-nav"]);
    assert_eq!(logs.matches("6 of 6 episodes, complete").count(), 2, "{logs}");
    let runs = runs();
    let count = runs.lines().filter(|line| line.starts_with("run_")).count();
    assert_eq!(count, 2, "runs continue instead of starting again: {runs}");
    let link = format!("http://127.0.0.1:{}/runs/run_", engine.web_port);
    assert!(logs.contains(&link), "{logs}");
    let server = engine.compose("trial", &["logs", "--no-color", "trial-server"]);
    assert!(!server.contains('\u{1b}'), "colours without a terminal: {server}");
    let page = engine.page("/leaderboard/practice?order=ordered");
    assert!(page.contains("PAG-Nav"), "{page}");

    let second = ["run", "--rm", "--no-deps", "trial-server", "avln", "serve"];
    let refused = said(&engine.try_compose("trial", &second));
    assert!(refused.contains("a server is already running on data folder /data"), "{refused}");
}

#[test]
fn challenge_and_sealed_agent_play() {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let Some(engine) = Engine::start("challenge_and_sealed_agent_play") else { return };
    write_certificate(&engine.path("docker/secrets"));
    let token = prepare_challenge(&engine);
    engine.compose("challenge", &["up", "--detach"]);
    let network = format!("{PROJECT}_default");
    let certificate = format!("{}:/ca.pem:ro", engine.path("docker/secrets/tls-cert.pem").display());
    let played = engine.docker(&[
        "run",
        "--rm",
        "--network",
        &network,
        "--volume",
        &certificate,
        "avln-agents:test",
        "avln",
        "agent",
        "random",
        "--server",
        "https://challenge-server:50051",
        "--ca",
        "/ca.pem",
        "--token",
        &token,
        "--phase",
        "practice",
    ]);
    assert!(played.contains("4 of 4 episodes, complete"), "{played}");
    let backups = || {
        engine.docker(&[
            "run",
            "--rm",
            "--volume",
            &format!("{BACKUPS}:/backups"),
            "avln-server:test",
            "ls",
            "/backups",
        ])
    };
    wait("a backup is written", || backups().contains(".tar"));
    engine.compose("challenge", &["down", "--volumes"]);
    assert!(backups().contains(".tar"), "backups survive `down --volumes`");
    check_foreign_volumes(&engine);
    engine.docker(&["build", "--tag", PROBE, &engine.path("probe").display().to_string()]);
    let refuses = |lines: &str| {
        let (code, refused) = engine.seal_with(PROBE, "/probe.sh 192.0.2.1", &token, lines);
        assert!(code != Some(0) && refused.contains("requires Docker 28 or later"), "{refused}");
        assert!(!refused.contains("gRPC server: open"), "no agent starts: {refused}");
    };
    refuses(NOT_ISOLATED);
    engine.compose("sealed", &["down"]);
    if !engine.isolates() {
        refuses("");
        excluded("escape attempts and a sealed run", "use Docker 28 or later");
        return;
    }
    let (code, probed) = engine.seal(PROBE, &format!("/probe.sh {}", engine.sealed_address()), &token);
    assert_eq!(code, Some(7), "the exit code of the agent: {probed}");
    for line in CONFINED {
        assert!(probed.contains(line), "{line}: {probed}");
    }
    assert!(probed.contains("host: unreachable") || probed.contains("host: no address"), "{probed}");
    assert!(!probed.contains("data: "), "{probed}");
    let (code, played) = engine.seal("avln-agents:test", "avln agent random --phase challenge", &token);
    assert!(code == Some(0) && played.contains("4 of 4 episodes, complete"), "{played}");
}
