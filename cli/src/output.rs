//! Output: lines, JSON and progress bars.

use avln_arena::Failure;
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use std::{fmt, io::Write};

/// Prints a line to standard output.
pub(crate) fn line(text: fmt::Arguments<'_>) {
    if writeln!(std::io::stdout().lock(), "{text}").is_err() {
        std::process::exit(0);
    }
}

/// `println!` for programs whose output may be piped.
macro_rules! say {
    ($($text:tt)*) => { $crate::output::line(format_args!($($text)*)) };
}
pub(crate) use say;

/// Prints a value as indented JSON.
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
