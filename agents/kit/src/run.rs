//! Command-line arguments, run loop and console output of agent programs.

use avln_client::{
    Agent, Client, ConnectOptions, EpisodeEnd, Error, MethodType, Order, Run, RunOptions, RunSummary,
    Sensors, evaluate_slots,
};
use clap::{Args, value_parser};
use std::{fmt::Display, future::Future, io, iter, path::PathBuf, process::ExitCode, thread};
use tokio::runtime::Builder;

/// Arguments that select a server and a run.
#[derive(Args, Clone, Debug)]
pub struct RunArgs {
    /// Address of the server's gRPC port: http://, https:// or unix:/path
    #[arg(long, env = "AVLN_SERVER", default_value = "http://127.0.0.1:50051", value_name = "URL")]
    pub server: String,
    /// PEM file with the certificate authorities to trust for https, instead of the system's
    #[arg(long, env = "AVLN_CA", value_name = "FILE")]
    pub ca: Option<PathBuf>,
    /// Token of the account, or of a single run; a run token overrides phase and order
    #[arg(long, env = "AVLN_TOKEN", hide_env_values = true, value_name = "TOKEN")]
    pub token: String,
    /// Phase to play in; default: the practice phase, which does not limit runs
    #[arg(long, default_value_t, hide_default_value = true)]
    pub phase: String,
    /// Order of the missions: ordered or unordered
    #[arg(long, default_value = "unordered")]
    pub order: Order,
}

impl RunArgs {
    /// Connects to the server and begins the run; fails if the server is unreachable or refuses.
    pub async fn begin(
        self,
        method: &str,
        version: &str,
        method_type: Option<MethodType>,
    ) -> Result<(Client, Run), Error> {
        let connect_options = ConnectOptions { ca: self.ca, ..ConnectOptions::default() };
        let options = RunOptions::new(self.phase, method).method_version(version).order(self.order);
        let options = match method_type {
            Some(method_type) => options.method_type(method_type),
            None => options,
        };
        Client::begin(&self.server, self.token, &connect_options, options).await
    }
}

/// Arguments for agents that play several episodes in parallel.
#[derive(Args, Clone, Debug)]
pub struct AgentArgs {
    /// The run.
    #[command(flatten)]
    pub run: RunArgs,
    /// Side of the images in pixels, 64 to 1024
    #[arg(long, default_value_t = 128, value_name = "PIXELS")]
    pub size: u32,
    /// Episodes to play in parallel, on at most as many threads as processors; the server may grant fewer
    #[arg(long, default_value_t = 1, value_parser = value_parser!(u32).range(1..=64), value_name = "SLOTS")]
    pub slots: u32,
}

impl AgentArgs {
    /// Creates an agent per slot; fails with the first error from `make`.
    pub fn agents<A, E>(&self, make: impl FnMut() -> Result<A, E>) -> Result<Vec<A>, E> {
        iter::repeat_with(make).take(self.slots as usize).collect()
    }
}

/// An agent's name, version, type and sensors.
#[derive(Clone, Debug)]
pub struct Method {
    /// Name on the leaderboard.
    pub name: String,
    /// Agent version.
    pub version: &'static str,
    /// Method type.
    pub method_type: MethodType,
    /// Requested sensors.
    pub sensors: Sensors,
}

/// Receiver of every episode's end.
pub type OnEnd<'a> = &'a mut (dyn FnMut(&EpisodeEnd) + Send);

/// Plays one run with an agent per slot, and calls `on_end` after each episode.
pub async fn play<A: Agent + Send + 'static>(
    args: AgentArgs,
    method: Method,
    agents: &mut Vec<A>,
    on_end: OnEnd<'_>,
) -> Result<RunSummary, Error> {
    let (arena, run) = args.run.begin(&method.name, method.version, Some(method.method_type)).await?;
    evaluate_slots(&arena, &run, method.sensors, agents, on_end).await
}

/// Runs `work` on a runtime for `slots` parallel episodes; fails if no threads can be started.
pub fn run_for<T>(slots: u32, work: impl Future<Output = T>) -> io::Result<T> {
    let most = thread::available_parallelism().map_or(1, usize::from);
    let runtime = match most.min(slots as usize) {
        // Agent and connection alternate in a single slot: a second thread would only add wake-ups.
        0 | 1 => Builder::new_current_thread().enable_all().build(),
        threads => Builder::new_multi_thread().worker_threads(threads).enable_all().build(),
    };
    Ok(runtime?.block_on(work))
}

/// Prints an episode's end to standard error.
pub fn report(end: &EpisodeEnd) {
    let progress = end.progress;
    eprintln!("episode {} of {}: {} after {} steps", progress.done, progress.total, end.reason, end.steps);
}

/// Prints the summary to standard output, or the error to standard error, and returns the exit code.
pub fn conclude(played: Result<RunSummary, impl Display>) -> ExitCode {
    match played {
        Ok(summary) => {
            println!("{summary}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_client::{Action, Mission, Observation, TaskSpec};
    use clap::{CommandFactory, Parser};
    use std::net::TcpListener;

    /// Plays
    #[derive(Parser)]
    struct Cli {
        #[command(flatten)]
        agent: AgentArgs,
        /// An argument of the agent
        #[arg(long)]
        more: bool,
    }

    struct Idle;

    impl Agent for Idle {
        fn begin(&mut self, _: &TaskSpec, _: &Mission) {}

        fn act(&mut self, _: &Observation) -> Action {
            Action::Stop
        }
    }

    #[test]
    fn help_lists_run_arguments_first() {
        let help = Cli::command().render_help().to_string();
        let names =
            ["Plays", "--server", "--ca", "--token", "--phase", "--order", "--size", "--slots", "--more"];
        let places: Vec<_> =
            names.iter().map(|name| help.rfind(&format!("{name} ")).or(help.find(name))).collect();
        assert!(places.iter().all(Option::is_some) && places.is_sorted(), "{places:?} in {help}");
    }

    #[test]
    fn only_the_token_is_required() {
        let cli = Cli::try_parse_from(["agent", "--token", "t"]).unwrap();
        let AgentArgs { run, size, slots } = cli.agent;
        assert_eq!((run.phase.as_str(), run.order, size, slots), ("", Order::Unordered, 128, 1));
        assert!(!cli.more && Cli::try_parse_from(["agent", "--token", "t", "--slots", "0"]).is_err());
        let command = Cli::command();
        let required = command.get_arguments().filter(|argument| argument.is_required_set());
        assert_eq!(required.map(|argument| argument.get_id().as_str()).collect::<Vec<_>>(), ["token"]);
    }

    #[tokio::test]
    async fn unreachable_servers_are_named() {
        // The listener is closed at once, so that its port refuses connections.
        let closed = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let url = format!("http://{closed}");
        let cli = Cli::try_parse_from(["agent", "--token", "t", "--server", &url]).unwrap();
        let method = Method {
            name: "none".into(),
            version: "0",
            method_type: MethodType::TrainingFree,
            sensors: Sensors::default(),
        };
        let mut agents = cli.agent.agents(|| Ok::<_, Error>(Idle)).unwrap();
        let played = play(cli.agent, method, &mut agents, &mut |_| {}).await;
        assert!(matches!(&played, Err(Error::Unreachable { address, .. }) if *address == url), "{played:?}");
        assert_eq!(format!("{:?}", conclude(played)), format!("{:?}", ExitCode::FAILURE));
    }
}
