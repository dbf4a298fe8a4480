//! Data sets of others: LH-AVLN's authors, GOAT-Bench, Habitat, MultiON; plain or gzip.
#![no_main]

use avln_interchange::{Format, read};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    for format in Format::ALL.into_iter().map(Some).chain([None]) {
        let _ = read("file", bytes, format);
    }
});
