//! Measured heads: SOFA files.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let _ = avln_acoustics::MeasuredHead::from_sofa(bytes);
});
