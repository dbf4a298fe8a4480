//! Man pages and shell completions, for packages.

use crate::{Cli, output::say};
use avln_arena::{Failure, FailureKind};
use clap::{Args, CommandFactory};
use clap_complete::Shell;
use std::{
    fs, io,
    path::{Path, PathBuf},
};

/// Arguments of `avln manual`.
#[derive(Clone, Debug, Args)]
pub struct ManualArgs {
    /// Folder; man1 and completions are created in it
    #[arg(value_name = "FOLDER")]
    pub out: PathBuf,
}

const SHELLS: [Shell; 3] = [Shell::Bash, Shell::Zsh, Shell::Fish];

/// Writes man pages and completions.
///
/// # Errors
/// If the folder cannot be written.
pub fn run(args: &ManualArgs) -> Result<(), Failure> {
    let out = &args.out;
    write(out).map_err(|error| {
        Failure::new(FailureKind::Data, format!("cannot write into {}: {error}", out.display()))
    })?;
    say!("{}/man1 and {}/completions are written", out.display(), out.display());
    Ok(())
}

fn write(out: &Path) -> io::Result<()> {
    let [pages, completions] = ["man1", "completions"].map(|name| out.join(name));
    fs::create_dir_all(&pages)?;
    fs::create_dir_all(&completions)?;
    clap_mangen::generate_to(Cli::command(), &pages)?;
    for shell in SHELLS {
        clap_complete::generate_to(shell, &mut Cli::command(), "avln", &completions)?;
    }
    Ok(())
}
