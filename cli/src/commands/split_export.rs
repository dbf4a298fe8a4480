//! Writes a split as others read it.

use super::dataset::bar;
use crate::output::say;
use avln_arena::{Failure, FailureKind, data::DataFolder, dataset::SplitFolder};
use avln_lab::dataset::{export, openness::Openness};
use avln_store::Phase;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// What to export.
#[derive(Clone, Debug, Args)]
pub struct Export {
    /// Name of the split, one of the data folder or, with --dataset, of a data set
    pub name: String,
    #[command(flatten)]
    pub(super) origin: Origin,
    /// As what it is written; both by default
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = [Format::Authors, Format::Parquet], value_name = "LIST")]
    pub format: Vec<Format>,
    /// Folder of the files that are written
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

/// Where a split lies that something is taken from, and what its owner says of it.
#[derive(Clone, Debug, Args)]
pub(super) struct Origin {
    /// The folder of a data set, as avln data dataset build makes it
    #[arg(long, value_name = "DIR")]
    dataset: Option<PathBuf>,
    /// Say that scenes which were read from files are there to learn from, so that ground truth may be told
    #[arg(long)]
    training: bool,
}

/// A format that can be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// LH-AVLN as its authors publish it: JSON packed by gzip
    Authors,
    /// Tables of plain columns
    Parquet,
}

impl Origin {
    /// The split called `name`, and how much of it may be handed out.
    ///
    /// # Errors
    /// When there is no such split, or it is hidden.
    pub(super) async fn open(
        &self,
        data: &DataFolder,
        name: &str,
    ) -> Result<(SplitFolder, Openness), Failure> {
        let split = match &self.dataset {
            Some(dataset) => SplitFolder::open(dataset, name)?,
            None => data.missions(name)?,
        };
        let phases = phases_of(data, &split).await?;
        let openness = Openness::of(&split, &phases, self.training)?;
        Ok((split, openness))
    }
}

/// The phases of the data folder that play the missions of a split, whatever it is called there.
async fn phases_of(data: &DataFolder, split: &SplitFolder) -> Result<Vec<Phase>, Failure> {
    if !data.root().join("avln.db").is_file() {
        return Ok(Vec::new());
    }
    let store = data.store().await?;
    let mut playing = Vec::new();
    for phase in store.phases().await? {
        if store.split_digest(&phase.split).await?.as_deref() == Some(split.digest()) {
            playing.push(phase);
        }
    }
    store.close().await;
    Ok(playing)
}

/// Exports a split and tells how much of it.
///
/// # Errors
/// When there is no such split, it is hidden, or the folder cannot be written.
pub(super) async fn run(data: &DataFolder, options: Export) -> Result<(), Failure> {
    let (split, openness) = options.origin.open(data, &options.name).await?;
    let done = tokio::task::spawn_blocking(move || export(&options, &split, openness)).await;
    done.map_err(|error| Failure::new(FailureKind::Internal, error))?
}

fn export(options: &Export, split: &SplitFolder, openness: Openness) -> Result<(), Failure> {
    let bar = bar("{bar:30} {pos}/{len} scenes, {elapsed} gone, {eta} left");
    bar.set_length(split.scenes().len() as u64);
    let [authors, parquet] =
        [Format::Authors, Format::Parquet].map(|format| options.format.contains(&format));
    let missions = export::Export { split, openness, authors, parquet }.run(&options.out, || bar.inc(1))?;
    bar.finish_and_clear();
    let with = match openness {
        Openness::Training => "with ground truth",
        Openness::Public => "without ground truth, which is told of training splits alone",
    };
    say!("wrote {missions} missions to {}, {with}", options.out.join(split.name()).display());
    Ok(())
}
