//! A frozen copy of the board can be trusted: whatever was done to it is found.

use avln_tests::{Plan, furnish};
use std::{fs, path::Path, process::Command};

const PROGRAM: &str = env!("CARGO_BIN_EXE_avln_under_test");

/// Whether the program is content, and what it says.
fn avln(data: &Path, arguments: &[&str]) -> (bool, String) {
    let output = Command::new(PROGRAM).arg("--data").arg(data).args(arguments).output().expect("it runs");
    let told = [output.stdout, output.stderr].concat();
    (output.status.success(), String::from_utf8_lossy(&told).into_owned())
}

/// Changes a copy, asks what is wrong, and changes it back.
fn found(copy: &Path, key: &str, file: &str, text: Option<&str>) -> String {
    let path = copy.join(file);
    let before = fs::read(&path).ok();
    match text {
        Some(text) => fs::write(&path, text).expect("a file"),
        None => fs::remove_file(&path).expect("a file"),
    }
    let (content, told) =
        avln(copy, &["challenge", "leaderboard", "check", &copy.display().to_string(), "--key", key]);
    assert!(!content, "{told}");
    match before {
        Some(bytes) => fs::write(&path, bytes).expect("a file"),
        None => fs::remove_file(&path).expect("a file"),
    }
    told
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_done_to_a_copy_is_found() {
    let (data, elsewhere) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    furnish(data.path(), &Plan { houses: 1, missions: 1, ..Plan::default() }).await;
    let copy = elsewhere.path().join("frozen");
    let place = copy.display().to_string();
    let (content, told) = avln(data.path(), &["challenge", "leaderboard", "freeze", "--out", &place]);
    assert!(content, "{told}");
    let key = told.lines().find_map(|line| line.strip_prefix("signed by    ")).expect("a key").to_owned();

    // The copy is checked where there is no data folder.
    let check = |more: &[&str]| {
        avln(elsewhere.path(), &[&["challenge", "leaderboard", "check", place.as_str()], more].concat())
    };
    let (content, told) = check(&["--key", &key]);
    assert!(content && told.contains(", as expected"), "{told}");
    let (content, told) = check(&[]);
    assert!(content && told.contains(&key), "{told}");
    let (content, told) = check(&["--key", "0123"]);
    assert!(!content && told.contains("not by 0123"), "{told}");

    let list = fs::read_to_string(copy.join("SHA256SUMS")).expect("a list");
    assert!(found(&copy, &key, "index.html", Some("<p>We won.")).contains("index.html was changed"));
    assert!(found(&copy, &key, "index.html", None).contains("cannot read"));
    assert!(found(&copy, &key, "more.html", Some("We won.")).contains("more.html is not in SHA256SUMS"));
    let forged = list.replacen(&list[..8], "01234567", 1);
    assert!(found(&copy, &key, "SHA256SUMS", Some(&forged)).contains("does not fit SHA256SUMS"));
    assert!(found(&copy, &key, "SHA256SUMS.sig", Some(&key)).contains("does not fit SHA256SUMS"));
    let link = copy.join("link");
    std::os::unix::fs::symlink("/", &link).expect("a link");
    let (content, told) = check(&["--key", &key]);
    assert!(!content && told.contains("link is not in SHA256SUMS"), "{told}");
    fs::remove_file(link).expect("a link");
    assert!(check(&["--key", &key]).0, "all is as it was");
}
