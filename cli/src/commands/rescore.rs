//! Scores runs again and shows what changed.

use crate::output::say;
use avln_arena::{
    Failure, FailureKind,
    data::DataFolder,
    now_unix_ms,
    rescoring::{Comparison, Scorer, rescore},
};
use avln_scoring::{Key, Summary};
use avln_store::Run;
use std::path::Path;

/// Which runs.
#[derive(Clone, Debug, clap::Args)]
#[command(group(clap::ArgGroup::new("which").required(true).args(["run", "phase"])))]
pub struct Options {
    /// Id of the run
    #[arg(value_name = "RUN")]
    pub run: Option<String>,
    /// All completed runs of a phase
    #[arg(long, value_name = "PHASE")]
    pub phase: Option<String>,
    /// As JSON
    #[arg(long)]
    pub json: bool,
}

/// Scores the runs again with the scorer of this build; the first scores stay.
///
/// # Errors
/// When a run is unknown, its records were pruned, or this build's scorer contradicts what the same version said before.
pub async fn run(data: &Path, options: Options) -> Result<(), Failure> {
    let store = DataFolder::open(data)?.store().await?;
    let runs: Vec<Run> = match (&options.run, &options.phase) {
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
    if options.json {
        let json = serde_json::to_string_pretty(&comparisons);
        say!("{}", json.map_err(|error| Failure::new(FailureKind::Internal, error))?);
    } else {
        comparisons.iter().for_each(show);
        say!("{} scored by benchmark {}", plural(comparisons.len(), "run"), Scorer::OURS.version);
    }
    match comparisons.iter().find(|comparison| comparison.contradicts()) {
        Some(Comparison { run, scorer_before, .. }) => Err(Failure::new(
            FailureKind::Run,
            format!("run {run} was scored by benchmark {scorer_before}, and this build of {scorer_before} scores it otherwise"),
        )
        .hinted("this build's scorer is not the one that its version names, or the database was changed by hand")),
        None => Ok(()),
    }
}

fn plural(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

fn show(comparison: &Comparison) {
    let Comparison { run, method, scorer_before, scorer_after, episodes, changed, .. } = comparison;
    say!("{run}  {method}  {}", plural(*episodes, "episode"));
    if changed.is_empty() {
        say!("  nothing changed: {scorer_after} gives each episode what {scorer_before} gave it\n");
        return;
    }
    say!("  {:<24} {:>12} {:>12} {:>12}", "mean", scorer_before, scorer_after, "change");
    if let (Some(before), Some(after)) = (&comparison.before, &comparison.after) {
        Key::ALL.into_iter().for_each(|key| show_mean(key, before, after));
    }
    let kept = if comparison.is_kept { "both are kept" } else { "nothing was stored" };
    say!("  {} worth something else; {kept}\n", plural(changed.len(), "episode"));
}

fn show_mean(key: Key, before: &Summary, after: &Summary) {
    let (before, after) = (key.mean_of(before), key.mean_of(after));
    let change = if before == after { String::new() } else { format!("{:+.6}", after - before) };
    say!("  {:<24} {before:>12.6} {after:>12.6} {change:>12}", key.to_string());
}
