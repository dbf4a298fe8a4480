//! Takes pictures to train perception on, or to measure it by.

use super::dataset::{bar, recipe};
use crate::output::say;
use avln_arena::Failure;
use avln_lab::dataset::frames::{self, FrameOptions, Purpose};
use clap::Args;
use std::path::PathBuf;

/// Which pictures, of what, and where they go.
#[derive(Debug, Args)]
pub struct Options {
    /// The recipe whose houses are drawn: a JSON file, or the name of one that comes with avln: paper, mini
    #[arg(long, value_name = "CONFIG", default_value = "paper")]
    recipe: String,
    /// The split: one whose houses show furniture of the training pool
    #[arg(long, default_value = "train")]
    split: String,
    /// Take them to measure by, in a split of the validation pool; nothing that trains reads such files
    #[arg(long)]
    measure: bool,
    /// The first houses of the split
    #[arg(long, value_name = "COUNT", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..))]
    houses: u32,
    /// Pictures in each house
    #[arg(long, value_name = "COUNT", default_value_t = 80, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    views: u32,
    /// Pixels along a side, 16 to 1024
    #[arg(long, value_name = "PIXELS", default_value_t = 192, value_parser = clap::value_parser!(u32).range(16..=1024))]
    size: u32,
    /// The folder for frames.json and a .npy file of records for each house; houses that are there are not visited again
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Threads; one for each processor by default. The bytes are the same for any number
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

pub(super) fn run(options: &Options) -> Result<(), Failure> {
    let wanted = FrameOptions {
        recipe: recipe(&options.recipe)?,
        split: options.split.clone(),
        purpose: if options.measure { Purpose::Measurement } else { Purpose::Training },
        houses: options.houses as usize,
        views: options.views as usize,
        side_px: options.size,
        threads: options.threads.map(usize::from),
    };
    let bar = bar("{bar:30} {pos}/{len} houses, {elapsed} gone, {eta} left");
    bar.set_length(options.houses.into());
    frames::take(&wanted, &options.out, || bar.inc(1))?;
    bar.finish_and_clear();
    say!("{} pictures in {}", options.houses * options.views, options.out.display());
    Ok(())
}
