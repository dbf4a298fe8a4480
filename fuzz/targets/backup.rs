//! Backups.
#![no_main]

use avln_fuzz::with_file;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    with_file("backup.tar", bytes, |path| {
        let to = tempfile::tempdir().expect("a folder");
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
        let _ = runtime.block_on(avln_arena::backup::restore(path, &to.path().join("data")));
    });
});
