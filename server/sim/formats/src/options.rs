//! Import options and warnings.

use std::path::PathBuf;

/// A file's vertical axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpAxis {
    /// Y, as in glTF.
    Y,
    /// Z, as in Matterport, Replica and Gibson scans.
    Z,
}

/// A file's unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LengthUnit {
    /// 1 m.
    Metre,
    /// 0.01 m.
    Centimetre,
    /// 0.001 m.
    Millimetre,
}

/// Axis and unit set by the caller; `None` leaves the choice to the importer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ImportOptions {
    /// The vertical axis.
    pub up: Option<UpAxis>,
    /// The unit.
    pub unit: Option<LengthUnit>,
}

impl LengthUnit {
    /// Returns the length in metres.
    pub fn metres(self) -> f32 {
        match self {
            Self::Metre => 1.0,
            Self::Centimetre => 0.01,
            Self::Millimetre => 0.001,
        }
    }

    /// Returns the command-line option that selects the unit.
    pub(crate) fn option(self) -> &'static str {
        match self {
            Self::Metre => "--units m",
            Self::Centimetre => "--units cm",
            Self::Millimetre => "--units mm",
        }
    }
}

impl UpAxis {
    pub(crate) fn index(self) -> usize {
        match self {
            Self::Y => 1,
            Self::Z => 2,
        }
    }

    pub(crate) fn other(self) -> Self {
        match self {
            Self::Y => Self::Z,
            Self::Z => Self::Y,
        }
    }

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Y => "y",
            Self::Z => "z",
        }
    }
}

/// Greatest warning count.
const MAX_WARNINGS: usize = 100;
const MORE: &str = "there are further warnings, which are not listed";

/// Notes from a successful import: guesses, replacements and omissions.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ImportReport {
    /// The recognised layout (`HM3D`, `glTF` …); empty before the import.
    pub layout: &'static str,
    /// Path to a navigation mesh next to the scene.
    pub navmesh: Option<PathBuf>,
    /// Distinct sentences in order; at most 100, and a note if there were more.
    pub warnings: Vec<String>,
}

impl ImportReport {
    /// Adds a warning, unless it is a duplicate.
    pub fn warn(&mut self, text: impl Into<String>) {
        let text = text.into();
        // A damaged file can cause a warning per triangle; the linear search for duplicates stays short because of the limit.
        if self.warnings.len() > MAX_WARNINGS || self.warnings.contains(&text) {
            return;
        }
        self.warnings.push(if self.warnings.len() < MAX_WARNINGS { text } else { MORE.to_owned() });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn warnings_are_unique_and_limited() {
        let mut report = ImportReport::default();
        ["a", "b", "a"].into_iter().for_each(|text| report.warn(text));
        assert_eq!(report.warnings, ["a", "b"]);
        (0..1000).for_each(|number| report.warn(format!("warning {number}")));
        assert_eq!(report.warnings.len(), MAX_WARNINGS + 1);
        assert_eq!(report.warnings[MAX_WARNINGS - 1], "warning 97");
        assert_eq!(report.warnings[MAX_WARNINGS], MORE);
    }
}
