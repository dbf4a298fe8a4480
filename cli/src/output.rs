use std::{fmt, io::Write};

/// Prints a line to standard output. A reader that has gone away (`avln demo | head`) ends the program quietly.
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
