//! Where the agent of a sealed run is shut in: namespaces, Landlock, seccomp and limits, or a container.
//!
//! Start reading at [`Plan`], then [`enter`] and [`shut`]: the program runs itself again as the *porter*, which takes
//! namespaces of its own, and once more as the *inmate*, which gives everything else away, reports what holds, waits for
//! the run's token and becomes the agent.
//!
//! *Never*: gives the agent a token before the report was read; says that something holds which the kernel did not confirm.

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

/// The porter's part: takes namespaces, runs `program` with `inmate_arguments` inside and waits for its end. It is called
/// before any thread is started.
///
/// Returns the exit code of the agent, 128 and the number of the signal where one ended it.
///
/// # Errors
/// When the plan cannot be read or the inmate cannot be started.
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

/// The inmate's part: restricts this process, reports, waits for the token and becomes the agent. `outside` tells why there
/// are no namespaces; `None` where there are.
///
/// # Errors
/// When the plan cannot be read, nothing would keep the agent from the data folder, the run was not started, or the
/// agent's program cannot be started. It returns in no other case.
pub fn shut(plan: &std::path::Path, outside: Option<&str>) -> Result<std::convert::Infallible, CellError> {
    #[cfg(target_os = "linux")]
    return inmate::shut(plan, outside);
    #[cfg(not(target_os = "linux"))]
    {
        let _ = (plan, outside);
        Err(CellError::Unsupported)
    }
}
