//! The client: connection to a server, account, phases, quotas and runs.

use crate::{
    calls::{Greeting, bearer, greet, persist, plain, signed, unwrap},
    connect_options::{ConnectOptions, Packing},
    connection::{Connection, Reconnector},
    error::Error,
    play::Play,
    service::{Account, Phase, Quota, Run, RunOptions, RunStatus, RunWatch, ServerInfo, phase_to_practise},
    task::Sensors,
    welcome::Agreement,
};
use avln_proto::{
    API_MINOR,
    v1::{self, info_service_client::InfoServiceClient, run_service_client::RunServiceClient},
};
use std::time::Duration;
use tonic::{Request, Status, transport::Channel};

const RUN_TOKEN_PREFIX: &str = "avln_run_";

type Runs = RunServiceClient<Channel>;

/// A connection to a server. Clones share it.
///
/// Calls are retried for ten seconds, or [`ConnectOptions::patience`] if shorter; a run starts only once.
#[derive(Clone, Debug)]
pub struct Client {
    channel: Channel,
    token: String,
    packing: Packing,
    pub(crate) patience: Option<Duration>,
}

impl Client {
    /// Connects to `server`, like `http://127.0.0.1:50051` or `unix:/run/arena.sock`, with an account `token`,
    /// which may be empty for [`server_info`](Self::server_info), [`phases`](Self::phases) and a
    /// [`Run::from_token`]. Fails if no Arena server answers within ten seconds or a value is invalid.
    pub async fn connect(server: impl AsRef<str>, token: impl Into<String>) -> Result<Self, Error> {
        Self::connect_with(server, token, &ConnectOptions::default()).await
    }

    /// Connects like [`connect`](Self::connect) with options; fails also if the authority file is invalid.
    pub async fn connect_with(
        server: impl AsRef<str>,
        token: impl Into<String>,
        options: &ConnectOptions,
    ) -> Result<Self, Error> {
        let address = server.as_ref();
        let (channel, packing) = options.connect(address).await?;
        let client = Self { channel, token: token.into(), packing, patience: options.patience };
        client.server_info().await.map_err(|error| not_arena(address, error))?;
        if !client.token.is_empty() {
            client.whoami().await?;
        }
        Ok(client)
    }

    /// Connects and starts a run; with a run token, as in a sealed run, joins that run without `options`.
    pub async fn begin(
        server: impl AsRef<str>,
        token: impl Into<String>,
        connect_options: &ConnectOptions,
        options: RunOptions,
    ) -> Result<(Self, Run), Error> {
        let token = token.into();
        if token.starts_with(RUN_TOKEN_PREFIX) {
            return Ok((Self::connect_with(server, "", connect_options).await?, Run::from_token(token)));
        }
        let client = Self::connect_with(server, token, connect_options).await?;
        let run = client.start_run(options).await?;
        Ok((client, run))
    }

    /// Returns server information.
    pub async fn server_info(&self) -> Result<ServerInfo, Error> {
        let request = plain(v1::GetServerInfoRequest {});
        let answer = InfoServiceClient::new(self.channel.clone()).get_server_info(request).await;
        Ok(ServerInfo::from_wire(unwrap("request server information", answer)?))
    }

    /// Returns the phases visible to the team, in the organiser's order; without a token, the public phases.
    pub async fn phases(&self) -> Result<Vec<Phase>, Error> {
        let team = if self.token.is_empty() { None } else { Some(bearer(&self.token)?) };
        let call = || async {
            let request = plain(v1::ListPhasesRequest {});
            let request = match &team {
                Some(team) => signed(request, team),
                None => request,
            };
            InfoServiceClient::new(self.channel.clone()).list_phases(request).await
        };
        let answer = persist("list phases", self.patience, call).await?;
        Ok(answer.phases.into_iter().map(Phase::from_wire).collect())
    }

    /// Returns the default phase: the only open phase with uncounted runs, or `practice`; otherwise fails.
    pub async fn practice_phase(&self) -> Result<String, Error> {
        phase_to_practise(&self.phases().await?, &self.quota().await?).map(|phase| phase.id.clone())
    }

    /// Returns the token's account; fails if the server rejects the token.
    pub async fn whoami(&self) -> Result<Account, Error> {
        let ask = |mut runs: Runs, request| async move { runs.who_am_i(request).await };
        Ok(Account::from_wire(self.ask("request the token's account", v1::WhoAmIRequest {}, ask).await?))
    }

    /// Starts a run; without a phase in `options`, in [`practice_phase`](Self::practice_phase). Fails if the
    /// phase is unknown, closed or forbidden, the quota is used up, or the server is full.
    pub async fn start_run(&self, mut options: RunOptions) -> Result<Run, Error> {
        if options.phase.is_empty() {
            options.phase = self.practice_phase().await?;
        }
        let message = options.named().into_wire(client_info());
        let ask = |mut runs: Runs, request| async move { runs.start_run(request).await };
        Run::from_wire(self.ask("start a run", message, ask).await?)
    }

