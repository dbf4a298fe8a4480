//! Sandbox for sealed agents: namespaces, Landlock, seccomp and limits, or a container.
//!
//! Start at [`SandboxPlan`], then [`supervise`] and [`enter`]: the program executes itself as the *supervisor*, which creates
//! namespaces, and again as the *child*, which drops all privileges, reports the restrictions, waits for the run token and
//! becomes the agent.
//!
//! This crate never sends the agent a token before the report was read or reports restrictions that the
//! kernel did not confirm.

mod container;
mod group;
mod memory;
mod plan;
#[cfg(target_os = "linux")]
mod priority;
#[cfg(target_os = "linux")]
mod process;
#[cfg(target_os = "linux")]
mod restrict;

pub use container::{Container, Engine};
pub use group::ControlGroup;
pub use memory::{available_mib, default_reserve_mib};
pub use plan::{MissingRestriction, SandboxError, SandboxPlan, SandboxReport};
#[cfg(target_os = "linux")]
pub use priority::lower_thread;

use std::{convert::Infallible, path::Path};

/// Does nothing: this system has no sealed agents.
#[cfg(not(target_os = "linux"))]
pub fn lower_thread() {}

/// Supervisor: closes inherited files, creates namespaces, runs `program` with `child_arguments` inside and waits for the end. Must
/// be called before any thread starts or file is opened. Returns the agent's exit code, or 128 plus the signal number.
///
/// # Errors
/// If the plan cannot be read, or the child cannot be started.
pub fn supervise(plan: &Path, program: &Path, child_arguments: &[String]) -> Result<u8, SandboxError> {
    #[cfg(target_os = "linux")]
    return process::supervise(plan, program, child_arguments);
    #[cfg(not(target_os = "linux"))]
    {
        let _ = (plan, program, child_arguments);
        Err(SandboxError::Unsupported)
    }
}

/// Child: closes inherited files, restricts this process, reports, waits for the token and becomes the agent. `outside` is the
/// reason for missing namespaces; `None` if they exist.
///
/// # Errors
/// If the plan cannot be read, the agent could read the data folder, the agent's program cannot be opened, no run was started, or
/// the agent cannot be started. Does not return otherwise.
pub fn enter(plan: &Path, outside: Option<&str>) -> Result<Infallible, SandboxError> {
    #[cfg(target_os = "linux")]
    return process::enter(plan, outside);
    #[cfg(not(target_os = "linux"))]
    {
        let _ = (plan, outside);
        Err(SandboxError::Unsupported)
    }
}
