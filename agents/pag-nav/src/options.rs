use crate::{Error, PagNav, Recorder, Weights};
use avln_client::{EpisodeEnd, RunSummary, Sensors};
use avln_kit::shell::{Method, RunArgs, play};
use avln_onnx::{Brought, Failure};
use clap::Args;
use std::path::PathBuf;

/// What the agent is told on the command line.
#[derive(Args, Clone, Debug)]
pub struct Options {
    /// The run that it plays
    #[command(flatten)]
    pub run: RunArgs,
    /// Name of the method on the board
    #[arg(long, default_value = "PAG-Nav", value_name = "NAME")]
    pub method: String,
    /// TOML file with numbers to use instead of the defaults, which agents/pag-nav/pag-nav.toml explains
    #[arg(long, value_name = "FILE")]
    pub weights: Option<PathBuf>,
    /// TOML file that names models in ONNX to see by instead of the network that comes along; docs/models.md explains it
    #[arg(long, value_name = "FILE")]
    pub models: Option<PathBuf>,
    /// Folder for a file of each episode that says step by step what the agent heard, believed and did
    #[arg(long, value_name = "FOLDER")]
    pub trace: Option<PathBuf>,
}

/// Plays one run with [`PagNav`].
///
/// # Errors
/// When the weights cannot be used or a trace cannot be written, as for [`avln_client::evaluate`], and for beginning a run.
pub async fn run(options: Options) -> Result<RunSummary, Error> {
    run_with(options, &mut |_| {}).await
}

/// As [`run`], telling `on_end` about every episode that ended.
///
/// # Errors
/// As for [`run`].
pub async fn run_with(
    options: Options,
    on_end: &mut (dyn FnMut(&EpisodeEnd) + Send),
) -> Result<RunSummary, Error> {
    let mut failures = Vec::new();
    let mut agents = options.run.agents(|| agent(&options, &mut failures))?;
    let sensors = Sensors::square(options.run.size);
    let method = Method { name: options.method, version: env!("CARGO_PKG_VERSION"), sensors };
    let played = play(options.run, method, &mut agents, on_end).await;
    let traced = agents.iter_mut().try_for_each(PagNav::end_trace);
    let summary = played?;
    if let Some(problem) = failures.iter().find_map(|failure| failure.get()) {
        return Err(Error::Unseen { problem: problem.to_string(), summary: Box::new(summary) });
    }
    match traced {
        Ok(()) => Ok(summary),
        Err(problem) => Err(Error::Untraced { problem, summary: Box::new(summary) }),
    }
}

/// The agent that the options ask for. Models that it sees by tell of failures in `failures`.
fn agent(options: &Options, failures: &mut Vec<Failure>) -> Result<PagNav, Error> {
    let weights = options.weights.as_deref().map_or_else(|| Ok(Weights::default()), Weights::read)?;
    let agent = match &options.models {
        Some(file) => {
            let eyes = Brought::load(file)?;
            failures.push(eyes.failure());
            PagNav::new(weights).seeing(eyes)
        }
        None => PagNav::new(weights),
    };
    Ok(match &options.trace {
        Some(folder) => agent.traced(Recorder::new(folder)?),
        None => agent,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;
    use std::fs;

    #[derive(Parser)]
    struct Cli {
        #[command(flatten)]
        options: Options,
    }

    #[tokio::test]
    async fn files_are_refused_before_a_run_begins() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("my.toml");
        fs::write(&file, "submit_m = 99").unwrap();
        let path = file.to_str().unwrap();
        for (option, words) in [
            ("--weights", "my.toml: submit_m is 99, "),
            ("--models", "my.toml: "),
            ("--trace", "--trace a folder"),
        ] {
            // Nobody listens there: an attempt to begin would be another error.
            let words_of_agent = ["agent", "--token", "t", "--server", "http://127.0.0.1:1", option, path];
            let refused = run(Cli::try_parse_from(words_of_agent).unwrap().options).await;
            let error = refused.unwrap_err().to_string();
            assert!(error.contains(words), "{option}: {error}");
        }
    }
}
