//! What programs that play share: their command line, the run that they play, and what they tell people of it.

use avln_client::{
    Agent, Client, ConnectOptions, EpisodeEnd, Error, Order, RunOptions, RunSummary, Sensors, evaluate_slots,
};
use clap::{Args, value_parser};
use std::{fmt::Display, future::Future, io, iter, path::PathBuf, process::ExitCode, thread};
use tokio::runtime::Builder;

/// Which run is played, and where: what every agent is told on the command line.
#[derive(Args, Clone, Debug)]
pub struct RunArgs {
    /// Address of the server's gRPC port: http://, https:// or unix:/path
    #[arg(long, env = "AVLN_SERVER", default_value = "http://127.0.0.1:50051", value_name = "URL")]
    pub server: String,
    /// PEM file of the authorities that an https server's certificate may come from, instead of those of the system
    #[arg(long, env = "AVLN_CA", value_name = "FILE")]
    pub ca: Option<PathBuf>,
    /// Token of the account; or of one run, which is then played, whatever phase and order say
    #[arg(long, env = "AVLN_TOKEN", hide_env_values = true, value_name = "TOKEN")]
    pub token: String,
    /// Phase to play in; by default the one to practise in, where runs are not counted
    #[arg(long, default_value_t, hide_default_value = true)]
    pub phase: String,
    /// Order of the missions: ordered or unordered
    #[arg(long, default_value = "unordered")]
    pub order: Order,
    /// Pixels a side of the pictures, 64 to 1024
    #[arg(long, default_value_t = 128, value_name = "PIXELS")]
    pub size: u32,
    /// Episodes side by side, on as many threads as there are processors; the server may grant fewer
    #[arg(long, default_value_t = 1, value_parser = value_parser!(u32).range(1..=64), value_name = "SLOTS")]
    pub slots: u32,
}

impl RunArgs {
    /// Makes an agent for each slot.
    ///
    /// # Errors
    /// The first that `make` fails with.
    pub fn agents<A, E>(&self, make: impl FnMut() -> Result<A, E>) -> Result<Vec<A>, E> {
        iter::repeat_with(make).take(self.slots as usize).collect()
    }
}

/// Under what name an agent plays, and what it senses.
#[derive(Clone, Debug)]
pub struct Method {
    /// Name on the board.
    pub name: String,
    /// Version of the agent.
    pub version: &'static str,
    /// What it senses.
    pub sensors: Sensors,
}

/// Plays one run with an agent for each slot, telling `on_end` about every episode that ended.
///
/// # Errors
/// As for [`avln_client::evaluate_slots`] and for beginning a run.
pub async fn play<A: Agent + Send + 'static>(
    args: RunArgs,
    method: Method,
    agents: &mut Vec<A>,
    on_end: &mut (dyn FnMut(&EpisodeEnd) + Send),
) -> Result<RunSummary, Error> {
    let link = ConnectOptions { ca: args.ca, ..ConnectOptions::default() };
    let wanted = RunOptions::new(args.phase, method.name).method_version(method.version).order(args.order);
    let (arena, run) = Client::begin(&args.server, args.token, &link, wanted).await?;
    evaluate_slots(&arena, &run, method.sensors, agents, on_end).await
}

/// Runs what plays `slots` episodes side by side: one alone on one thread, where agent and connection take turns, so that a
/// second thread would only have to be woken.
///
/// # Errors
/// When the system gives no threads.
pub fn run_for<T>(slots: u32, work: impl Future<Output = T>) -> io::Result<T> {
    let most = thread::available_parallelism().map_or(1, usize::from);
    let runtime = match most.min(slots as usize) {
        0 | 1 => Builder::new_current_thread().enable_all().build(),
        threads => Builder::new_multi_thread().worker_threads(threads).enable_all().build(),
    };
    Ok(runtime?.block_on(work))
}

/// Tells people on standard error how an episode ended.
pub fn report(end: &EpisodeEnd) {
    let progress = end.progress;
    eprintln!("episode {} of {}: {} after {} steps", progress.done, progress.total, end.reason, end.steps);
}

/// Tells people how the run ended: its summary on standard output, or what went wrong on standard error, with code 1.
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
    use clap::Parser;

    /// Plays
    #[derive(Parser)]
    struct Cli {
        #[command(flatten)]
        run: RunArgs,
        /// The last one
        #[arg(long)]
        more: bool,
    }

    #[test]
    fn options_of_an_agent_follow_those_of_the_run() {
        let help = <Cli as clap::CommandFactory>::command().render_help().to_string();
        let names =
            ["Plays", "--server", "--ca", "--token", "--phase", "--order", "--size", "--slots", "--more"];
        let places: Vec<_> =
            names.iter().map(|name| help.rfind(&format!("{name} ")).or(help.find(name))).collect();
        assert!(places.iter().all(Option::is_some) && places.is_sorted(), "{places:?} in {help}");
    }

    #[test]
    fn a_token_is_all_that_must_be_said() {
        let cli = Cli::try_parse_from(["agent", "--token", "t"]).unwrap();
        let RunArgs { phase, order, size, .. } = cli.run;
        assert_eq!((phase.as_str(), order, size, cli.more), ("", Order::Unordered, 128, false));
        assert_eq!(cli.run.slots, 1);
        assert!(Cli::try_parse_from(["agent", "--token", "t", "--slots", "0"]).is_err());
        let command = <Cli as clap::CommandFactory>::command();
        let required = command.get_arguments().filter(|argument| argument.is_required_set());
        assert_eq!(required.map(|argument| argument.get_id().as_str()).collect::<Vec<_>>(), ["token"]);
    }

    #[tokio::test]
    async fn without_a_server_it_says_where_it_looked() {
        let nobody = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let url = format!("http://{nobody}");
        let cli = Cli::try_parse_from(["agent", "--token", "t", "--server", &url]).unwrap();
        let method = Method { name: "none".into(), version: "0", sensors: Sensors::default() };
        let mut agents = cli.run.agents(|| Ok::<_, Error>(Idle)).unwrap();
        let played = play(cli.run, method, &mut agents, &mut |_| {}).await;
        assert!(matches!(&played, Err(Error::Unreachable { address, .. }) if *address == url), "{played:?}");
        assert_eq!(format!("{:?}", conclude(played)), format!("{:?}", ExitCode::FAILURE));
    }

    struct Idle;

    impl Agent for Idle {
        fn begin(&mut self, _: &avln_client::TaskSpec, _: &avln_client::Mission) {}
        fn act(&mut self, _: &avln_client::Observation) -> avln_client::Action {
            avln_client::Action::Stop
        }
    }
}
