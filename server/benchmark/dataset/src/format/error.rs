/// A file of a data set that cannot be used: which, where and why.
#[derive(Debug, PartialEq, thiserror::Error)]
#[error("{file}{}: {cause}", line.map(|line| format!(", line {line}")).unwrap_or_default())]
pub struct FormatError {
    /// Name of the file.
    pub file: String,
    /// The line, from 1; none when the whole file is meant.
    pub line: Option<usize>,
    /// What is wrong.
    pub cause: FormatCause,
}

/// What is wrong with a file of a data set.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum FormatCause {
    /// The line is not what belongs there.
    #[error("{0}")]
    Json(String),
    /// The file belongs to another layout.
    #[error(
        "it has version {found}, this program reads version {read}; build the data set again or update the program"
    )]
    Version {
        /// What it says.
        found: u32,
        /// What is read.
        read: u32,
    },
    /// The file is of another kind or scene.
    #[error("it says {found} where {expected} belongs; was a file renamed?")]
    Other {
        /// What it says.
        found: String,
        /// What belongs there.
        expected: String,
    },
    /// The file ends early, or goes on.
    #[error(
        "it holds {found} {what}, its first line promises {promised}; the file is truncated or was put together"
    )]
    Count {
        /// What is counted.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many there should be.
        promised: usize,
    },
    /// A list is longer than anything sensible.
    #[error("{found} {what} are more than the {limit} that are read")]
    TooMany {
        /// What is counted.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many are read.
        limit: usize,
    },
    /// Two entries have one id.
    #[error("{what} {id} occurs twice")]
    Duplicate {
        /// What is named.
        what: &'static str,
        /// The id.
        id: String,
    },
    /// An entry names one that is not there.
    #[error("mission {mission} names {what} {id}, which is not in the file")]
    Unknown {
        /// The mission.
        mission: String,
        /// What is named.
        what: &'static str,
        /// The id.
        id: String,
    },
    /// Public and sealed part of a mission do not fit together.
    #[error("mission {mission}: {what}")]
    Mismatch {
        /// The mission.
        mission: String,
        /// What does not fit.
        what: &'static str,
    },
    /// A number is no number.
    #[error("{what} is not a finite number")]
    NotFinite {
        /// Which.
        what: &'static str,
    },
    /// The content is not what the list of files says.
    #[error("its digest is {found}, the list of scenes says {expected}; restore the file or build it again")]
    Digest {
        /// What it is.
        found: String,
        /// What it should be.
        expected: String,
    },
}
