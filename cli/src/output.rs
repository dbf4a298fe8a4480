//! Output: lines, JSON and progress bars; and the log on standard error: filter, format, and ends of spans.

use avln_arena::Failure;
use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use std::{
    fmt,
    io::{self, IsTerminal, Write},
    num::NonZero,
    path::Path,
    thread,
};
use tracing::{Event, Subscriber, subscriber::set_global_default};
use tracing_subscriber::{
    EnvFilter,
    fmt::{
        FmtContext, FormatEvent, FormatFields, MakeWriter, SubscriberBuilder,
        format::{DefaultFields, FmtSpan, Format, Writer},
    },
    registry::LookupSpan,
};

pub(crate) fn line(text: fmt::Arguments<'_>) {
    // The reader may have closed the pipe, as in `avln demo | head`: that is not an error.
    if writeln!(io::stdout().lock(), "{text}").is_err() {
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
    styled_bar(&format!("{{bar:30}} {{pos}}/{{len}} {items}, {{elapsed}} gone, {{eta}} left"), length)
}

pub(crate) fn styled_bar(template: &str, length: usize) -> ProgressBar {
    let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
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

/// Format of log lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum LogFormat {
    Text,
    Json,
}

/// Starts the log of this process.
pub(crate) fn start_log(filter: &str, format: LogFormat) -> Result<(), Failure> {
    let filter = EnvFilter::try_new(filter).map_err(|error| {
        Failure::internal(format!("cannot read the log filter '{filter}': {error}"))
            .hinted("use a level such as info, or target=level pairs separated by commas")
    })?;
    // In tests a process runs several command lines; the first subscriber stays.
    let _ = match format {
        LogFormat::Text => set_global_default(text(filter, io::stderr, io::stderr().is_terminal())),
        LogFormat::Json => set_global_default(json(filter, io::stderr)),
    };
    Ok(())
}

fn text<W>(filter: EnvFilter, writer: W, is_coloured: bool) -> impl Subscriber + Send + Sync
where
    W: for<'w> MakeWriter<'w> + Send + Sync + 'static,
{
    builder(filter, writer).with_ansi(is_coloured).map_event_format(UntimedEnds).finish()
}

fn json<W>(filter: EnvFilter, writer: W) -> impl Subscriber + Send + Sync
where
    W: for<'w> MakeWriter<'w> + Send + Sync + 'static,
{
    builder(filter, writer).json().map_event_format(UntimedEnds).finish()
}

fn builder<W>(filter: EnvFilter, writer: W) -> SubscriberBuilder<DefaultFields, Format, EnvFilter, W>
where
    W: for<'w> MakeWriter<'w> + 'static,
{
    let builder = tracing_subscriber::fmt().with_env_filter(filter).with_writer(writer);
    // A log that cannot be written, on a full disk, must not stop the server.
    builder.with_span_events(FmtSpan::CLOSE).log_internal_errors(false)
}

/// Leaves out the ends of spans with a field `duration_ms`: these are events of the server, with an outcome.
struct UntimedEnds<F>(F);

impl<S, N, F> FormatEvent<S, N> for UntimedEnds<F>
where
    S: Subscriber + for<'l> LookupSpan<'l>,
    N: for<'w> FormatFields<'w> + 'static,
    F: FormatEvent<S, N>,
{
    fn format_event(
        &self,
        context: &FmtContext<'_, S, N>,
        writer: Writer<'_>,
        event: &Event<'_>,
    ) -> fmt::Result {
        let metadata = event.metadata();
        if metadata.is_span() && metadata.fields().field("duration_ms").is_some() {
            return Ok(());
        }
        self.0.format_event(context, writer, event)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::Value;
    use std::sync::{Arc, Mutex};
    use tracing::field::Empty;

    #[derive(Clone, Default)]
    struct Lines(Arc<Mutex<Vec<u8>>>);

    impl Write for Lines {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.lock().expect("no panic").write(bytes)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Lines {
        fn text(&self) -> String {
            String::from_utf8(self.0.lock().expect("no panic").clone()).expect("text")
        }
    }

    fn filter(text: &str) -> EnvFilter {
        EnvFilter::try_new(text).expect("a filter")
    }

    /// Logs a step in an episode, and a preparation.
    fn log_step() {
        let _episode = tracing::error_span!("episode", slot = 0, duration_ms = Empty).entered();
        tracing::debug_span!("prepare").in_scope(|| ());
        let step = tracing::debug_span!("step", step = 3, duration_ms = Empty);
        step.record("duration_ms", 12.5);
        tracing::debug!(parent: &step, "step ended");
        tracing::warn!(step = 3, "slow step");
    }

    #[test]
    fn json_lines_have_fields_and_spans() {
        let lines = Lines::default();
        let writer = lines.clone();
        tracing::subscriber::with_default(json(filter("debug"), move || writer.clone()), log_step);
        let lines = lines.text();
        let lines: Vec<Value> =
            lines.lines().map(|line| serde_json::from_str(line).expect("a JSON line")).collect();
        let messages: Vec<_> = lines.iter().map(|line| line["fields"]["message"].as_str()).collect();
        assert_eq!(messages, [Some("close"), Some("step ended"), Some("slow step")]);
        let [prepared, step, warning] = &lines[..] else { panic!("{lines:?}") };
        assert_eq!(prepared["span"]["name"], "prepare");
        assert!(prepared["fields"]["time.busy"].is_string(), "{prepared}");
        assert_eq!((&step["level"], &step["span"]["name"]), (&"DEBUG".into(), &"step".into()));
        assert_eq!((&step["span"]["step"], &step["span"]["duration_ms"]), (&3.into(), &12.5.into()));
        assert_eq!(step["spans"][0]["name"], "episode");
        assert_eq!((&warning["level"], &warning["fields"]["step"]), (&"WARN".into(), &3.into()));
        for line in &lines {
            assert!(line["timestamp"].is_string() && line["target"].is_string(), "{line}");
        }
    }

    #[test]
    fn text_lines_begin_with_their_spans() {
        let lines = Lines::default();
        let writer = lines.clone();
        tracing::subscriber::with_default(text(filter("warn"), move || writer.clone(), false), log_step);
        let lines = lines.text();
        assert_eq!(lines.lines().count(), 1, "{lines}");
        assert!(lines.contains("WARN episode{slot=0}: ") && lines.contains("slow step step=3"), "{lines}");
    }
}
