//! The results as a CSV table, and joining the results of several machines.

use super::host::{lock, results_path};
use super::results::{Results, read};
use super::{Cause, EpisodeKey, MissionFacts, ResultLine};
use avln_arena::{Failure, FailureKind};
use avln_episode::Order;
use avln_scoring::{EpisodeValue, METRICS, Metric, Metrics};
use csv::{ReaderBuilder, StringRecord, Writer};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use std::fmt::Display;
use std::fs;
use std::path::{Path, PathBuf};

/// Separator inside a cell.
const AND: &str = "+";
/// Missing value inside a list.
const NONE: &str = "-";

/// Returns a header, and a row per result. Numbers have all digits: reading a table gives equal results.
pub(super) fn to_csv(lines: &[&ResultLine]) -> String {
    let mut table = Writer::from_writer(Vec::new());
    // Writing to memory cannot fail.
    let _ = table.write_record(header());
    for line in lines {
        let _ = table.write_record(cells(line));
    }
    table.into_inner().ok().and_then(|bytes| String::from_utf8(bytes).ok()).unwrap_or_default()
}

/// Reads a table.
///
/// # Errors
/// If a column is missing or a cell has no valid value.
pub(super) fn from_csv(path: &Path, text: &str) -> Result<Vec<ResultLine>, Failure> {
    let mut table = ReaderBuilder::new().from_reader(text.as_bytes());
    let malformed = |error| Failure::new(FailureKind::Data, format!("{}: {error}", path.display()));
    let header = table.headers().map_err(malformed)?.clone();
    let row = |(number, record): (usize, csv::Result<StringRecord>)| {
        Row { path, number, header: &header, record: &record.map_err(malformed)? }.result()
    };
    (2..).zip(table.records()).map(row).collect()
}

fn header() -> Vec<String> {
    let before = ["track", "feedback", "agent", "order", "episode", "scene"];
    let ids = columns().map(|metric| metric.id);
    let mission =
        ["modalities", "steps_to_goals", "final_distances_m", "reference_steps", "storeys", "area_m2", "end"];
    let names = before.into_iter().chain(ids).chain(mission).map(str::to_owned);
    let after =
        ["think_ms", "wall_s", "rules", "side_px", "seed", "program", "benchmark", "split", "split_seed"];
    names.chain(Cause::ALL.map(cause_column)).chain(after.map(str::to_owned)).collect()
}

/// Iterates over the metrics with a number per episode.
fn columns() -> impl Iterator<Item = &'static Metric> {
    METRICS.iter().filter(|metric| matches!(metric.episode, EpisodeValue::Number(_)))
}

fn cause_column(cause: Cause) -> String {
    format!("submits_{}", cause.words().replace(' ', "_"))
}

fn cells(line: &ResultLine) -> Vec<String> {
    let ResultLine { key, scene, metrics, mission, .. } = line;
    let mut cells =
        [&key.track, &key.feedback, &key.agent, &key.order, &key.episode, scene].map(String::clone).to_vec();
    cells.extend(columns().filter_map(|metric| metric.of(metrics)).map(|value| value.to_string()));
    cells.push(list(line.modalities.iter().map(|modality| Some(modality.as_str()))));
    cells.push(list(metrics.steps_to_goal.iter().copied()));
    cells.push(list(metrics.final_distance_m.iter().copied()));
    cells.extend([mission.reference_steps, mission.storeys].map(|count| count.to_string()));
    cells.extend([mission.area_m2.to_string(), line.end.as_str().to_owned()]);
    cells.extend(Cause::ALL.map(|cause| line.wrong.get(&cause).copied().unwrap_or(0).to_string()));
    cells.extend([line.think_ms, line.wall_s].map(|time| format!("{time:.3}")));
    cells.extend([key.rules.clone(), key.side_px.to_string(), key.seed.to_string()]);
    cells.extend([&key.program, &key.benchmark, &key.split].map(String::clone));
    cells.push(key.split_seed.map_or_else(String::new, |seed| seed.to_string()));
    cells
}

fn list<T: Display>(values: impl Iterator<Item = Option<T>>) -> String {
    let cells = values.map(|value| value.map_or_else(|| NONE.to_owned(), |value| value.to_string()));
    cells.collect::<Vec<_>>().join(AND)
}

/// A row of a table.
struct Row<'a> {
    path: &'a Path,
    number: usize,
    header: &'a StringRecord,
    record: &'a StringRecord,
}

