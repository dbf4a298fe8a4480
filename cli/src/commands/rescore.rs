//! Rescoring of runs with the scorer of this build.

use crate::output::{counted, print_json, say};
use avln_arena::{
    Failure, FailureKind,
    data::DataFolder,
    now_unix_ms,
    rescoring::{Comparison, Scorer, rescore},
};
use avln_scoring::{Key, Summary};
use avln_store::Run;
use std::path::Path;

/// Arguments of `avln run rescore`.
#[derive(Clone, Debug, clap::Args)]
#[command(group(clap::ArgGroup::new("which").required(true).args(["run", "phase"])))]
pub struct RescoreArgs {
    /// Id of the run
    #[arg(value_name = "RUN")]
    pub run: Option<String>,
    /// Id of a phase: all of its completed runs
    #[arg(long, value_name = "PHASE")]
    pub phase: Option<String>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// Scores runs again with the scorer of this build and keeps both scores.
///
/// # Errors
/// If a run is unknown, its records were pruned, or the scorer contradicts earlier scores of the same version.
pub async fn run(data: &Path, args: RescoreArgs) -> Result<(), Failure> {
    let store = DataFolder::open(data)?.store().await?;
    let runs: Vec<Run> = match (&args.run, &args.phase) {
        (Some(run), _) => vec![store.run(run).await?],
        (None, Some(phase)) => {
            store.phase(phase).await?;
            store.completed_runs(phase).await?
        }
        (None, None) => vec![],
    };
    let mut comparisons = Vec::with_capacity(runs.len());
    for run in &runs {
        comparisons.push(rescore(&store, run, &Scorer::OURS, now_unix_ms()).await?);
    }
    store.close().await;
    if args.json {
        print_json(&comparisons)?;
    } else {
        comparisons.iter().for_each(show);
        say!("{} scored by benchmark {}", counted(comparisons.len(), "run"), Scorer::OURS.version);
    }
    match comparisons.iter().find(|comparison| comparison.contradicts()) {
        Some(Comparison { run, scorer_before, .. }) => Err(Failure::new(
            FailureKind::Run,
            format!("run {run} was scored by benchmark {scorer_before}, but this build of {scorer_before} gives other scores"),
        )
        .hinted("the scorer was changed without a new version, or the database was edited")),
        None => Ok(()),
    }
}

fn show(comparison: &Comparison) {
    let Comparison { run, method, scorer_before, scorer_after, episodes, changed, .. } = comparison;
    say!("{run}  {method}  {}", counted(*episodes, "episode"));
    if changed.is_empty() {
        say!("  nothing changed: {scorer_after} and {scorer_before} agree on all episodes\n");
        return;
    }
    say!("  {:<24} {:>12} {:>12} {:>12}", "mean", scorer_before, scorer_after, "change");
    if let (Some(before), Some(after)) = (&comparison.before, &comparison.after) {
        Key::ALL.into_iter().for_each(|key| show_mean(key, before, after));
    }
    let kept = if comparison.is_kept { "both are kept" } else { "nothing was stored" };
    say!("  {} with other scores; {kept}\n", counted(changed.len(), "episode"));
}

fn show_mean(key: Key, before: &Summary, after: &Summary) {
    let (before, after) = (key.mean_of(before), key.mean_of(after));
    let change = if before == after { String::new() } else { format!("{:+.6}", after - before) };
    say!("  {:<24} {before:>12.6} {after:>12.6} {change:>12}", key.to_string());
}
