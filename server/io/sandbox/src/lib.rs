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
#[cfg(target_os = "linux")]
mod process;
#[cfg(target_os = "linux")]
mod restrict;

pub use container::{Container, Engine};
pub use group::{ControlGroup, available_mib, default_reserve_mib};
#[cfg(target_os = "linux")]
pub use restrict::lower_thread;

use serde::{Deserialize, Serialize};
use std::{
    convert::Infallible,
    fs, io,
    path::{Path, PathBuf},
};

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

/// Maximum processes and threads of an agent.
pub(crate) const MAX_PROCESSES: u32 = 4096;

/// Returns the maximum processes and threads of an agent in namespaces on this machine.
pub(crate) fn max_processes() -> u32 {
    // The kernel gives even the lowest priority a share: that of 341 busy threads equals the share of an ordinary one.
    const PER_CORE: usize = 128;
    const LEAST: u32 = 256;
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    u32::try_from(cores * PER_CORE).unwrap_or(MAX_PROCESSES).clamp(LEAST, MAX_PROCESSES)
}

/// Sandbox settings.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SandboxPlan {
    /// The organiser's private folder for sockets, this plan and the scratch folder.
    pub folder: PathBuf,
    /// The agent's program and arguments.
    pub command: Vec<String>,
    /// The agent's working directory.
    pub workplace: PathBuf,
    /// The data folder, hidden from the agent.
    pub hidden: PathBuf,
    /// Readable paths in addition to system programs and libraries.
    pub readable: Vec<PathBuf>,
    /// Permitted devices, such as graphics cards.
    pub devices: Vec<PathBuf>,
    /// Memory limit per process, MiB; `None` for no limit.
    pub memory_mib: Option<u32>,
    /// Environment variables passed on to the agent.
    pub variables: Vec<String>,
}

/// Enforced and missing restrictions.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SandboxReport {
    /// Enforced restrictions, for people.
    pub enforced: Vec<String>,
    /// Missing restrictions.
    pub missing: Vec<MissingRestriction>,
}

/// A restriction that is not enforced.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MissingRestriction {
    /// The restriction.
    pub what: String,
    /// The reason.
    pub why: String,
}

/// A sandbox error.
#[expect(missing_docs, reason = "the messages explain the fields")]
#[derive(Debug, thiserror::Error)]
pub enum SandboxError {
    /// The plan cannot be read or written.
    #[error(
        "cannot use the sandbox plan {path}: {problem}; check the disk and the permissions of its folder"
    )]
    Plan { path: PathBuf, problem: String },
    /// The ground truth would be accessible to the agent.
    #[error(
        "an agent could read the ground truth in {hidden}: {why}; use another machine, or move the data folder away from \
         the folders that the agent may read"
    )]
    Exposed { hidden: PathBuf, why: String },
    /// The process on the other side of the control socket has ended.
    #[error("the sandbox was abandoned: {0}; start the run again")]
    GivenUp(String),
    /// The agent's program does not start.
    #[error(
        "cannot start the agent '{program}': {problem}; check the command after --, and name folders that it needs with --read"
    )]
    Command { program: String, problem: String },
    /// The system supports no sandbox feature.
    #[error("sealed runs need Linux; use a Linux machine")]
    Unsupported,
}

impl SandboxPlan {
    /// Returns the path to the server's socket.
    pub fn server_socket(folder: &Path) -> PathBuf {
        folder.join("arena.sock")
    }

    /// Returns the path to the socket for the child's report and the token.
    pub fn control_socket(folder: &Path) -> PathBuf {
        folder.join("control.sock")
    }

    /// Returns the path to the agent's scratch folder, deleted after the run.
    pub fn scratch(folder: &Path) -> PathBuf {
        folder.join("scratch")
    }

    /// Writes the plan into its folder and creates the scratch folder. Returns the plan's path.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub fn write(&self) -> Result<PathBuf, SandboxError> {
        let path = self.folder.join("plan.json");
        let written = fs::create_dir_all(Self::scratch(&self.folder))
            .and_then(|()| fs::write(&path, serde_json::to_vec(self).map_err(io::Error::from)?));
        match written {
            Ok(()) => Ok(path),
            Err(error) => Err(SandboxError::Plan { path, problem: error.to_string() }),
        }
    }

    /// Reads a plan.
    ///
    /// # Errors
    /// If it is missing or damaged.
    pub fn read(path: &Path) -> Result<Self, SandboxError> {
        let plan = fs::read(path).and_then(|text| serde_json::from_slice(&text).map_err(io::Error::from));
        plan.map_err(|error| SandboxError::Plan { path: path.to_owned(), problem: error.to_string() })
    }
}

impl SandboxReport {
    /// Records the result of a restriction.
    pub fn note(&mut self, what: &str, result: Result<(), impl ToString>) {
        match result {
            Ok(()) => self.enforced.push(what.to_owned()),
            Err(why) => self.missing.push(MissingRestriction { what: what.to_owned(), why: why.to_string() }),
        }
    }

    /// Returns whether `what` is enforced.
    pub fn holds(&self, what: &str) -> bool {
        self.enforced.iter().any(|held| held == what)
    }

    /// Returns the reason for a missing restriction.
    pub fn why(&self, what: &str) -> Option<&str> {
        self.missing.iter().find(|gap| gap.what == what).map(|gap| gap.why.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(folder: &Path) -> SandboxPlan {
        SandboxPlan {
            folder: folder.to_owned(),
            command: vec!["sh".to_owned(), "-c".to_owned(), "true".to_owned()],
            workplace: "/".into(),
            hidden: "/data".into(),
            readable: vec!["/opt".into()],
            devices: vec![],
            memory_mib: Some(512),
            variables: vec!["LANG".to_owned()],
        }
    }

    #[test]
    fn plans_round_trip_and_damage_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = plan(folder.path()).write().unwrap();
        assert_eq!(SandboxPlan::read(&path).unwrap(), plan(folder.path()));
        fs::write(&path, "{").unwrap();
        let text = SandboxPlan::read(&path).unwrap_err().to_string();
        assert!(text.contains("plan.json"), "{text}");
    }

    #[test]
    fn reports_contain_noted_results() {
        let mut report = SandboxReport::default();
        report.note("a", Ok::<_, String>(()));
        report.note("b", Err("no kernel"));
        assert!(report.holds("a") && !report.holds("b"));
        assert_eq!((report.why("a"), report.why("b")), (None, Some("no kernel")));
        assert_eq!(report.missing, [MissingRestriction { what: "b".into(), why: "no kernel".into() }]);
    }
}
