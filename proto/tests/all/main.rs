//! Protocol tests: messages and encodings as bytes; agreement of PROTOCOL.md with the .proto files, which follow conventions.

mod codec;

use avln_proto::{
    API_MINOR, FILE_DESCRIPTOR_SET,
    v1::{self, Reason, play_request, play_response},
};
use bytes::{BufMut, Bytes, BytesMut};
use prost::Message;
use std::{fs, path::Path};

const MARK: &str = "which a test compares:\n`";

/// First words of a client's action after a refusal.
const REACTIONS: [&str; 5] = ["wait", "resume", "correct", "`Ready`", "stop"];

fn act() -> v1::Act {
    v1::Act { slot: 1, episode: "e".into(), step: 2, action: v1::Action::TurnLeft as i32 }
}

#[test]
fn an_act_has_the_expected_bytes() {
    let frame = v1::PlayRequest { frame: Some(play_request::Frame::Act(act())) };
    // Field 3, length 9: slot = 1, episode = "e", step = 2, action = 2.
    let by_hand = [0x1A, 9, 0x08, 1, 0x12, 1, b'e', 0x18, 2, 0x20, 2];
    assert_eq!(frame.encode_to_vec(), by_hand);
    assert_eq!(v1::PlayRequest::decode(&by_hand[..]), Ok(frame));
}

#[test]
fn observations_are_decoded_without_copying_pictures() {
    let data = Bytes::from(vec![7_u8; 4096]);
    let tensor = v1::Tensor {
        id: 1,
        dtype: v1::Dtype::U8 as i32,
        shape: vec![64, 64],
        encoding: v1::Encoding::Raw as i32,
        data,
    };
    let seen = v1::Observation {
        slot: 3,
        episode: "ep".into(),
        step: 9,
        tensors: vec![tensor],
        pose: Some(v1::Pose { x_m: 1.0, y_m: -0.0, z_m: f32::MIN_POSITIVE, heading_rad: -3.0 }),
        feedback: v1::SubmitFeedback::Wrong as i32,
        truncated: true,
        reason: v1::EndReason::TimeBudget as i32,
        time: Some(v1::TimeAccount { step_ms: 5000, bank_ms: 0 }),
        ..v1::Observation::default()
    };
    let frame = v1::PlayResponse { frame: Some(play_response::Frame::Observation(seen)) };
    let bytes = Bytes::from(frame.encode_to_vec());
    let back = v1::PlayResponse::decode(bytes.clone()).unwrap();
    assert_eq!(back, frame);
    let Some(play_response::Frame::Observation(seen)) = back.frame else { panic!("another frame") };
    let inside = bytes.as_ptr_range();
    assert!(inside.contains(&seen.tensors[0].data.as_ptr()));
}

#[test]
fn newer_frames_are_empty_and_values_unspecified() {
    let mut unknown = BytesMut::new();
    unknown.put_slice(&[0xFA, 0x01, 2, 0x08, 1]); // field 31, length 2
    assert_eq!(v1::PlayRequest::decode(unknown), Ok(v1::PlayRequest { frame: None }));
    let newer = v1::Act { action: 99, ..act() };
    let back = v1::Act::decode(newer.encode_to_vec().as_slice()).unwrap();
    assert_eq!((back.action, back.action()), (99, v1::Action::Unspecified));
}

#[test]
fn absent_metrics_differ_from_empty_ones() {
    let empty = v1::EpisodeEnd { metrics: Some(v1::PublicMetrics::default()), ..v1::EpisodeEnd::default() };
    let back = v1::EpisodeEnd::decode(empty.encode_to_vec().as_slice()).unwrap();
    assert!(back.metrics.is_some());
    assert_eq!(v1::EpisodeEnd::decode(&[][..]).unwrap().metrics, None);
}

#[test]
fn garbage_is_an_error() {
    assert!(v1::PlayRequest::decode(&[0x1A, 200, 0x08][..]).is_err());
    assert!(v1::PlayRequest::decode(&[0xFF; 16][..]).is_err());
}

#[test]
fn reasons_round_trip_as_text() {
    for number in 0..64 {
        let Ok(reason) = Reason::try_from(number) else { continue };
        assert_eq!(Reason::from_word(reason.word()), Some(reason));
        assert!(!reason.word().starts_with("REASON"));
    }
    assert_eq!(Reason::StepAhead.word(), "STEP_AHEAD");
    assert_eq!(Reason::from_word("MOON_PHASE"), None);
}

#[test]
fn reflection_finds_all_services() {
    let text = String::from_utf8_lossy(FILE_DESCRIPTOR_SET);
    for service in ["InfoService", "RunService", "PlayService"] {
        assert!(text.contains(service), "{service}");
    }
}

fn folder() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn page() -> String {
    fs::read_to_string(folder().join("PROTOCOL.md")).unwrap()
}

/// Sorted names and texts in the .proto files.
fn protos() -> Vec<(String, String)> {
    let entries = fs::read_dir(folder().join("avln/v1")).unwrap();
    let mut files: Vec<_> = entries
        .map(|entry| entry.unwrap())
        .map(|entry| (entry.file_name().into_string().unwrap(), fs::read_to_string(entry.path()).unwrap()))
        .collect();
    files.sort();
    files
}

fn fingerprint() -> String {
    let mut hasher = blake3::Hasher::new();
    for (name, text) in protos() {
        hasher.update(name.as_bytes()).update(&[0]).update(text.as_bytes()).update(&[0]);
    }
    hasher.finalize().to_hex()[..32].to_owned()
}

