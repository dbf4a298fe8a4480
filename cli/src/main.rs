//! The binary `avln`.

use std::process::ExitCode;

// The allocator in musl returns the memory for every picture to the system, which is slower.
#[cfg(target_env = "musl")]
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    avln_cli::main()
}
