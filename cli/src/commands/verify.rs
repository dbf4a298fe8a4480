//! Verification of run logs: hash chain, signature, states and metrics.

use crate::output::say;
use avln_arena::{
    Failure, FailureKind,
    data::DataFolder,
    rescoring::Replayer,
    runlog::{Entry, EpisodeHistory, History, is_signed},
};
use avln_scoring::Metrics;
use indicatif::ProgressBar;
use std::{
    collections::BTreeMap,
    num::NonZero,
    path::{Path, PathBuf},
    sync::Mutex,
    thread,
};

/// Arguments of `avln run verify`.
#[derive(Clone, Debug, clap::Args)]
pub struct VerifyArgs {
    /// Run log: DATA/runs/RUN.log, or a download from /api/v1/runs/RUN/log
    #[arg(value_name = "LOG")]
    pub file: PathBuf,
    /// Expected public key of the server, hexadecimal, as log_key in /api/v1/status; by default any valid signature is accepted and
    /// its key printed
    #[arg(long, value_name = "KEY")]
    pub key: Option<String>,
    /// Check only the hash chain and the signature, which needs no data folder; the default if the data folder has no database
    #[arg(long)]
    pub log_only: bool,
}

/// Checks the hash chain and the signature, replays all episodes and recomputes all metrics.
///
/// # Errors
/// If the log was changed, or a replayed state or metric differs.
pub async fn run(data: &Path, args: VerifyArgs) -> Result<(), Failure> {
    let history = History::read(&args.file).map_err(refused)?;
    let key = check_signature(&history, args.key.as_deref())?;
    let wrong =
        |(line, what): (usize, String)| refused(format!("{}, line {line}: {what}", args.file.display()));
    let episodes = history.episodes().map_err(wrong)?;
    let Some(Entry::Run { run, phase, order, digests, .. }) = history.entries.first() else {
        return Err(refused(format!("{} is empty", args.file.display())));
    };
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
            Ok(replay_all(&replayer, &episodes)?)
        }
    };
    say!("run        {run}");
    say!("lines      {}, none changed, left out or put in", history.entries.len());
    match (&key, &args.key) {
        (None, _) => say!("signature  none: the run is still open"),
        (Some(key), Some(_)) => say!("signature  {key}, as expected"),
        (Some(key), None) => say!("signature  {key}; compare it with log_key in the server's /api/v1/status"),
    }
    show(&replayed, &episodes);
    Ok(())
}

fn show(replayed: &Result<Replayed, String>, episodes: &BTreeMap<String, EpisodeHistory>) {
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

fn refused(what: impl std::fmt::Display) -> Failure {
    Failure::new(FailureKind::Run, what)
}

/// Returns the key that signed the log; `None` for a log without a signature.
fn check_signature(history: &History, wanted: Option<&str>) -> Result<Option<String>, Failure> {
    let is_signature = |entry: &Entry| matches!(entry, Entry::Signed { .. });
    let (key, signature, head) = match history.entries.last() {
        Some(Entry::Signed { head, key, signature }) => (key, signature, head),
        _ if history.entries.iter().any(is_signature) => {
            return Err(refused("lines come after the signature, so they are not signed")
                .hinted("a server signs lines that it adds: download the log again"));
        }
        _ => {
            return match wanted {
                None => Ok(None),
                Some(wanted) => Err(refused(format!("the log is not signed by {wanted}")).hinted(
                    "logs are signed at the end of the run; omit --key to check the log of an open run",
                )),
            };
        }
    };
    if !is_signed(key, head, signature) {
        return Err(refused(
            "the signature does not fit the log: it was not written by the server of that key",
        ));
    }
    match wanted.filter(|wanted| wanted != key) {
        Some(wanted) => Err(refused(format!("the log is signed by {key}, not by {wanted}"))),
        None => Ok(Some(key.clone())),
    }
}

/// Numbers of replayed and rescored items.
#[derive(Default)]
struct Replayed {
    episodes: usize,
    actions: usize,
    scored: usize,
}

/// Replays all episodes, one per core in parallel.
fn replay_all(replayer: &Replayer, episodes: &BTreeMap<String, EpisodeHistory>) -> Result<Replayed, Failure> {
    let bar = ProgressBar::new(episodes.len() as u64);
    let left = Mutex::new(episodes.iter());
    let next = || left.lock().ok().and_then(|mut left| left.next());
    let work = || {
        let mut done = Replayed::default();
        while let Some((handle, history)) = next() {
            let metrics =
                replayer.replay(history).map_err(|why| refused(format!("episode {handle}: {why}")))?;
            done.episodes += 1;
            done.actions += history.actions.len();
            done.scored += usize::from(metrics.is_some());
            check_metrics(handle, history, metrics.as_ref())?;
            bar.inc(1);
        }
        Ok(done)
    };
    let cores = thread::available_parallelism().map_or(1, NonZero::get);
    let parts: Vec<Result<Replayed, Failure>> = thread::scope(|scope| {
        let workers: Vec<_> = (0..cores).map(|_| scope.spawn(work)).collect();
        let lost = |_| Err(Failure::new(FailureKind::Internal, "a thread broke down"));
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
    let text = |metrics: &Metrics| {
        serde_json::to_string(metrics).map_err(|error| Failure::new(FailureKind::Internal, error))
    };
    let (recorded, again) = (text(recorded)?, text(again)?);
    if recorded == again {
        return Ok(());
    }
    Err(refused(format!("episode {handle} is recorded as worth {recorded} and is worth {again}")))
}