/// Backticked words at row starts, with the following cells.
fn rows(page: &str) -> impl Iterator<Item = (&str, Vec<&str>)> {
    page.lines().filter_map(|line| {
        let (word, rest) = line.strip_prefix("| `")?.split_once('`')?;
        Some((word, rest.split('|').map(str::trim).collect()))
    })
}

/// Names declared by a keyword.
fn declared(keyword: &str) -> Vec<String> {
    let declares = |line: &str| {
        let rest = line.trim_start().strip_prefix(keyword)?.strip_prefix(' ')?;
        rest.split([' ', '(']).next().map(str::to_owned)
    };
    protos().iter().flat_map(|(_, text)| text.lines().filter_map(declares).collect::<Vec<_>>()).collect()
}

#[test]
fn the_page_has_the_fingerprint_of_the_files() {
    let page = page();
    let (_, rest) = page.split_once(MARK).expect("PROTOCOL.md has no fingerprint");
    let written = rest.split('`').next().unwrap();
    assert_eq!(
        written,
        fingerprint(),
        "the .proto files changed: bring PROTOCOL.md up to date, then write the right value there"
    );
}

#[test]
fn the_page_describes_this_minor_version() {
    assert!(
        page().contains(&format!("API minor {API_MINOR}.")),
        "PROTOCOL.md describes another minor version"
    );
}

#[test]
fn the_table_of_refusals_matches_the_code() {
    let page = page();
    let (_, refusals) = page.split_once("## Refusals").unwrap();
    let listed: Vec<_> = rows(refusals).take_while(|(word, _)| *word != "Fault").collect();
    for (word, cells) in &listed {
        let reason = Reason::from_word(word).unwrap_or_else(|| panic!("{word} is not a reason"));
        let code = format!("{:?}", reason.code()).to_uppercase();
        assert_eq!(cells[1].replace('_', ""), code, "{word}");
        let reaction = cells.get(3).and_then(|cell| cell.split([' ', ',', ';', ':']).next());
        assert!(reaction.is_some_and(|first| REACTIONS.contains(&first)), "{word}: {reaction:?}");
    }
    let reasons = (1..).map_while(|number| Reason::try_from(number).ok());
    let missing: Vec<_> = reasons.filter(|r| !listed.iter().any(|(word, _)| *word == r.word())).collect();
    assert!(missing.is_empty(), "not in PROTOCOL.md: {missing:?}");
}

#[test]
fn protocol_page_lists_services_methods_and_frames() {
    let page = page();
    let frames =
        ["Hello", "Ready", "Act", "Abandon", "Pong", "Goodbye", "Welcome", "EpisodeStart", "Observation"];
    let more = ["EpisodeEnd", "Ping", "Notice", "Fault", "RunEnd"];
    for frame in frames.into_iter().chain(more) {
        assert!(rows(&page).any(|(word, _)| word == frame), "{frame} has no row");
    }
    for name in [declared("service"), declared("rpc")].concat() {
        assert!(page.contains(&format!("`{name}`")), "{name} is not on the page");
    }
}

#[test]
fn architecture_page_paths_exist() {
    let (page, protos) = (page(), protos());
    let all: String = protos.iter().map(|(_, text)| text.as_str()).collect();
    let fenceless: String = page.split("```").step_by(2).collect();
    for quoted in fenceless.split('`').skip(1).step_by(2) {
        let Some((message, field)) = quoted.split_once('.') else { continue };
        let known = ["service", "message"].iter().any(|k| declared(k).iter().any(|name| name == message));
        if known && !field.contains([' ', '/', '.']) {
            assert!(all.contains(&format!(" {field} =")), "`{quoted}` does not exist");
        }
    }
}

/// `DistanceRule` becomes `DISTANCE_RULE_`.
fn prefix(name: &str) -> String {
    let mut prefix = String::new();
    for (at, letter) in name.char_indices() {
        if at > 0 && letter.is_uppercase() {
            prefix.push('_');
        }
        prefix.push(letter.to_ascii_uppercase());
    }
    prefix + "_"
}

#[test]
fn enums_begin_unspecified_and_carry_their_prefix() {
    for (file, text) in protos() {
        for declaration in text.split("\nenum ").skip(1) {
            let (name, body) = declaration.split_once(" {").unwrap();
            let body = body.split("\n}").next().unwrap();
            let values: Vec<_> = body
                .lines()
                .map(str::trim)
                .filter(|line| line.contains(" = ") && !line.starts_with("//"))
                .collect();
            let prefix = prefix(name);
            assert_eq!(values[0], format!("{prefix}UNSPECIFIED = 0;"), "{file}");
            assert!(values.iter().all(|value| value.starts_with(&prefix)), "{file}: {name}");
        }
    }
}

#[test]
fn every_declaration_has_a_comment() {
    for (file, text) in protos() {
        let lines: Vec<_> = text.lines().map(str::trim).collect();
        for pair in lines.windows(2) {
            let opens = ["message ", "enum ", "service ", "rpc ", "oneof "]
                .iter()
                .any(|word| pair[1].starts_with(word));
            let field = pair[1].contains(" = ") && pair[1].ends_with(';') && !pair[1].starts_with("syntax");
            let commented = pair[0].starts_with("//") || pair[1].starts_with("//");
            assert!(commented || !(opens || field), "{file}: no comment above `{}`", pair[1]);
        }
    }
}
