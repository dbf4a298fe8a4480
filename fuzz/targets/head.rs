//! Measured heads: SOFA files.
#![no_main]

libfuzzer_sys::fuzz_target!(init: avln_fuzz::permit_panics_in_libraries(), |bytes: &[u8]| {
    let _ = avln_acoustics::MeasuredHead::from_sofa(bytes);
});
