//! Sentences of goals, as an agent receives them.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let _ = avln_kit::perception::CueWords::parse(&String::from_utf8_lossy(bytes));
});
