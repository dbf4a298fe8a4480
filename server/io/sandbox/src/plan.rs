use serde::{Deserialize, Serialize};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// What the cell of one agent is like.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Plan {
    /// Folder of the cell's own, which only its organiser can enter: sockets, this plan, and where the agent may write.
    pub folder: PathBuf,
    /// The agent's program and its arguments.
    pub command: Vec<String>,
    /// Where the agent starts.
    pub workplace: PathBuf,
    /// What the agent must never see: the data folder.
    pub hidden: PathBuf,
    /// What the agent may read beside the system's programs and libraries.
    pub readable: Vec<PathBuf>,
    /// Devices that the agent may use, such as those of a graphics card.
    pub devices: Vec<PathBuf>,
    /// Memory that each process of the agent may map, MiB; `None`: any.
    pub memory_mib: Option<u32>,
    /// Variables of the organiser's environment that the agent gets too.
    pub variables: Vec<String>,
}

/// What holds in a cell, and what does not.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Report {
    /// What is enforced, in words for people.
    pub enforced: Vec<String>,
    /// What is not.
    pub missing: Vec<Missing>,
}

/// Something that a cell should enforce and does not.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Missing {
    /// What it is.
    pub what: String,
    /// Why it is missing.
    pub why: String,
}

/// Why there is no cell.
#[derive(Debug, thiserror::Error)]
pub enum CellError {
    /// The plan cannot be read or written.
    #[error("plan of the cell {path}: {problem}")]
    Plan {
        /// Where it lies.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// Nothing keeps the agent from the ground truth.
    #[error(
        "nothing here keeps an agent from reading {hidden}, which holds ground truth: {why}; use another machine, or move the \
         data folder out of what the agent may read"
    )]
    Exposed {
        /// The data folder.
        hidden: PathBuf,
        /// What is missing.
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
        /// What was to be started.
        program: String,
        /// What the system said.
        problem: String,
    },
    /// The system has nothing of what a cell is made of.
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

    /// Where the agent may write; what it writes goes with it.
    pub fn scratch(folder: &Path) -> PathBuf {
        folder.join("scratch")
    }

    /// Writes the plan into its folder and makes what the agent may write to; returns where it lies.
    ///
    /// # Errors
    /// When the folder cannot be written.
    pub fn write(&self) -> Result<PathBuf, CellError> {
        let path = self.folder.join("plan.json");
        let wrong = |problem: String| CellError::Plan { path: path.clone(), problem };
        let text = serde_json::to_vec(self).map_err(|error| wrong(error.to_string()))?;
        fs::create_dir_all(Self::scratch(&self.folder)).map_err(|error| wrong(error.to_string()))?;
        fs::write(&path, text).map_err(|error| wrong(error.to_string()))?;
        Ok(path)
    }

    /// Reads a plan that was written.
    ///
    /// # Errors
    /// When there is none or it is damaged.
    pub fn read(path: &Path) -> Result<Self, CellError> {
        let wrong = |problem: String| CellError::Plan { path: path.to_owned(), problem };
        let text = fs::read(path).map_err(|error| wrong(error.to_string()))?;
        serde_json::from_slice(&text).map_err(|error| wrong(error.to_string()))
    }
}

impl Report {
    /// Notes whether something holds.
    pub fn note(&mut self, what: &str, result: Result<(), impl ToString>) {
        match result {
            Ok(()) => self.enforced.push(what.to_owned()),
            Err(why) => self.missing.push(Missing { what: what.to_owned(), why: why.to_string() }),
        }
    }

    /// Whether `what` is enforced.
    pub fn holds(&self, what: &str) -> bool {
        self.enforced.iter().any(|held| held == what)
    }

    /// Why `what` is missing, where it is.
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