impl Row<'_> {
    fn result(&self) -> Result<ResultLine, Failure> {
        let mission = MissionFacts {
            reference_steps: self.number("reference_steps")?,
            storeys: self.number("storeys")?,
            area_m2: self.number("area_m2")?,
        };
        let count = |cause| Ok((cause, self.number(&cause_column(cause))?));
        let counts = Cause::ALL.map(count).into_iter().collect::<Result<Vec<(Cause, u32)>, Failure>>()?;
        let modalities = self.text("modalities")?.split(AND);
        let modality = |name: &str| self.value("modalities", Value::from(name));
        Ok(ResultLine {
            key: self.key()?,
            scene: self.text("scene")?.to_owned(),
            mission,
            modalities: modalities.map(modality).collect::<Result<_, _>>()?,
            end: self.value("end", Value::from(self.text("end")?))?,
            metrics: self.metrics()?,
            wrong: counts.into_iter().filter(|(_, count)| *count > 0).collect(),
            think_ms: self.number("think_ms")?,
            wall_s: self.number("wall_s")?,
        })
    }

    fn key(&self) -> Result<EpisodeKey, Failure> {
        let text = |column| self.text(column).map(str::to_owned);
        Ok(EpisodeKey {
            agent: text("agent")?,
            order: self.value::<Order>("order", Value::from(self.text("order")?))?.as_str().to_owned(),
            episode: text("episode")?,
            seed: self.number("seed")?,
            program: text("program")?,
            benchmark: text("benchmark")?,
            split: text("split")?,
            track: text("track")?,
            rules: text("rules")?,
            feedback: text("feedback")?,
            side_px: self.number("side_px")?,
            split_seed: match self.text("split_seed")? {
                "" => None,
                seed => Some(self.parsed("split_seed", seed)?),
            },
        })
    }

    fn metrics(&self) -> Result<Metrics, Failure> {
        let mut fields = Map::new();
        for metric in columns() {
            fields.insert(metric.id.to_owned(), self.number(metric.id)?);
        }
        fields.insert("steps_to_goal".to_owned(), self.numbers("steps_to_goals")?);
        fields.insert("final_distance_m".to_owned(), self.numbers("final_distances_m")?);
        self.value("metrics", Value::Object(fields))
    }

    fn numbers(&self, column: &str) -> Result<Value, Failure> {
        let cell = self.text(column)?;
        let cells = cell.split(AND).filter(|cell| !cell.is_empty());
        let number = |cell: &str| if cell == NONE { Ok(Value::Null) } else { self.parsed(column, cell) };
        cells.map(number).collect()
    }

    fn number<T: DeserializeOwned>(&self, column: &str) -> Result<T, Failure> {
        self.parsed(column, self.text(column)?)
    }

    fn parsed<T: DeserializeOwned>(&self, column: &str, cell: &str) -> Result<T, Failure> {
        serde_json::from_str(cell).map_err(|error| self.failure(column, error))
    }

    fn value<T: DeserializeOwned>(&self, column: &str, value: impl Serialize) -> Result<T, Failure> {
        let value = serde_json::to_value(value).and_then(serde_json::from_value);
        value.map_err(|error| self.failure(column, error))
    }

    fn text(&self, column: &str) -> Result<&str, Failure> {
        let index = self.header.iter().position(|name| name == column);
        let cell = index.and_then(|index| self.record.get(index));
        cell.ok_or_else(|| {
            let Self { path, number, .. } = self;
            let message = format!("{}, line {number}: the column {column} is missing", path.display());
            Failure::new(FailureKind::Data, message).hinted("merge a table that this version has written")
        })
    }

    fn failure(&self, column: &str, error: impl Display) -> Failure {
        let Self { path, number, .. } = self;
        let message = format!("{}, line {number}, column {column}: {error}", path.display());
        Failure::new(FailureKind::Data, message).hinted("delete the line to play the episode again")
    }
}

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
    use crate::suite::results::samples::line;
    use avln_episode::Order;

    fn sample() -> ResultLine {
        let mut sample = line("random", Order::Ordered, 3, 1);
        sample.metrics.isr = 1.0 / 3.0;
        sample.metrics.final_distance_m = vec![Some(0.1 + 0.2), None];
        sample.wrong.insert(Cause::TooFar, 2);
        sample
    }

    #[test]
    fn tables_keep_results_exactly() {
        let lines = [sample(), line("sound-follower", Order::Unordered, 4, 2)];
        let text = to_csv(&lines.iter().collect::<Vec<_>>());
        assert!(text.starts_with("track,feedback,agent,order,episode,scene,goals,found,sr,"), "{text}");
        assert_eq!(from_csv(Path::new("results.csv"), &text).expect("results"), lines);
    }

    #[test]
    fn malformed_cells_name_line_and_column() {
        let text = to_csv(&[&sample()]).replace("stopped", "finished");
        let refused = from_csv(Path::new("results.csv"), &text).expect_err("an unknown end").to_string();
        assert!(refused.contains("results.csv, line 2, column end"), "{refused}");
        let text = to_csv(&[&sample()]).replace(",ordered,", ",sorted,");
        let refused = from_csv(Path::new("results.csv"), &text).expect_err("an unknown order").to_string();
        assert!(refused.contains("results.csv, line 2, column order"), "{refused}");
        let text = to_csv(&[&sample()]).replace("think_ms", "thinking");
        let refused = from_csv(Path::new("results.csv"), &text).expect_err("a missing column").to_string();
        assert!(refused.contains("results.csv, line 2: the column think_ms is missing"), "{refused}");
    }

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
