//! Logs of runs.
#![no_main]

use avln_arena::runlog::History;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    for log in [bytes.to_vec(), avln_fuzz::chained(bytes)] {
        if let Ok(history) = History::parse(&log) {
            let _ = history.away();
            let _ = history.episodes();
        }
    }
});
