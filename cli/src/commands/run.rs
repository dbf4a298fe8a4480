//! Verification and rescoring of runs.

use crate::output::{counted, print_json, processors, say};
use avln_arena::{
    Failure,
    data::DataFolder,
    now_unix_ms,
    replays::{Comparison, Replayer, Scorer, check_complete, rescore},
    runlog::{Entry, EpisodeHistory, History, is_signed},
};
use avln_scoring::{Key, Metrics, Summary};
use avln_store::Run;
use indicatif::ProgressBar;
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::Mutex,
    thread,
};

#[derive(Clone, Debug, clap::Args)]
pub(crate) struct VerifyArgs {
    /// Run log: DATA/runs/RUN.log, or a download from /api/v1/runs/RUN/log
    #[arg(value_name = "LOG")]
    file: PathBuf,
    /// Expected public server key, hexadecimal, as log_key in /api/v1/status; by default any valid signature
    /// is accepted and the key printed
    #[arg(long, value_name = "KEY")]
    key: Option<String>,
    /// Check only the hash chain and the signature, which needs no data folder; the default if the data folder has no database
    #[arg(long)]
    log_only: bool,
}

/// Checks the hash chain, the server starts and the signature, replays all episodes, recomputes all metrics and compares the log
/// with the database.
pub(crate) async fn verify(data: &Path, args: VerifyArgs) -> Result<(), Failure> {
    let history = History::read(&args.file).map_err(Failure::run)?;
    let key = check_signature(&history, args.key.as_deref())?;
    let wrong =
        |(line, what): (usize, String)| Failure::run(format!("{}, line {line}: {what}", args.file.display()));
    history.check_epochs().map_err(wrong)?;
    let episodes = history.episodes().map_err(wrong)?;
    let Some(Entry::Run { run, phase, order, digests, .. }) = history.entries.first() else {
        return Err(Failure::run(format!("{} is empty", args.file.display())));
    };
    // A participant without the data folder can still verify chain and signature.
    let why_not = match (args.log_only, data.join("avln.db").is_file()) {
        (true, _) => Some("as requested".to_owned()),
        (false, false) => Some(format!("there is no data folder at {}", data.display())),
        (false, true) => None,
    };
    let replayed = match why_not {
        Some(why) => Err(why),
        None => {
            let data = DataFolder::open(data)?;
            let replayer = Replayer::open(&data, phase, *order).await?;
            replayer.check_digests(digests)?;
            let replayed = replay_all(&replayer, &episodes)?;
            check_complete(&data, run, &episodes, key.is_some()).await?;
            Ok(replayed)
        }
    };
    say!("run        {run}");
    print_lines(history.entries.len(), key.as_deref(), args.key.is_some());
    print_replayed(&replayed, &episodes);
    if key.is_some() {
        return Ok(());
    }
    Err(Failure::unproven("the log has no signature, so its completeness is unproven")
        .hinted("a server signs a log at the end of the run: check it then, with --key KEY"))
}

fn print_lines(lines: usize, key: Option<&str>, is_expected: bool) {
    let Some(key) = key else {
        say!("lines      {lines}, none changed or put in; lines may be missing at the end");
        say!("signature  none: the run is still open, or the end is missing");
        return;
    };
    say!("lines      {lines}, none changed, left out or put in");
    if is_expected {
        say!("signature  {key}, as expected");
    } else {
        say!("signature  {key}; compare it with log_key in the server's /api/v1/status");
    }
}

fn print_replayed(replayed: &Result<Replayed, String>, episodes: &BTreeMap<String, EpisodeHistory>) {
    match replayed {
        Ok(Replayed { episodes, actions, scored }) => {
            say!("episodes   {episodes} played again: all {actions} actions led to the recorded states");
            say!("metrics    {scored} recomputed, identical bit for bit");
        }
        Err(why) => {
            let actions: usize = episodes.values().map(|episode| episode.actions.len()).sum();
            say!("episodes   {} with {actions} actions, not played again: {why}", episodes.len());
            say!("metrics    not recomputed");
            say!("States and metrics can be checked with the organiser's data folder: --data FOLDER");
        }
    }
}

/// Returns the key that signed the log; `None` for a log without a signature.
fn check_signature(history: &History, wanted: Option<&str>) -> Result<Option<String>, Failure> {
    let is_signature = |entry: &Entry| matches!(entry, Entry::Signed { .. });
    let (key, signature, head) = match history.entries.last() {
        Some(Entry::Signed { head, key, signature }) => (key, signature, head),
        _ if history.entries.iter().any(is_signature) => {
            return Err(Failure::run("lines come after the signature, so they are not signed")
                .hinted("a server signs lines that it adds: download the log again"));
        }
        _ => {
            return match wanted {
                None => Ok(None),
                Some(wanted) => Err(Failure::run(format!("the log is not signed by {wanted}")).hinted(
                    "logs are signed at the end of the run; omit --key to check the log of an open run",
                )),
            };
        }
    };
    if !is_signed(key, head, signature) {
        return Err(Failure::run(
            "the signature does not fit the log: it was not written by the server of that key",
        ));
    }
    match wanted.filter(|wanted| wanted != key) {
        Some(wanted) => Err(Failure::run(format!("the log is signed by {key}, not by {wanted}"))),
        None => Ok(Some(key.clone())),
    }
}

