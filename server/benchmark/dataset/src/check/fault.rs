//! Constraints of missions, and their violations.

use std::fmt;

/// A mission that breaks a constraint.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Id of the mission.
    pub mission: String,
    /// What it breaks.
    pub constraint: Constraint,
    /// What was found.
    pub found: String,
}

/// What every mission must keep.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Constraint {
    /// No id occurs twice.
    UniqueIds,
    /// As many goals as allowed.
    GoalCount,
    /// At least two modalities.
    Modalities,
    /// No category twice.
    Categories,
    /// As many same-category distractors as the file says and the recipe allows.
    Distractors,
    /// The target is the scene's instance of that number.
    Target,
    /// The cue fits its target: the sentence is one, the picture shows it.
    Cue,
    /// The sound comes from the target.
    Source,
    /// Every place of a success region is one, on the reachable island.
    Region,
    /// The start is on the reachable island.
    Start,
    /// All targets can be reached.
    Reachable,
    /// Targets are far enough from the start, and as far as the file says.
    StartDistance,
    /// Targets are far enough from each other.
    Separation,
    /// Stored tours begin at the start and are as long as they say.
    ReferencePath,
    /// Stored tours take as many steps as they say.
    ReferenceSteps,
    /// Stored tours are the shortest.
    ReferenceLength,
    /// Targets are asked for about equally often.
    Reuse,
}

impl Constraint {
    /// Its name in reports.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::UniqueIds => "unique-ids",
            Self::GoalCount => "goal-count",
            Self::Modalities => "modalities",
            Self::Categories => "categories",
            Self::Distractors => "distractors",
            Self::Target => "target",
            Self::Cue => "cue",
            Self::Source => "source",
            Self::Region => "region",
            Self::Start => "start",
            Self::Reachable => "reachable",
            Self::StartDistance => "start-distance",
            Self::Separation => "separation",
            Self::ReferencePath => "reference-path",
            Self::ReferenceSteps => "reference-steps",
            Self::ReferenceLength => "reference-length",
            Self::Reuse => "reuse",
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}: {}", self.mission, self.constraint.as_str(), self.found)
    }
}