    /// Returns a run's state; fails if the run is unknown.
    pub async fn run(&self, id: &str) -> Result<RunStatus, Error> {
        let ask = |mut runs: Runs, request| async move { runs.get_run(request).await };
        let message = v1::GetRunRequest { run: id.to_owned() };
        RunStatus::from_wire(self.ask("request a run's state", message, ask).await?.run)
    }

    /// Watches a run: returns the state after every change until the end. Fails if the run is unknown.
    pub async fn watch(&self, id: &str) -> Result<RunWatch, Error> {
        // No timeout: the answer stream lasts as long as the run.
        let request = Request::new(v1::WatchRunRequest { run: id.to_owned() });
        let request = signed(request, &bearer(&self.token)?);
        Ok(RunWatch(unwrap("watch a run", self.runs_client().watch_run(request).await)?))
    }

    /// Returns the team's runs, newest first.
    pub async fn runs(&self) -> Result<Vec<RunStatus>, Error> {
        let ask = |mut runs: Runs, request| async move { runs.list_runs(request).await };
        let mut runs = Vec::new();
        let mut page_token = String::new();
        loop {
            let message = v1::ListRunsRequest { phase: String::new(), page_size: 200, page_token };
            let page = self.ask("list runs", message, ask).await?;
            for run in page.runs {
                runs.push(RunStatus::from_wire(Some(run))?);
            }
            if page.next_page_token.is_empty() {
                return Ok(runs);
            }
            page_token = page.next_page_token;
        }
    }

    /// Cancels a run; open episodes end as abandoned. Fails if the run is unknown.
    pub async fn cancel_run(&self, id: &str) -> Result<RunStatus, Error> {
        let ask = |mut runs: Runs, request| async move { runs.cancel_run(request).await };
        let message = v1::CancelRunRequest { run: id.to_owned() };
        RunStatus::from_wire(self.ask("cancel a run", message, ask).await?.run)
    }

    /// Returns the remaining quota in all visible phases.
    pub async fn quota(&self) -> Result<Vec<Quota>, Error> {
        let ask = |mut runs: Runs, request| async move { runs.get_quota(request).await };
        let answer = self.ask("request the quota", v1::GetQuotaRequest { phase: String::new() }, ask).await?;
        Ok(answer.quotas.into_iter().map(Quota::from_wire).collect())
    }

    /// Opens the run stream for a single slot. Fails if `sensors` are out of range or forbidden, the run has
    /// ended, the server rejects this client version or violates the protocol, or the connection is lost.
    pub async fn play(&self, run: &Run, sensors: Sensors) -> Result<Play, Error> {
        let slots = self.play_slots(run, sensors, 1).await?;
        slots.into_iter().next().ok_or_else(|| Error::protocol("Welcome grants no slot"))
    }

    /// Opens the run stream like [`play`](Self::play) for up to `slots` slots; returns the granted slots.
    pub async fn play_slots(&self, run: &Run, sensors: Sensors, slots: u32) -> Result<Vec<Play>, Error> {
        let wish = slots.max(1);
        let hello = v1::Hello {
            run: run.id.clone(),
            client: Some(client_info()),
            slots: wish,
            sensors: Some(sensors.to_wire(self.packing)?),
            resume: false,
            known: Vec::new(),
        };
        let Greeting::Welcome { requests, responses, welcome } =
            greet(&self.channel, &run.token, hello.clone()).await?
        else {
            return Err(Error::protocol("the run ended before Welcome"));
        };
        let mut agreement = Agreement::new(*welcome, &sensors, self.packing)?;
        // Surplus slots would remain without a player.
        agreement.slots = agreement.slots.min(wish);
        let reconnector = Reconnector {
            channel: self.channel.clone(),
            patience: self.patience,
            token: run.token.clone(),
            hello,
        };
        let (connection, receivers) = Connection::open(agreement, requests, responses, reconnector);
        Ok((0..).zip(receivers).map(|(slot, events)| Play::new(connection.clone(), slot, events)).collect())
    }

    async fn ask<M: Clone, A, F>(
        &self,
        attempted: &'static str,
        message: M,
        call: impl Fn(Runs, Request<M>) -> F,
    ) -> Result<A, Error>
    where
        F: Future<Output = Result<tonic::Response<A>, Status>>,
    {
        let team = bearer(&self.token)?;
        let again = || call(self.runs_client(), signed(plain(message.clone()), &team));
        persist(attempted, self.patience, again).await
    }

    fn runs_client(&self) -> Runs {
        RunServiceClient::new(self.channel.clone())
    }
}

fn client_info() -> v1::ClientInfo {
    v1::ClientInfo {
        name: "avln-client".to_owned(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        api_minor: API_MINOR,
    }
}

fn not_arena(address: &str, error: Error) -> Error {
    let foreign = |detail: String| Error::NotArena { address: address.to_owned(), detail };
    // Every refusal by an Arena server has a reason.
    match error {
        Error::Refused { reason: v1::Reason::Unspecified, message, .. } => foreign(message),
        Error::Lost { detail, .. } => foreign(detail),
        other => other,
    }
}