#[derive(Default)]
struct Replayed {
    episodes: usize,
    actions: usize,
    scored: usize,
}

fn replay_all(replayer: &Replayer, episodes: &BTreeMap<String, EpisodeHistory>) -> Result<Replayed, Failure> {
    let bar = ProgressBar::new(episodes.len() as u64);
    let left = Mutex::new(episodes.iter());
    let next = || left.lock().ok().and_then(|mut left| left.next());
    let work = || {
        let mut done = Replayed::default();
        while let Some((handle, history)) = next() {
            let metrics =
                replayer.replay(history).map_err(|why| Failure::run(format!("episode {handle}: {why}")))?;
            done.episodes += 1;
            done.actions += history.actions.len();
            done.scored += usize::from(metrics.is_some());
            check_metrics(handle, history, metrics.as_ref())?;
            bar.inc(1);
        }
        Ok(done)
    };
    let parts: Vec<Result<Replayed, Failure>> = thread::scope(|scope| {
        let workers: Vec<_> = (0..processors()).map(|_| scope.spawn(work)).collect();
        let lost = |_| Err(Failure::internal("a thread panicked"));
        workers.into_iter().map(|worker| worker.join().unwrap_or_else(lost)).collect()
    });
    bar.finish_and_clear();
    parts.into_iter().try_fold(Replayed::default(), |all, part| {
        let part = part?;
        Ok(Replayed {
            episodes: all.episodes + part.episodes,
            actions: all.actions + part.actions,
            scored: all.scored + part.scored,
        })
    })
}

fn check_metrics(handle: &str, history: &EpisodeHistory, again: Option<&Metrics>) -> Result<(), Failure> {
    let (Some((_, recorded)), Some(again)) = (&history.ended, again) else { return Ok(()) };
    let text = |metrics: &Metrics| serde_json::to_string(metrics).map_err(Failure::internal);
    let (recorded, again) = (text(recorded)?, text(again)?);
    if recorded == again {
        return Ok(());
    }
    Err(Failure::run(format!("episode {handle}: the log contains {recorded}, the replay gives {again}")))
}

#[derive(Clone, Debug, clap::Args)]
#[command(group(clap::ArgGroup::new("which").required(true).args(["run", "phase"])))]
pub(crate) struct RescoreArgs {
    /// Run id
    #[arg(value_name = "RUN")]
    run: Option<String>,
    /// Phase id, for all completed runs
    #[arg(long, value_name = "PHASE")]
    phase: Option<String>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Scores runs with this build's scorer and stores the new scores next to the old ones.
pub(crate) async fn rescore_runs(data: &Path, args: RescoreArgs) -> Result<(), Failure> {
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
        comparisons.iter().for_each(print_comparison);
        say!("{} scored by benchmark {}", counted(comparisons.len(), "run"), Scorer::OURS.version);
    }
    match comparisons.iter().find(|comparison| comparison.contradicts()) {
        Some(Comparison { run, scorer_before, .. }) => Err(Failure::run(format!("run {run} was scored by benchmark {scorer_before}, but this build of {scorer_before} computes other scores"),
        )
        .hinted("the scorer was changed without a new version, or the database was edited")),
        None => Ok(()),
    }
}

fn print_comparison(comparison: &Comparison) {
    let Comparison { run, method, scorer_before, scorer_after, episodes, changed, .. } = comparison;
    say!("{run}  {method}  {}", counted(*episodes, "episode"));
    if changed.is_empty() {
        say!("  nothing changed: {scorer_after} and {scorer_before} agree on all episodes\n");
        return;
    }
    say!("  {:<24} {:>12} {:>12} {:>12}", "mean", scorer_before, scorer_after, "change");
    if let (Some(before), Some(after)) = (&comparison.before, &comparison.after) {
        Key::ALL.into_iter().for_each(|key| print_mean(key, before, after));
    }
    let kept = if comparison.is_kept { "both are kept" } else { "nothing was stored" };
    say!("  {} with other scores; {kept}\n", counted(changed.len(), "episode"));
}

fn print_mean(key: Key, before: &Summary, after: &Summary) {
    let (before, after) = (key.mean_of(before), key.mean_of(after));
    let change = if before == after { String::new() } else { format!("{:+.6}", after - before) };
    say!("  {:<24} {before:>12.6} {after:>12.6} {change:>12}", key.to_string());
}
