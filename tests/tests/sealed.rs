//! Sealed runs: the same score as over the network, and no access except to the server.
#![cfg(target_os = "linux")]

use avln_client::{Client, Metric, RunStatus};
use avln_tests::{PHASE, TEAM, TestServer, TestSetup, http, machine::excluded, set_up};
use std::{
    net::TcpListener,
    os::unix::fs::MetadataExt,
    path::Path,
    process::{Command, Output, Stdio},
};
use tempfile::TempDir;

const PROGRAM: &str = env!("CARGO_BIN_EXE_avln_under_test");

/// Runs `agent` sealed, with read access to its own program.
fn sealed(data: &Path, options: &[&str], agent: &[&str]) -> Output {
    sealed_by(Command::new(PROGRAM), data, options, agent)
}

/// Runs `agent` sealed by `command`, which starts the program.
fn sealed_by(mut command: Command, data: &Path, options: &[&str], agent: &[&str]) -> Output {
    let programs = Path::new(PROGRAM).parent().expect("a folder");
    for name in ["AVLN_LOG", "AVLN_LOG_FORMAT", "AVLN_SERVER", "AVLN_TOKEN"] {
        command.env_remove(name);
    }
    command
        .args([
            "challenge",
            "sealed",
            "run",
            "--phase",
            PHASE,
            "--team",
            TEAM,
            "--method",
            "sealed walker",
            "--read",
        ])
        .arg(programs)
        .args(options)
        .arg("--")
        .args(agent)
        .env("AVLN_DATA", data)
        .env("AVLN_PROBE_SECRET", "the organiser's")
        .stdin(Stdio::null())
        .output()
        .expect("the program starts")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

async fn status(server: &TestServer, method: &str) -> RunStatus {
    let client = Client::connect(server.agents_url(), &server.token).await.unwrap();
    client.runs().await.unwrap().into_iter().find(|run| run.method == method).expect("its run")
}

fn values(status: &RunStatus) -> Vec<(String, u64)> {
    let metric = |metric: &Metric| (metric.name.clone(), metric.value.to_bits());
    status.metrics.as_ref().expect("the phase shows them").iter().map(metric).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn sealed_run_scores_equal_remote_run() {
    let server = TestServer::open(&TestSetup::default()).await;
    let agent = [PROGRAM, "agent", "random", "--seed", "3", "--size", "64"];
    let dial_in = tokio::process::Command::new(PROGRAM)
        .args(&agent[1..])
        .args(["--server", &server.agents_url(), "--phase", PHASE])
        .env("AVLN_TOKEN", &server.token)
        .output()
        .await
        .unwrap();
    assert!(dial_in.status.success(), "{}", text(&dial_in.stderr));

    let (data, address) = (server.folder.path().to_owned(), server.servers.grpc.to_string());
    let run =
        tokio::task::spawn_blocking(move || sealed(&data, &["--server", &address], &agent)).await.unwrap();
    assert!(run.status.success(), "{}{}", text(&run.stdout), text(&run.stderr));

    let (outside, inside) = (status(&server, "random").await, status(&server, "sealed walker").await);
    assert_eq!(values(&outside), values(&inside));
    assert_eq!(outside.ends, inside.ends);
    let facts = |id: String| {
        let web = server.servers.web;
        async move { http::get(web, &format!("/api/v1/runs/{id}")).await.body }
    };
    assert!(facts(inside.id).await.contains("\"sealed\":\"process: "));
    assert!(!facts(outside.id).await.contains("\"sealed\""));
}

/// Probes and the mechanisms that block them; without any of these mechanisms, the probe is skipped.
const PROBES: [(&str, &[&str]); 11] = [
    ("web", &["no network", "files and TCP by Landlock", "system calls by seccomp, Unix sockets only"]),
    ("elsewhere", &["no network", "system calls by seccomp, Unix sockets only"]),
    ("root", &["read-only root", "files and TCP by Landlock"]),
    ("home", &["read-only root", "files and TCP by Landlock"]),
    ("data", &["data folder out of sight", "files and TCP by Landlock"]),
    ("organiser", &["own processes", "own processes only in /proc"]),
    ("mount", &["no capabilities", "system calls by seccomp, Unix sockets only"]),
    ("namespace", &["system calls by seccomp, Unix sockets only"]),
    ("trace", &["system calls by seccomp, Unix sockets only"]),
    ("socket", &["system calls by seccomp, Unix sockets only"]),
    ("secret", &["no new privileges"]),
];

/// A script that prints each successful probe.
fn script(web: u16, own_pid: u32, home: &Path, data: &Path) -> String {
    let (home, data) = (home.display(), data.display());
    let python = "/usr/bin/python3 -c";
    format!(
        "try() {{ name=$1; shift; if \"$@\" >/dev/null 2>&1; then echo \"probe $name open\"; else echo \"probe $name shut\"; fi; }}
         try web bash -c 'exec 3<>/dev/tcp/127.0.0.1/{web}'
         try elsewhere bash -c 'exec 3<>/dev/udp/192.0.2.1/9'
         try root bash -c 'echo x > /avln-probe'
         try home bash -c 'echo x > {home}/avln-probe'
         try data ls {data}/splits
         try organiser ls /proc/{own_pid}/
         try mount mount -t tmpfs none /mnt
         try namespace unshare -Ur true
         try trace {python} 'import ctypes, sys; sys.exit(ctypes.CDLL(None).ptrace(0, 0, 0, 0) != 0)'
         try socket {python} 'import socket; socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, 0)'
         try secret test -n \"$AVLN_PROBE_SECRET\"
         try scratch bash -c 'echo x > $TMPDIR/file'
         try server test -S ${{AVLN_SERVER#unix:}}
         try token test -n \"$AVLN_TOKEN\""
    )
}

fn got_through(output: &str, probe: &str) -> bool {
    assert!(output.contains(&format!("probe {probe} ")), "no word of {probe}: {output}");
    output.contains(&format!("probe {probe} open"))
}

#[tokio::test(flavor = "multi_thread")]
async fn nothing_is_reached_from_inside_but_the_server() {
    let (folder, home) = (TempDir::new().unwrap(), TempDir::new().unwrap());
    let data = folder.path().join("data");
    set_up(&data, &TestSetup::default()).await;
    let web = TcpListener::bind("127.0.0.1:0").unwrap();
    let probe = script(web.local_addr().unwrap().port(), std::process::id(), home.path(), &data);

    let open = Command::new("bash").args(["-c", &probe]).env("AVLN_PROBE_SECRET", "x").output().unwrap();
    let open = text(&open.stdout);
    for name in ["web", "elsewhere", "home", "data", "organiser", "socket", "secret"] {
        assert!(got_through(&open, name), "the probe '{name}' cannot fail: {open}");
    }
    let _ = std::fs::remove_file("/avln-probe");

    // The data folder stays hidden even with read permission.
    let readable = folder.path().display().to_string();
    let output = tokio::task::spawn_blocking({
        let data = data.clone();
        move || sealed(&data, &["--read", &readable], &["bash", "-c", &probe])
    });
    let output = output.await.unwrap();
    let (out, err) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(6), "it played nothing: {out}{err}");
    assert!(err.contains("the agent left after 0 of 2 episodes"), "{err}");
    let held = |what: &&str| !err.contains(&format!("not enforced: {what}:"));
    for (name, by) in PROBES {
        if by.iter().any(held) {
            assert!(!got_through(&out, name), "'{name}' got through: {out}{err}");
        } else {
            excluded(&format!("the probe '{name}'"), &format!("this system has none of {by:?}"));
        }
    }
    for name in ["scratch", "server", "token"] {
        assert!(
            got_through(&out, name) || !held(&"scratch folder of 1 GiB in memory"),
            "'{name}': {out}{err}"
        );
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn idle_runs_end_with_a_reason() {
    let folder = TempDir::new().unwrap();
    set_up(folder.path(), &TestSetup::default()).await;
    let data = folder.path().to_owned();
    let hidden = data.join("agent");
    std::fs::copy("/bin/true", &hidden).unwrap();
    let refused = move |options: &[&str], agent: &[&str], words: &str| {
        let output = sealed(&data, options, agent);
        let (out, err) = (text(&output.stdout), text(&output.stderr));
        assert!(matches!(output.status.code(), Some(3 | 6)), "{out}{err}");
        assert!(err.contains(words) && !err.contains("panicked"), "'{words}' in: {err}");
    };
    let all = move || {
        refused(&["--wall-s", "1"], &["sleep", "60"], "stopped after 1 s");
        refused(&[], &["no-such-agent"], "cannot start the agent 'no-such-agent'");
        refused(&[], &[&hidden.display().to_string()], "cannot start the agent");
        refused(&[], &["sh", "-c", "exit 9"], "exit status: 9");
        refused(&["--server", "127.0.0.1:9"], &["true"], "127.0.0.1:9");
    };
    tokio::task::spawn_blocking(all).await.unwrap();
    let store = avln_arena::data::DataFolder::open(folder.path()).unwrap().store().await.unwrap();
    let runs = store.runs_of(TEAM).await.unwrap();
    assert!(runs.len() == 2 && runs.iter().all(|run| !run.state.is_open() && run.is_sealed()), "{runs:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn agents_inherit_no_open_files() {
    let folder = TempDir::new().unwrap();
    set_up(folder.path(), &TestSetup::default()).await;
    let data = folder.path().to_owned();
    // The caller of the command has opened the database.
    let caller = |data: &Path| {
        let mut caller = Command::new("bash");
        caller.args(["-c", r#"exec 9<"$0/avln.db"; exec "$@""#]).arg(data);
        caller
    };
    let probe = "if test -L /proc/self/fd/9; then echo probe file open; else echo probe file shut; fi";
    let open = caller(&data).args(["sh", "-c", probe]).output().unwrap();
    assert!(got_through(&text(&open.stdout), "file"), "the probe cannot fail");
    let run = move || {
        let mut command = caller(&data);
        command.arg(PROGRAM);
        sealed_by(command, &data, &[], &["sh", "-c", probe])
    };
    let output = tokio::task::spawn_blocking(run).await.unwrap();
    let (out, err) = (text(&output.stdout), text(&output.stderr));
    assert!(!got_through(&out, "file") && out.contains("no inherited files"), "{out}{err}");
}

#[tokio::test(flavor = "multi_thread")]
async fn reported_limits_bind_the_agent() {
    let folder = TempDir::new().unwrap();
    set_up(folder.path(), &TestSetup::default()).await;
    let data = folder.path().to_owned();
    let all = move || {
        let run = |options: &[&str]| {
            let output = sealed(&data, options, &["sh", "-c", "echo memory $(ulimit -v)"]);
            assert_eq!(output.status.code(), Some(6), "{output:?}");
            (text(&output.stdout), text(&output.stderr))
        };
        let (out, err) = run(&["--memory-mib", "4096"]);
        let limit = "memory limit of 4096 MiB per process";
        assert!(out.contains("memory 4194304"), "{out}{err}");
        assert!(out.contains(limit) || err.contains(limit), "{out}{err}");
        let (out, err) = run(&[]);
        assert!(out.contains("memory unlimited") && !out.contains("memory limit"), "{out}{err}");
        let missing = "the kernel does not bind root";
        let is_root = std::fs::metadata("/proc/self").unwrap().uid() == 0;
        assert!(is_root || !err.contains(missing), "{err}");
        assert_ne!(out.contains("at most "), err.contains("not enforced: at most "), "{out}{err}");
        if err.contains(missing) {
            let (out, err) = run(&["--require-all"]);
            assert!(err.contains("cannot enforce everything") && !out.contains("run "), "{out}{err}");
        }
    };
    tokio::task::spawn_blocking(all).await.unwrap();
}

/// Tries to raise the priority in every way, then prints the result.
const RAISE: &str =
    "try() { if \"$@\" >/dev/null 2>&1; then echo \"probe $1 open\"; else echo \"probe $1 shut\"; fi; }
    try setsid true
    renice -n 0 -p $$
    chrt -o -p 0 $$
    echo 0 > /proc/self/oom_score_adj
    echo 0 > /proc/self/autogroup
    read -r score < /proc/self/oom_score_adj
    read -r session < /proc/self/autogroup
    read -r stat < /proc/self/stat
    set -- $stat
    echo \"left nice ${19} policy ${41}; score $score; $session\"";

#[tokio::test(flavor = "multi_thread")]
async fn agents_keep_the_lowest_priority() {
    let folder = TempDir::new().unwrap();
    set_up(folder.path(), &TestSetup::default()).await;
    assert!(Command::new("setsid").arg("true").status().unwrap().success(), "the probe cannot fail");
    let data = folder.path().to_owned();
    let run = move || sealed(&data, &[], &["sh", "-c", RAISE]);
    let output = tokio::task::spawn_blocking(run).await.unwrap();
    let (out, err) = (text(&output.stdout), text(&output.stderr));
    let left = out.lines().find(|line| line.starts_with("left ")).expect("the script's end");
    let is_last =
        left.contains("nice 19 policy 5") && (!left.contains("/autogroup") || left.ends_with("nice 19"));
    for (what, holds) in [
        ("lowest processor priority", is_last),
        ("first to be killed", left.contains("score 1000")),
        ("system calls by seccomp", !got_through(&out, "setsid")),
    ] {
        if out.contains(what) {
            assert!(holds, "{what}: {out}{err}");
        } else {
            excluded(&format!("the limit '{what}'"), "it is not enforced on this system");
        }
    }
}

/// Memory that programs can still take, as Linux reports it.
fn available_mib() -> u64 {
    let report = std::fs::read_to_string("/proc/meminfo").expect("a report");
    let line = report.lines().find_map(|line| line.strip_prefix("MemAvailable:")).expect("its line");
    let kib: u64 = line.trim().trim_end_matches(" kB").parse().expect("a number");
    kib / 1024
}

#[tokio::test(flavor = "multi_thread")]
async fn low_memory_ends_sealed_runs() {
    let folder = TempDir::new().unwrap();
    set_up(folder.path(), &TestSetup::default()).await;
    let data = folder.path().to_owned();
    let all = move || {
        let ended = |reserve_mib: u64, agent: &[&str]| {
            let output =
                sealed(&data, &["--wall-s", "600", "--reserve-mib", &reserve_mib.to_string()], agent);
            let (out, err) = (text(&output.stdout), text(&output.stderr));
            let reason = format!("this machine has less than {reserve_mib} MiB of available memory");
            assert!(!output.status.success() && err.contains(&reason), "'{reason}' in: {out}{err}");
        };
        ended(1 << 40, &["true"]);
        let available_mib = available_mib();
        // Without a line's end, it keeps all bytes in memory.
        ended(available_mib.saturating_sub(256).max(1), &["tail", "-n", "1", "/dev/zero"]);
    };
    tokio::task::spawn_blocking(all).await.unwrap();
    let store = avln_arena::data::DataFolder::open(folder.path()).unwrap().store().await.unwrap();
    let runs = store.runs_of(TEAM).await.unwrap();
    assert!(runs.iter().all(|run| !run.state.is_open()), "{runs:?}");
}
