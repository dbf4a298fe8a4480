//! Output: lines, JSON and progress bars.

use avln_arena::Failure;
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use std::{fmt, io::Write, num::NonZero, path::Path, thread};

pub(crate) fn line(text: fmt::Arguments<'_>) {
    // The reader may have closed the pipe, as in `avln demo | head`: that is not an error.
    if writeln!(std::io::stdout().lock(), "{text}").is_err() {
        std::process::exit(0);
    }
}

/// `println!` for output that may be piped.
macro_rules! say {
    ($($text:tt)*) => { $crate::output::line(format_args!($($text)*)) };
}
pub(crate) use say;

pub(crate) fn print_json(value: &impl Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(value).map_err(Failure::internal)?;
    say!("{text}");
    Ok(())
}

/// Returns a progress bar over `length` items; `items` is their plural.
pub(crate) fn progress_bar(items: &str, length: usize) -> ProgressBar {
    let template = format!("{{bar:30}} {{pos}}/{{len}} {items}, {{elapsed}} gone, {{eta}} left");
    let style = ProgressStyle::with_template(&template).unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(length as u64).with_style(style)
}

/// Returns a number with a noun; the plural ends in s.
pub(crate) fn counted(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

pub(crate) fn write_file(path: &Path, bytes: impl AsRef<[u8]>) -> Result<(), Failure> {
    std::fs::write(path, bytes).map_err(|error| cannot_write(path, error))
}

/// Returns the failure for a file or folder that is not writable.
pub(crate) fn cannot_write(path: &Path, error: impl fmt::Display) -> Failure {
    Failure::file("write", path, error).hinted("choose an existing folder with write access and free space")
}

pub(crate) fn processors() -> usize {
    thread::available_parallelism().map_or(1, NonZero::get)
}
