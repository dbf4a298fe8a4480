//! Checks a run by its log: chain, signature, every state and every metric.

use crate::output::say;
use avln_arena::{
    Failure, FailureKind, Replayer,
    data::DataFolder,
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

/// What to check.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// The log of a run: DATA/runs/RUN.log, or what the server gives out at /api/v1/runs/RUN/log
    #[arg(value_name = "LOG")]
    pub file: PathBuf,
    /// Public key of the server that signed it, hexadecimal, as /api/v1/status tells it in log_key; by default any signature
    /// that fits is taken, and its key told
    #[arg(long, value_name = "KEY")]
    pub key: Option<String>,
    /// Check lines and signature only, which takes nothing but the file; so it is where the data folder holds no database
    #[arg(long)]
    pub log_only: bool,
}

/// Checks the log's chain and signature, plays every episode again and computes every metric again.
///
/// # Errors
/// When the log is not as the server wrote it, or an episode leads elsewhere or is worth something else.
pub async fn run(data: &Path, options: Options) -> Result<(), Failure> {
    let history = History::read(&options.file).map_err(refused)?;
    let key = check_signature(&history, options.key.as_deref())?;
    let wrong =
        |(line, what): (usize, String)| refused(format!("{}, line {line}: {what}", options.file.display()));
    let episodes = history.episodes().map_err(wrong)?;
    let Some(Entry::Run { run, phase, order, digests, .. }) = history.entries.first() else {
        return Err(refused(format!("{} is empty", options.file.display())));
    };
    let why_not = match (options.log_only, data.join("avln.db").is_file()) {
        (true, _) => Some("as asked for".to_owned()),
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
    match (&key, &options.key) {
        (None, _) => say!("signature  none: the run is not over"),
        (Some(key), Some(_)) => say!("signature  {key}, as asked for"),
        (Some(key), None) => say!("signature  {key}; whose key that is, the server's /api/v1/status tells"),
    }
    show(&replayed, &episodes);
    Ok(())
}

fn show(replayed: &Result<Replayed, String>, episodes: &BTreeMap<String, EpisodeHistory>) {
    match replayed {
        Ok(Replayed { episodes, actions, scored }) => {
            say!("episodes   {episodes} played again: each of {actions} actions led to the same state");
            say!("metrics    {scored} computed again, bit for bit the same");
        }
        Err(why) => {
            let actions: usize = episodes.values().map(|episode| episode.taken.len()).sum();
            say!("episodes   {} with {actions} actions, not played again: {why}", episodes.len());
            say!("metrics    not computed again");
            say!(
                "What actions led to and were worth can be checked with the organiser's data folder: --data FOLDER"
            );
        }
    }
}

fn refused(what: impl std::fmt::Display) -> Failure {
    Failure::new(FailureKind::Run, what)
}

/// The key under the log, when the run is over. Whoever has the file can make a chain that fits; the signature cannot be made.
fn check_signature(history: &History, wanted: Option<&str>) -> Result<Option<String>, Failure> {
    let is_signature = |entry: &Entry| matches!(entry, Entry::Signed { .. });
    let (key, signature, head) = match history.entries.last() {
        Some(Entry::Signed { head, key, signature }) => (key, signature, head),
        _ if history.entries.iter().any(is_signature) => {
            return Err(refused("lines come after the signature, which nobody signed")
                .hinted("a server signs again what it adds: ask for the log once more"));
        }
        _ => {
            return match wanted {
                None => Ok(None),
                Some(wanted) => Err(refused(format!("the log is not signed, least of all by {wanted}"))
                    .hinted("logs are signed when their run is over; leave --key away to check an open one")),
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

/// What was played again.
#[derive(Default)]
struct Replayed {
    episodes: usize,
    actions: usize,
    scored: usize,
}

/// Plays all episodes again, as many at a time as there are cores.
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
            done.actions += history.taken.len();
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
