//! What an importer noticed that does not stop it.

use std::path::PathBuf;

/// Warnings beyond this many are counted in one line.
const MAX_WARNINGS: usize = 100;
const MORE: &str = "there are further warnings, which are not listed";

/// Notes on a scene that could be read all the same: what was guessed, replaced or left out.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// The layout that was recognised (`HM3D`, `glTF` …); empty before.
    pub layout: &'static str,
    /// The file with the navigation mesh that lies beside the scene.
    pub navmesh: Option<PathBuf>,
    /// One sentence each, in the order in which they came up; none twice, at most 100 and a last one that says so.
    pub warnings: Vec<String>,
}

impl Report {
    /// Adds a warning unless it is there already.
    pub fn warn(&mut self, text: impl Into<String>) {
        let text = text.into();
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
    fn a_warning_is_kept_once_and_a_flood_is_cut() {
        let mut report = Report::default();
        ["a", "b", "a"].into_iter().for_each(|text| report.warn(text));
        assert_eq!(report.warnings, ["a", "b"]);
        (0..1000).for_each(|number| report.warn(format!("warning {number}")));
        assert_eq!(report.warnings.len(), MAX_WARNINGS + 1);
        assert_eq!(report.warnings[MAX_WARNINGS - 1], "warning 97");
        assert_eq!(report.warnings[MAX_WARNINGS], MORE);
    }
}
