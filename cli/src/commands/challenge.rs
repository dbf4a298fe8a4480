//! The challenge file, the audit list, the commitment of hidden phases, and rulings on runs.

use crate::output::{print_json, say};
use avln_arena::{
    Failure,
    actions::{Attribution, disqualify, note, verify},
    challenge::{
        ChallengeChanges, ChallengeFile, Fault, PhaseFile, PlanError, Planner, SummaryStyle, actor,
        json as as_json,
    },
    data::DataFolder,
    dataset::{DatasetFiles, SplitFolder},
    now_unix_ms, seed_to_publish,
};
use avln_dataset::{
    DatasetError,
    format::{File, read_secret},
};
use avln_lab::dataset::build::Builder;
use avln_store::{AuditLine, CommitmentValues, calendar::rfc3339, pool_digest};
use clap::{Args, Subcommand};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::{Path, PathBuf};

#[derive(Debug, Subcommand)]
pub(crate) enum ChallengeFileCommand {
    /// Show the changes that a challenge file would make, or its errors; docs/challenge.toml is an example
    Check {
        /// Challenge file
        file: PathBuf,
        /// Show all settings of new phases
        #[arg(long)]
        verbose: bool,
    },
    /// Create and change phases as in a challenge file; a running server applies them at once
    Apply {
        /// Challenge file
        file: PathBuf,
        /// Reason, for the audit list
        #[arg(long, default_value = "", value_name = "TEXT")]
        reason: String,
        /// Show all settings of new phases
        #[arg(long)]
        verbose: bool,
    },
    /// Print all phases as a challenge file
    Show {
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
    /// Print the audit list: changes with time, actor and reason
    Audit {
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
    /// Publish the committed values of a closed phase: episodes, scorer, and the secret of its draws
    Reveal {
        /// Phase id
        phase: String,
    },
    /// Check the output from `avln challenge reveal` against the commitment
    VerifyReveal(VerifyRevealArgs),
}

#[derive(Clone, Debug, Args)]
pub(crate) struct VerifyRevealArgs {
    /// File with the output from `avln challenge reveal`
    file: PathBuf,
    /// Data set folder, to check the episodes too
    #[arg(long, value_name = "DIR", requires = "split")]
    dataset: Option<PathBuf>,
    /// Split of --dataset
    #[arg(long, requires = "dataset")]
    split: Option<String>,
    /// New folder: rebuild the split there from its published secret, and compare the episodes
    #[arg(long, value_name = "DIR", conflicts_with = "dataset")]
    rebuild: Option<PathBuf>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PublishedCommitment {
    phase: String,
    commitment: String,
    committed_at: String,
    #[serde(flatten)]
    values: PublishedValues,
    /// Secret and recipe of a split without a seed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    seed: Option<Value>,
}

#[derive(Debug, Serialize, Deserialize)]
struct PublishedValues {
    pool: String,
    scorer: String,
    secret: String,
}

pub(crate) async fn run(data: &Path, command: ChallengeFileCommand) -> Result<(), Failure> {
    match command {
        ChallengeFileCommand::Check { file, verbose } => {
            apply(data, &file, "", SummaryStyle { is_applied: false, is_verbose: verbose }).await
        }
        ChallengeFileCommand::Apply { file, reason, verbose } => {
            apply(data, &file, &reason, SummaryStyle { is_applied: true, is_verbose: verbose }).await
        }
        ChallengeFileCommand::Show { json } => show(data, json).await,
        ChallengeFileCommand::Audit { json } => audit(data, json).await,
        ChallengeFileCommand::Reveal { phase } => reveal(data, &phase).await,
        ChallengeFileCommand::VerifyReveal(args) => verify_reveal(&args),
    }
}

async fn apply(data: &Path, path: &Path, reason: &str, style: SummaryStyle) -> Result<(), Failure> {
    let data = DataFolder::open(data)?;
    let store = data.store().await?;
    let base = path.parent().unwrap_or(Path::new(""));
    let planner = Planner { data: &data, store: &store, base, reason };
    let plan = plan(&planner, path).await?;
    let summary = plan.summary(style);
    if style.is_applied {
        planner.apply(plan).await?;
    }
    summary.iter().for_each(|line| say!("{line}"));
    Ok(())
}

/// Largest accepted file, bytes: thousands of phases.
const LARGEST_FILE: u64 = 4 << 20;

async fn plan(planner: &Planner<'_>, path: &Path) -> Result<ChallengeChanges, Failure> {
    let text = read(path)?;
    let explain = |faults: Vec<Fault>| Fault::explain_all(&faults, path, &text);
    let file = ChallengeFile::parse(&text).map_err(explain)?;
    planner.plan(&file).await.map_err(|unplanned| match unplanned {
        PlanError::File(faults) => explain(faults),
        PlanError::Other(failure) => failure,
    })
}

fn read(path: &Path) -> Result<String, Failure> {
    let failed = |error: &dyn std::fmt::Display| Failure::file("read", path, error);
    let size = std::fs::metadata(path).map_err(|error| failed(&error))?.len();
    if size > LARGEST_FILE {
        return Err(failed(&format!("it has {size} bytes, more than {LARGEST_FILE}"))
            .hinted("name the file of a challenge, such as challenge.toml"));
    }
    std::fs::read_to_string(path).map_err(|error| failed(&error))
}

async fn show(data: &Path, json: bool) -> Result<(), Failure> {
    let store = DataFolder::open(data)?.store().await?;
    let file = ChallengeFile::of(&store.phases().await?);
    if json {
        print_json(&as_json(&file))?;
    } else {
        say!("{}", file.text().map_err(Failure::internal)?.trim_end());
        for PhaseFile { id, .. } in &file.phases {
            let promise = store.commitment(id).await?;
            promise.iter().for_each(|promise| say!("# phase {id} is committed to {}", promise.commitment));
        }
    }
    Ok(())
}

async fn audit(data: &Path, json: bool) -> Result<(), Failure> {
    let store = DataFolder::open(data)?.store().await?;
    let lines = store.audit().await?;
    if json {
        return print_json(&lines);
    }
    for AuditLine { id, at_ms, actor, subject, what, before, after, reason } in lines {
        let words = |value: Option<String>| value.unwrap_or_else(|| "-".to_owned());
        let reason = if reason.is_empty() { reason } else { format!("  because {reason}") };
        let (at, before, after) = (rfc3339(at_ms), words(before), words(after));
        say!("{id:>5}  {at}  {actor}  {subject}: {what}  {before} -> {after}{reason}");
    }
    Ok(())
}

async fn reveal(data: &Path, phase: &str) -> Result<(), Failure> {
    let data = DataFolder::open(data)?;
    let note = note(&actor(), format!("phase {phase}"), "revealed", "");
    let store = data.store().await?;
    let seed = seed_to_publish(&data, &store, phase).await?;
    let (promise, values) = store.reveal_phase(phase, seed.as_ref(), note, now_unix_ms()).await?;
    if seed.is_some() && promise.seed.is_none() {
        eprintln!("the split's secret is not published yet: another phase still plays the split");
    }
    let CommitmentValues { pool, scorer, secret } = values;
    print_json(&PublishedCommitment {
        phase: phase.to_owned(),
        commitment: promise.commitment,
        committed_at: rfc3339(promise.committed_unix_ms),
        values: PublishedValues { pool, scorer, secret },
        seed: promise.seed,
    })
}

fn verify_reveal(args: &VerifyRevealArgs) -> Result<(), Failure> {
    let unfit = |message: String| {
        Failure::data(message).hinted("ask the organiser; keep the commitment that was published first")
    };
    let text = read(&args.file)?;
    let published: PublishedCommitment = serde_json::from_str(&text).map_err(|error| {
        Failure::data(format!("{} is not a published commitment: {error}", args.file.display()))
            .hinted("save the output of: avln challenge reveal PHASE")
    })?;
    let PublishedCommitment {
        phase, commitment, values: PublishedValues { pool, scorer, secret }, seed, ..
    } = published;
    let values = CommitmentValues { pool, scorer, secret };
    if values.commitment() != commitment {
        return Err(unfit(format!(
            "pool, scorer and secret of phase '{phase}' do not give its commitment {commitment}"
        )));
    }
    let rebuilt = args.rebuild.as_deref().map(|folder| rebuild(folder, seed)).transpose()?;
    let named = args.dataset.clone().zip(args.split.clone());
    if let Some((dataset, split)) = &rebuilt.or(named) {
        let found = digest_of(dataset, split)?;
        let pool = values.pool;
        if found != pool {
            return Err(unfit(format!("split '{split}' has the pool {found}, phase '{phase}' had {pool}")));
        }
        say!("the episodes of split {split} are those of phase {phase}");
    }
    say!("the values of phase {phase} fit its commitment");
    Ok(())
}

/// Rebuilds a split from its published secret; returns the folder and the split's name.
fn rebuild(folder: &Path, seed: Option<Value>) -> Result<(PathBuf, String), Failure> {
    let seed = seed.ok_or_else(|| {
        Failure::data("the file contains no `seed`").hinted(
            "only splits without a number have one; it is published when all phases on the split are closed",
        )
    })?;
    let bytes = serde_json::to_vec(&seed).map_err(Failure::internal)?;
    let secret = read_secret(File { name: "`seed`", bytes: &bytes }).map_err(DatasetError::from)?;
    let builder = Builder::open(DatasetFiles::at(folder), secret.into_recipe())?;
    let numbers = builder.run(None, None, |_| ())?;
    let split = numbers.into_iter().map(|(split, _)| split).next();
    Ok((folder.to_owned(), split.ok_or_else(|| Failure::data("the recipe in `seed` has no split"))?))
}

fn digest_of(dataset: &Path, split: &str) -> Result<String, Failure> {
    let folder = SplitFolder::open(dataset, split)?;
    let episodes = avln_arena::setup::phase_episodes(&folder)?;
    Ok(pool_digest(folder.digest(), episodes.iter().map(|episode| episode.episode.as_str())))
}

#[derive(Debug, Subcommand)]
pub(crate) enum RulingCommand {
    /// Mark a finished run as verified on leaderboards and on its page
    Verified(RulingArgs),
    /// Remove a run from all leaderboards; its page remains, with the reason
    Disqualified(RulingArgs),
}

#[derive(Clone, Debug, Args)]
pub(crate) struct RulingArgs {
    /// Run id
    run: String,
    /// Reason
    #[arg(long, value_name = "TEXT")]
    reason: String,
    /// Withdraw the ruling
    #[arg(long)]
    withdraw: bool,
}

pub(crate) async fn rule(data: &Path, command: RulingCommand) -> Result<(), Failure> {
    let store = DataFolder::open(data)?.store().await?;
    let (RulingCommand::Verified(ruling) | RulingCommand::Disqualified(ruling)) = &command;
    let RulingArgs { run, reason, withdraw } = ruling;
    let reason = reason.trim();
    if reason.is_empty() || reason.chars().any(char::is_control) {
        return Err(Failure::data("--reason is empty or not a single line")
            .hinted("say why, on one line: --reason \"it read the map\""));
    }
    let actor = actor();
    let by = Attribution { actor: &actor, reason };
    let words = match command {
        RulingCommand::Verified(_) => verify(&store, run, !withdraw, by).await?,
        RulingCommand::Disqualified(_) => disqualify(&store, run, !withdraw, by).await?,
    };
    say!("{words}");
    Ok(())
}
