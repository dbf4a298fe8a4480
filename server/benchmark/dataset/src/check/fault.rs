//! Constraints of missions, and their violations.

use std::fmt;

/// Violated constraint.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Mission id.
    pub mission: String,
    /// Constraint.
    pub constraint: Constraint,
    /// Details.
    pub found: String,
}

/// Mission constraint.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Constraint {
    /// Unique ids.
    UniqueIds,
    /// Allowed goal count.
    GoalCount,
    /// At least two modalities.
    Modalities,
    /// Distinct categories.
    Categories,
    /// Distractor count as stored and allowed.
    Distractors,
    /// Existing target instance.
    Target,
    /// Matching cue: a valid sentence, or a picture with the target.
    Cue,
    /// Sound source at the target.
    Source,
    /// Valid success region points on the reachable island.
    Region,
    /// Start on the reachable island.
    Start,
    /// Reachable targets.
    Reachable,
    /// Least start distance, as stored.
    StartDistance,
    /// Least distance between targets.
    Separation,
    /// Stored tours from the start with their stated length.
    ReferencePath,
    /// Correct step count for stored tours.
    ReferenceSteps,
    /// Shortest stored tours.
    ReferenceLength,
    /// Balanced target use.
    Reuse,
}

impl Constraint {
    /// Returns the name in reports.
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
