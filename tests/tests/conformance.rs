//! The server passes the conformance kit, and the kit detects violations.

use avln_tests::{PHASE, TestServer, TestSetup};
use std::{
    io::{BufRead, BufReader, Read},
    process::{Command, Output, Stdio},
};

const PROGRAM: &str = env!("CARGO_BIN_EXE_avln_under_test");

async fn conformance(arguments: Vec<String>) -> Output {
    let run = move || {
        Command::new(PROGRAM).args(["lab", "conformance"]).args(arguments).output().expect("the program runs")
    };
    tokio::task::spawn_blocking(run).await.expect("no panic")
}

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

#[tokio::test(flavor = "multi_thread")]
async fn this_server_keeps_every_rule() {
    let server = TestServer::open(&TestSetup { houses: 1, missions: 12, ..TestSetup::default() }).await;
    let of = |words: [&str; 6]| words.map(str::to_owned).to_vec();
    let url = server.agents_url();
    let kept = conformance(of(["--server", &url, "--token", &server.token, "--phase", PHASE])).await;
    assert!(kept.status.success(), "{}", text(&kept));
    assert!(text(&kept).contains("12 rules checked, none broken"), "{}", text(&kept));
    let refused = conformance(of(["--server", &url, "--token", "nonsense", "--phase", PHASE])).await;
    assert_eq!(refused.status.code(), Some(6));
    assert!(text(&refused).contains("cannot start a run in phase 'trial'"), "{}", text(&refused));
    let web = format!("http://{}", server.servers.web);
    let nobody = conformance(of(["--server", &web, "--token", "x", "--phase", PHASE])).await;
    assert_eq!(nobody.status.code(), Some(6), "{}", text(&nobody));
}

/// Result of the kit's client test.
struct ClientTest {
    is_content: bool,
    output: String,
    agent: Output,
}

/// Runs the kit's client test of a case.
fn checked(case: &str, agent: &[&str]) -> ClientTest {
    let mut kit = Command::new(PROGRAM);
    kit.args(["lab", "conformance", "--client", "127.0.0.1:0", "--case", case]).stdout(Stdio::piped());
    let mut kit = kit.spawn().expect("the program runs");
    let mut reader = BufReader::new(kit.stdout.take().expect("its output"));
    let mut output = String::new();
    reader.read_line(&mut output).expect("an address");
    let url = output.split_whitespace().last().expect("an address");
    let mut play = Command::new(PROGRAM);
    play.arg("agent").args(agent).args(["--server", url, "--token", "any", "--phase", "any"]);
    let agent = play.output().expect("the program runs");
    reader.read_to_string(&mut output).expect("its checks");
    ClientTest { is_content: kit.wait().expect("it ends").success(), output, agent }
}

const RANDOM: [&str; 3] = ["random", "--seed", "3"];

#[test]
fn client_survives_every_kit_fault() {
    let ClientTest { is_content, output, agent } = checked("faults", &RANDOM);
    assert!(is_content && output.contains("15 rules checked, none broken"), "{output}");
    assert!(output.contains("not offered  two slots are resumed together"), "{output}");
    assert!(agent.status.success(), "{}", text(&agent));
}

#[test]
fn client_with_two_slots_survives_every_fault() {
    let two = ["baseline", "forward-and-turn", "--slots", "2"];
    let ClientTest { is_content, output, agent } = checked("faults", &two);
    assert!(is_content && output.contains("15 rules checked, none broken"), "{output}");
    assert!(output.contains("kept         two slots are resumed together"), "{output}");
    assert!(agent.status.success(), "{}", text(&agent));
}

#[test]
fn client_accepts_end_while_it_was_away() {
    let ClientTest { is_content, output, agent } = checked("ended", &RANDOM);
    assert!(is_content && output.contains("2 rules checked, none broken"), "{output}");
    assert!(agent.status.success(), "{}", text(&agent));
}

#[test]
fn superseded_client_stops_with_error() {
    let ClientTest { is_content, output, agent } = checked("superseded", &RANDOM);
    assert!(is_content && output.contains("2 rules checked, none broken"), "{output}");
    assert!(!agent.status.success() && text(&agent).contains("SUPERSEDED"), "{}", text(&agent));
}
