//! The sandbox of a sealed agent: namespaces, Landlock, seccomp and limits, or a container.
//!
//! Start reading at [`Plan`], then [`enter`] and [`shut`]: the program re-executes itself as the
//! *supervisor*, which creates namespaces, and again as the *child*, which drops all privileges, reports the
//! restrictions, waits for the run token and becomes the agent.
//!
//! *Never*: passes a token to the agent before the report was read; reports restrictions not confirmed by the
//! kernel.

mod container;
#[cfg(target_os = "linux")]
mod inmate;
#[cfg(target_os = "linux")]
mod mounts;
#[cfg(target_os = "linux")]
mod namespaces;
mod plan;
#[cfg(target_os = "linux")]
mod porter;
#[cfg(target_os = "linux")]
mod restrict;

pub use container::{Container, Engine};
pub use plan::{CellError, Missing, Plan, Report};

/// Supervisor: creates namespaces, runs `program` with `inmate_arguments` inside and waits for its end. Must
/// be called before any thread starts.
///
/// Returns the exit code of the agent, or 128 plus the signal number.
///
/// # Errors
/// If the plan cannot be read, or the child cannot be started.
pub fn enter(
    plan: &std::path::Path,
    program: &std::path::Path,
    inmate_arguments: &[String],
) -> Result<u8, CellError> {
    #[cfg(target_os = "linux")]
    return porter::enter(plan, program, inmate_arguments);
    #[cfg(not(target_os = "linux"))]
    {
        let _ = (plan, program, inmate_arguments);
        Err(CellError::Unsupported)
    }
}

/// Child: restricts this process, reports, waits for the token and becomes the agent. `outside` is the reason
/// for missing namespaces; `None` if they exist.
///
/// # Errors
/// If the plan cannot be read, the data folder would stay accessible, the run was not started, or the agent
/// cannot be started. Does not return otherwise.
pub fn shut(plan: &std::path::Path, outside: Option<&str>) -> Result<std::convert::Infallible, CellError> {
    #[cfg(target_os = "linux")]
    return inmate::shut(plan, outside);
    #[cfg(not(target_os = "linux"))]
    {
        let _ = (plan, outside);
        Err(CellError::Unsupported)
    }
}
