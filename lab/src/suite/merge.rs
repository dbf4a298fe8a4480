//! Joining the results of several machines.

use super::host::{lock, results_path};
use super::results::{ResultLine, Results, read};
use super::table::from_csv;
use avln_arena::{Failure, FailureKind};
use std::fs;
use std::path::{Path, PathBuf};

/// Counts of merged results.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MergeTally {
    /// Results that were added.
    pub added: usize,
    /// Results that were there before.
    pub known: usize,
}

/// Adds the results in other suite folders or files to the results in `folder`.
///
/// # Errors
/// If a file cannot be read or written, or two results of the same episode differ.
pub fn merge(folder: &Path, sources: &[PathBuf]) -> Result<MergeTally, Failure> {
    let _lock = lock(folder)?;
    let mut results = Results::open(&results_path(folder))?;
    let mut tally = MergeTally::default();
    for source in sources {
        let file = if source.is_dir() { results_path(source) } else { source.clone() };
        if !file.is_file() {
            let message = format!("there are no results in {}", source.display());
            return Err(Failure::new(FailureKind::Data, message).hinted(
                "name a folder of avln lab baselines run, its results.jsonl, or the results.csv of a report",
            ));
        }
        for line in lines(&file)? {
            match results.get(&line.key) {
                None => {
                    results.add(line)?;
                    tally.added += 1;
                }
                // Only durations may differ between machines.
                Some(known) if known.metrics == line.metrics && known.end == line.end => tally.known += 1,
                Some(_) => return Err(conflict(&file, &line.key.agent, &line.key.episode)),
            }
        }
    }
    Ok(tally)
}

/// Reads a results file, or the CSV table of a report.
fn lines(file: &Path) -> Result<Vec<ResultLine>, Failure> {
    if file.extension().is_none_or(|extension| extension != "csv") {
        return Ok(read(file)?.into_values().collect());
    }
    let text = fs::read_to_string(file).map_err(|error| Failure::file("read", file, error))?;
    from_csv(file, &text)
}

fn conflict(file: &Path, agent: &str, episode: &str) -> Failure {
    let message = format!("{}: another result of {agent} in episode {episode} is known", file.display());
    Failure::new(FailureKind::Data, message)
        .hinted("play the episode again with one program, and delete the other line")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::suite::samples::line;
    use crate::suite::table::to_csv;
    use avln_episode::Order;

    /// Writes results into a new suite folder.
    fn folder(root: &Path, name: &str, episodes: &[(u32, u32)]) -> PathBuf {
        let folder = root.join(name);
        fs::create_dir_all(&folder).expect("a folder");
        let mut results = Results::open(&results_path(&folder)).expect("results");
        for &(episode, found) in episodes {
            results.add(line("random", Order::Ordered, episode, found)).expect("a line");
        }
        folder
    }

    #[test]
    fn merged_shards_contain_every_result_once() {
        let root = tempfile::tempdir().expect("a folder");
        let (a, b) =
            (folder(root.path(), "a", &[(0, 1), (2, 2)]), folder(root.path(), "b", &[(1, 0), (2, 2)]));
        let tally = merge(&root.path().join("all"), &[a, b.join("results.jsonl")]).expect("merged");
        assert_eq!(tally, MergeTally { added: 3, known: 1 });
        assert_eq!(read(&results_path(&root.path().join("all"))).expect("results").len(), 3);
    }

    #[test]
    fn published_tables_continue_a_suite() {
        let root = tempfile::tempdir().expect("a folder");
        let table = root.path().join("results.csv");
        let published = [line("random", Order::Ordered, 0, 1), line("random", Order::Ordered, 2, 2)];
        fs::write(&table, to_csv(&published.iter().collect::<Vec<_>>())).expect("a table");
        let suite = folder(root.path(), "a", &[(0, 1)]);
        assert_eq!(merge(&suite, &[table]).expect("merged"), MergeTally { added: 1, known: 1 });
        assert_eq!(read(&results_path(&suite)).expect("results")[&published[1].key], published[1]);
    }

    #[test]
    fn different_results_of_an_episode_are_refused() {
        let root = tempfile::tempdir().expect("a folder");
        let (a, b) = (folder(root.path(), "a", &[(0, 1)]), folder(root.path(), "b", &[(0, 2)]));
        let refused = merge(&a, &[b]).expect_err("a conflict").to_string();
        assert!(refused.contains("another result of random in episode"), "{refused}");
        assert!(merge(&a, &[root.path().join("none")]).is_err());
    }
}
