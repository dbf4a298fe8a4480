//! Challenge files.
#![no_main]

use avln_arena::challenge::ChallengeFile;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let _ = ChallengeFile::parse(&String::from_utf8_lossy(bytes));
});
