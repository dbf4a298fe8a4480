//! Counts over a folder of traces: the visual support of every claim.

use super::TraceError;
use serde_json::Value;
use std::path::Path;
use std::{fmt, fs};

/// Claims in the traces of a folder.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TraceSummary {
    /// Trace files.
    pub episodes: u32,
    /// Submits.
    pub submits: u32,
    /// Stops.
    pub stops: u32,
    /// Submits and Stops without a look of the current frame at the candidate.
    pub unverified: u32,
    /// Submits and Stops with s_vis of the fresh look below the floor.
    pub below_floor: u32,
}

impl fmt::Display for TraceSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { episodes, submits, stops, unverified, below_floor } = self;
        writeln!(f, "episodes: {episodes}\nSubmits: {submits}\nStops: {stops}")?;
        writeln!(f, "Submits and Stops without a fresh look: {unverified}")?;
        write!(f, "Submits and Stops with s_vis below the floor: {below_floor}")
    }
}

/// Counts the claims in all traces in a folder and its subfolders; fails if a file is not a trace.
pub fn summarise(folder: &Path) -> Result<TraceSummary, TraceError> {
    let mut summary = TraceSummary::default();
    add_folder(folder, &mut summary)?;
    Ok(summary)
}

fn add_folder(folder: &Path, summary: &mut TraceSummary) -> Result<(), TraceError> {
    let failed = |problem: String| TraceError::Unreadable { path: folder.to_owned(), problem };
    for entry in fs::read_dir(folder).map_err(|error| failed(error.to_string()))? {
        let path = entry.map_err(|error| failed(error.to_string()))?.path();
        if path.is_dir() {
            add_folder(&path, summary)?;
        } else if path.extension().is_some_and(|extension| extension == "jsonl") {
            add_trace(&path, summary).map_err(|problem| TraceError::Unreadable { path, problem })?;
        }
    }
    Ok(())
}

fn add_trace(path: &Path, summary: &mut TraceSummary) -> Result<(), String> {
    let text = fs::read_to_string(path).map_err(|error| error.to_string())?;
    summary.episodes += 1;
    let mut floor = None;
    for (number, line) in (1..).zip(text.lines()) {
        let line: Value = serde_json::from_str(line).map_err(|error| format!("line {number}: {error}"))?;
        floor = line["weights"]["verify_floor"].as_f64().or(floor);
        match line["action"].as_str() {
            Some("Submit") => summary.submits += 1,
            Some("Stop") => summary.stops += 1,
            _ => continue,
        }
        // The look itself, not the verification, which exists above the floor only.
        match (line["gate"]["fresh_vis"].as_f64(), floor) {
            (Some(vis), Some(floor)) => summary.below_floor += u32::from(vis < floor),
            _ => summary.unverified += 1,
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn claims_are_counted_by_support() {
        let folder = tempfile::tempdir().unwrap();
        let claim = |action: &str, vis: &str| {
            format!("{{\"kind\":\"step\",\"action\":\"{action}\",\"gate\":{{\"fresh_vis\":{vis}}}}}\n")
        };
        let text = "{\"kind\":\"mission\",\"weights\":{\"verify_floor\":0.25}}\n".to_owned()
            + &claim("Submit", "0.5")
            + &claim("MoveForward", "null")
            + &claim("Submit", "0.2")
            + &claim("Stop", "null");
        fs::create_dir(folder.path().join("inner")).unwrap();
        fs::write(folder.path().join("inner/e.jsonl"), text).unwrap();
        fs::write(folder.path().join("notes.txt"), "no trace").unwrap();
        let expected = TraceSummary { episodes: 1, submits: 2, stops: 1, unverified: 1, below_floor: 1 };
        let summary = summarise(folder.path()).unwrap();
        assert_eq!(summary, expected);
        assert!(summary.to_string().ends_with("below the floor: 1"));
    }

    #[test]
    fn broken_traces_are_named() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("e.jsonl"), "{}\n{").unwrap();
        let error = summarise(folder.path()).unwrap_err().to_string();
        assert!(error.contains("e.jsonl: line 2"), "{error}");
        assert!(summarise(&folder.path().join("absent")).is_err());
    }
}
