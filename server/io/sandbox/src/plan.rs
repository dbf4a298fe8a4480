use serde::{Deserialize, Serialize};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Settings of a sandbox.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Plan {
    /// Private folder, accessible to the organiser only: sockets, this plan, and the scratch folder.
    pub folder: PathBuf,
    /// Program and arguments of the agent.
    pub command: Vec<String>,
    /// Working directory of the agent.
    pub workplace: PathBuf,
    /// The data folder, hidden from the agent.
    pub hidden: PathBuf,
    /// Readable paths in addition to system programs and libraries.
    pub readable: Vec<PathBuf>,
    /// Permitted devices, such as graphics cards.
    pub devices: Vec<PathBuf>,
    /// Memory that each process of the agent may map, MiB; `None`: any.
    pub memory_mib: Option<u32>,
    /// Variables of the organiser's environment that the agent gets too.
    pub variables: Vec<String>,
}

/// Enforced and missing restrictions.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Report {
    /// Enforced restrictions, for people.
    pub enforced: Vec<String>,
    /// Missing restrictions.
    pub missing: Vec<Missing>,
}

/// Something that a cell should enforce and does not.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Missing {
    /// Restriction.
    pub what: String,
    /// Why it is missing.
    pub why: String,
}

/// Errors of a sandbox.
#[derive(Debug, thiserror::Error)]
pub enum CellError {
    /// The plan cannot be read or written.
    #[error("plan of the cell {path}: {problem}")]
    Plan {
        /// Path.
        path: PathBuf,
        /// Problem.
        problem: String,
    },
    /// The ground truth would be accessible to the agent.
    #[error(
        "nothing here keeps an agent from reading {hidden}, which holds ground truth: {why}; use another machine, or move the \
         data folder out of what the agent may read"
    )]
    Exposed {
        /// The data folder.
        hidden: PathBuf,
        /// Missing features.
        why: String,
    },
    /// The other side of the cell's door is gone.
    #[error("the cell was given up: {0}")]
    GivenUp(String),
    /// The agent's program does not start.
    #[error(
        "cannot start the agent '{program}': {problem}; check the command after --, and name folders that it needs with --read"
    )]
    Command {
        /// Program to start.
        program: String,
        /// System error.
        problem: String,
    },
    /// The system supports no sandbox feature.
    #[error("sealed runs need Linux; play sealed runs on a machine that has it")]
    Unsupported,
}

impl Plan {
    /// The socket that leads to the server.
    pub fn server_socket(folder: &Path) -> PathBuf {
        folder.join("arena.sock")
    }

    /// The socket over which the inmate reports and gets the token.
    pub fn control_socket(folder: &Path) -> PathBuf {
        folder.join("control.sock")
    }

    /// Scratch folder of the agent, deleted afterwards.
    pub fn scratch(folder: &Path) -> PathBuf {
        folder.join("scratch")
    }

    /// Writes the plan into its folder and creates the scratch folder; returns the path.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub fn write(&self) -> Result<PathBuf, CellError> {
        let path = self.folder.join("plan.json");
        let wrong = |problem: String| CellError::Plan { path: path.clone(), problem };
        let text = serde_json::to_vec(self).map_err(|error| wrong(error.to_string()))?;
        fs::create_dir_all(Self::scratch(&self.folder)).map_err(|error| wrong(error.to_string()))?;
        fs::write(&path, text).map_err(|error| wrong(error.to_string()))?;
        Ok(path)
    }

    /// Reads a plan.
    ///
    /// # Errors
    /// If it is missing or damaged.
    pub fn read(path: &Path) -> Result<Self, CellError> {
        let wrong = |problem: String| CellError::Plan { path: path.to_owned(), problem };
        let text = fs::read(path).map_err(|error| wrong(error.to_string()))?;
        serde_json::from_slice(&text).map_err(|error| wrong(error.to_string()))
    }
}

impl Report {
    /// Records the result of a restriction.
    pub fn note(&mut self, what: &str, result: Result<(), impl ToString>) {
        match result {
            Ok(()) => self.enforced.push(what.to_owned()),
            Err(why) => self.missing.push(Missing { what: what.to_owned(), why: why.to_string() }),
        }
    }

    /// Returns true if `what` is enforced.
    pub fn holds(&self, what: &str) -> bool {
        self.enforced.iter().any(|held| held == what)
    }

    /// Reason for a missing restriction.
    pub fn why(&self, what: &str) -> Option<&str> {
        self.missing.iter().find(|gap| gap.what == what).map(|gap| gap.why.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(folder: &Path) -> Plan {
        Plan {
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
    fn plans_are_read_as_they_were_written_and_damage_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = plan(folder.path()).write().unwrap();
        assert_eq!(Plan::read(&path).unwrap(), plan(folder.path()));
        fs::write(&path, "{").unwrap();
        let text = Plan::read(&path).unwrap_err().to_string();
        assert!(text.contains("plan.json"), "{text}");
    }

    #[test]
    fn reports_hold_what_was_noted() {
        let mut report = Report::default();
        report.note("a", Ok::<_, String>(()));
        report.note("b", Err("no kernel"));
        assert!(report.holds("a") && !report.holds("b"));
        assert_eq!((report.why("a"), report.why("b")), (None, Some("no kernel")));
        assert_eq!(report.missing, [Missing { what: "b".into(), why: "no kernel".into() }]);
    }
}
