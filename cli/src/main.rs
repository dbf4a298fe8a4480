//! The binary `avln`.

use std::process::ExitCode;

/// musl's own takes and gives back the memory of every picture, and is slower for it.
#[cfg(target_env = "musl")]
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    avln_cli::main()
}
