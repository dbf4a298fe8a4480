//! Damaged files: every file in `corpus/` is read unchanged, and with random changes, cuts and insertions.
//! Readers may reject or accept, but must not panic or use much memory.
//!
//! Files from past defects are in `corpus/` next to valid ones. `AVLN_MANGLE=100` multiplies the number of
//! tries by a hundred.

use avln_arena::{
    audio,
    challenge::{ChallengeFile, Fault},
    runlog::History,
};
use avln_geom::Rng;
use std::path::{Path, PathBuf};

/// Damaged copies per file.
const COPIES: usize = 400;
/// Limit of additional memory, MiB; corpus files are a thousand times smaller.
const MOST_MIB: u64 = 192;

/// Typical traps for readers.
const TRAPS: [&[u8]; 14] = [
    b"-1",
    b"nan",
    b"1e39",
    b"4294967295",
    b"18446744073709551615",
    b"-9223372036854775808",
    b"99999999999999999999",
    b"\"",
    b"[[",
    b"\n",
    b"\0\0\0\0",
    b"\xff\xff\xff\xff",
    b"\xff\xff\xff\x7f",
    b"\xc3\x28",
];

fn corpus(kind: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus").join(kind);
    let mut files: Vec<_> = std::fs::read_dir(&folder)
        .expect("the corpus")
        .map(|entry| entry.expect("an entry").path())
        .collect();
    files.sort();
    assert!(!files.is_empty(), "{} is empty", folder.display());
    files
}

/// Changes `bytes` at a position.
fn mangle(bytes: &mut Vec<u8>, rng: &mut Rng) {
    let at = rng.below(bytes.len() + 1);
    let end = (at + rng.below(24)).min(bytes.len());
    match rng.below(6) {
        0 => bytes.truncate(at),
        1 | 2 => {
            if let Some(byte) = bytes.get_mut(at) {
                *byte ^= 1 << rng.below(8);
            }
        }
        3 => {
            let trap = TRAPS[rng.below(TRAPS.len())];
            bytes.splice(at..(at + trap.len()).min(end.max(at)), trap.iter().copied());
        }
        4 => drop(bytes.drain(at..end)),
        _ => {
            let again = bytes[at..end].to_vec();
            bytes.splice(at..at, again);
        }
    }
}

/// Reads every file, unchanged and mangled.
fn try_all(kind: &str, seed: u64, mut read: impl FnMut(&Path, &[u8])) {
    let times = std::env::var("AVLN_MANGLE").map_or(1, |times| times.parse().expect("a number"));
    let mut rng = Rng::new(seed);
    let _memory = crate::MEMORY.blocking_write();
    forget_most();
    let before_mib = most_mib().unwrap_or_default();
    for file in corpus(kind) {
        let whole = std::fs::read(&file).expect("a file of the corpus");
        read(&file, &whole);
        for _ in 0..COPIES * times {
            let mut bytes = whole.clone();
            (0..=rng.below(4)).for_each(|_| mangle(&mut bytes, &mut rng));
            read(&file, &bytes);
        }
    }
    let most_mib = most_mib().unwrap_or_default().saturating_sub(before_mib);
    assert!(most_mib < MOST_MIB, "reading {kind} took {most_mib} MiB at most, {MOST_MIB} are allowed");
}

/// Resets the process's peak memory, if supported.
fn forget_most() {
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}

fn most_mib() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().trim_end_matches(" kB").parse::<u64>().ok().map(|kib| kib / 1024)
}

#[test]
fn challenge_files() {
    try_all("challenge", 1, |file, bytes| {
        let text = String::from_utf8_lossy(bytes);
        if let Err(faults) = ChallengeFile::parse(&text) {
            let said = Fault::explain_all(&faults, file, &text).to_string();
            assert!(said.contains("line "), "{said}");
        }
    });
}

#[test]
fn run_logs() {
    let follow = |bytes: &[u8]| {
        if let Ok(history) = History::parse(bytes) {
            let _ =
                (history.away(), history.episodes().map(|all| all.values().map(|one| one.crashes()).max()));
        }
    };
    try_all("logs", 2, |_, bytes| {
        follow(bytes);
        follow(&chained(bytes));
    });
}

/// Lines with valid hashes, as an attacker without the key can write them.
fn chained(bytes: &[u8]) -> Vec<u8> {
    let (mut head, mut text) = (String::new(), String::new());
    for line in String::from_utf8_lossy(bytes).lines() {
        let json = line.split_once(' ').map_or(line, |(_, json)| json);
        let mut hash = blake3::Hasher::new();
        hash.update(head.as_bytes()).update(b"\n").update(json.as_bytes());
        head = hash.finalize().to_hex()[..32].to_owned();
        text += &format!("{head} {json}\n");
    }
    text.into_bytes()
}

#[test]
fn scenes() {
    let folder = tempfile::tempdir().expect("a folder");
    try_all("scenes", 3, |file, bytes| {
        let copy = folder.path().join(file.file_name().expect("a name"));
        std::fs::write(&copy, bytes).expect("a copy");
        if let Ok(scene) = avln_formats::open::open(&copy) {
            let finite = scene.mesh.positions.iter().all(|place| place.coords.iter().all(|x| x.is_finite()));
            assert!(finite, "{} was read with places that are no numbers", copy.display());
        }
    });
}

#[test]
fn recordings() {
    let folder = tempfile::tempdir().expect("a folder");
    try_all("sounds", 4, |file, bytes| {
        std::fs::write(folder.path().join(file.file_name().expect("a name")), bytes).expect("a copy");
        let _ = audio::read_recordings(folder.path());
    });
}
