//! The server keeps its own protocol, as the conformance kit sees it, and the kit sees when one does not.

use avln_tests::{House, PHASE, Plan};
use std::{
    net::TcpListener,
    process::{Command, Output},
    time::Duration,
};

async fn conformance(arguments: Vec<String>) -> Output {
    let program = env!("CARGO_BIN_EXE_avln_under_test");
    let run =
        move || Command::new(program).arg("conformance").args(arguments).output().expect("the program runs");
    tokio::task::spawn_blocking(run).await.expect("no panic")
}

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

#[tokio::test(flavor = "multi_thread")]
async fn this_server_keeps_every_rule() {
    let house = House::open(&Plan { houses: 1, missions: 12, ..Plan::default() }).await;
    let of = |words: [&str; 6]| words.map(str::to_owned).to_vec();
    let url = house.agents_url();
    let kept = conformance(of(["--server", &url, "--token", &house.token, "--phase", PHASE])).await;
    assert!(kept.status.success(), "{}", text(&kept));
    assert!(text(&kept).contains("12 rules checked, none broken"), "{}", text(&kept));
    let refused = conformance(of(["--server", &url, "--token", "nonsense", "--phase", PHASE])).await;
    assert_eq!(refused.status.code(), Some(6));
    assert!(text(&refused).contains("begins no run in phase 'trial'"), "{}", text(&refused));
    let web = format!("http://{}", house.doors.web);
    let nobody = conformance(of(["--server", &web, "--token", "x", "--phase", PHASE])).await;
    assert_eq!(nobody.status.code(), Some(6), "{}", text(&nobody));
}

/// What the kit says of a client that is the program itself.
async fn checked(agent: &[&str]) -> Output {
    let free = TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr()).expect("a free port");
    let kit = tokio::spawn(conformance(vec!["--client".to_owned(), free.to_string()]));
    while tokio::net::TcpStream::connect(free).await.is_err() {
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    let url = format!("http://{free}");
    let mut play = Command::new(env!("CARGO_BIN_EXE_avln_under_test"));
    play.arg("agent").args(agent).args(["--server", &url, "--token", "any", "--phase", "any"]);
    let playing = tokio::task::spawn_blocking(move || play.output().expect("the program runs"));
    let kit = kit.await.expect("no panic");
    playing.await.expect("no panic");
    kit
}

#[tokio::test(flavor = "multi_thread")]
async fn the_client_lives_through_everything_that_may_go_wrong() {
    let kept = checked(&["random", "--seed", "3"]).await;
    assert!(kept.status.success(), "{}", text(&kept));
    assert!(text(&kept).contains("12 rules checked, none broken"), "{}", text(&kept));
}
