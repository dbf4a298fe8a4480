//! Run service: a team's runs and quotas.

use crate::{
    attachment::StopReason,
    context::{Reply, ServiceContext, bearer},
    host::{Host, RunRequest},
    limits::Limits,
    refusal::{Failure, Refusal, Result, call_host},
    wire,
};
use avln_challenge::{Account, MethodInfo, PhaseInfo, RunStatus, TokenScope, names::is_visible_text};
use avln_episode::Order;
use avln_proto::v1::{self, Reason, run_service_server::RunService};
use std::{sync::Arc, time::Duration};
use tokio::{sync::mpsc, time::sleep};
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Request, Response, Status, metadata::MetadataMap};

const WATCH_INTERVAL: Duration = Duration::from_secs(1);
// Runs per page.
const PAGE: usize = 50;
const LARGEST_PAGE: usize = 200;
// Longest texts in requests, characters.
const MAX_DESCRIPTION_CHARS: usize = 2000;
const MAX_URL_CHARS: usize = 500;
const MAX_NOTE_CHARS: usize = 500;
const MAX_REQUEST_ID_CHARS: usize = 64;

pub(crate) struct RunCalls<H: Host>(pub(crate) Arc<ServiceContext<H>>);

impl<H: Host> RunCalls<H> {
    async fn account(&self, metadata: &MetadataMap) -> Result<Account> {
        let token = bearer(metadata)?;
        call_host("look an account up", &self.0.host, |host| async move { host.account(&token).await }).await
    }

    /// Returns the account, if it belongs to a team.
    async fn team(&self, metadata: &MetadataMap) -> Result<Account> {
        let account = self.account(metadata).await?;
        match account.scope {
            TokenScope::Participant | TokenScope::ReadOnly => Ok(account),
            TokenScope::Organiser | TokenScope::Run => {
                Err(scope_refusal("an organiser's token has no runs; use a team's token"))
            }
        }
    }

    /// Returns the account, if it may start and cancel runs.
    async fn participant(&self, metadata: &MetadataMap) -> Result<Account> {
        let account = self.team(metadata).await?;
        match account.scope {
            TokenScope::Participant => Ok(account),
            _ => Err(scope_refusal("the token is read-only; use the team's account token")),
        }
    }

    async fn status(&self, account: &Account, run: &str) -> Result<RunStatus> {
        let (account, run) = (account.clone(), checked_id(run)?);
        call_host("look a run up", &self.0.host, |host| async move { host.run(&account, &run).await }).await
    }

    /// Returns the requested order, or the phase's only order.
    async fn order(&self, wanted: v1::Order, account: &Account, phase: &str) -> Result<Order> {
        match wanted {
            v1::Order::Ordered => return Ok(Order::Ordered),
            v1::Order::Unordered => return Ok(Order::Unordered),
            v1::Order::Unspecified => {}
        }
        let account = account.clone();
        let phases = |host: Arc<H>| async move { host.phases(Some(&account)).await };
        Ok(only_order(&call_host("list phases", &self.0.host, phases).await?, phase)?)
    }

    async fn request(&self, account: &Account, start: v1::StartRunRequest) -> Result<RunRequest> {
        let info = self.0.host.info();
        wire::check_client(start.client.as_ref(), &info.clients)?;
        let method = start.method.clone().unwrap_or_default();
        let phase = checked_id(&start.phase)?;
        Ok(RunRequest {
            method: checked_method(method)?,
            client_request_id: text("client_request_id", &start.client_request_id, 0, MAX_REQUEST_ID_CHARS)?,
            order: self.order(start.order(), account, &phase).await?,
            phase,
        })
    }
}

#[tonic::async_trait]
impl<H: Host> RunService for RunCalls<H> {
    type WatchRunStream = ReceiverStream<Result<v1::WatchRunResponse, Status>>;

    async fn start_run(&self, request: Request<v1::StartRunRequest>) -> Reply<v1::StartRunResponse> {
        let account = self.participant(request.metadata()).await?;
        self.0.registry.check_open()?;
        self.0.check_sound()?;
        let asked = self.request(&account, request.into_inner()).await?;
        let team = account.clone();
        let start = |host: Arc<H>| async move { host.start_run(&team, asked).await };
        let ticket = call_host("start a run", &self.0.host, start).await?;
        let status = self.status(&account, &ticket.run).await?;
        Ok(Response::new(v1::StartRunResponse {
            run: Some(wire::run(status)),
            run_token: ticket.token,
            max_slots: ticket.max_slots.clamp(1, Limits::MAX_SLOTS),
            time: Some(wire::time_limits(&ticket.time)),
            quota: ticket.quota.map(wire::quota),
        }))
    }

    async fn get_run(&self, request: Request<v1::GetRunRequest>) -> Reply<v1::GetRunResponse> {
        let account = self.team(request.metadata()).await?;
        let status = self.status(&account, &request.get_ref().run).await?;
        Ok(Response::new(v1::GetRunResponse { run: Some(wire::run(status)) }))
    }

    async fn watch_run(&self, request: Request<v1::WatchRunRequest>) -> Reply<Self::WatchRunStream> {
        let account = self.team(request.metadata()).await?;
        let run = request.into_inner().run;
        let first = self.status(&account, &run).await?;
        let place = self.0.watch(&account.team)?;
        let (updates, stream) = mpsc::channel(1);
        let runs = Self(self.0.clone());
        tokio::spawn(async move {
            runs.watch(account, first, updates).await;
            drop(place);
        });
        Ok(Response::new(ReceiverStream::new(stream)))
    }

    async fn cancel_run(&self, request: Request<v1::CancelRunRequest>) -> Reply<v1::CancelRunResponse> {
        let account = self.participant(request.metadata()).await?;
        // The lookup comes first: only the run's own team may stop its session. Then the store: if the session ended first, with the
        // last episode, the run would be completed instead of cancelled.
        let run = self.status(&account, &request.get_ref().run).await?.run;
        let (team, id) = (account.clone(), run.clone());
        call_host("cancel a run", &self.0.host, |host| async move { host.cancel_run(&team, &id).await })
            .await?;
        self.0.registry.stop(&run, StopReason::Cancelled).await;
        let status = self.status(&account, &run).await?;
        self.0.spans.end(&run, status.state.as_str());
        Ok(Response::new(v1::CancelRunResponse { run: Some(wire::run(status)) }))
    }

    async fn list_runs(&self, request: Request<v1::ListRunsRequest>) -> Reply<v1::ListRunsResponse> {
        let account = self.team(request.metadata()).await?;
        let runs =
            call_host("list runs", &self.0.host, |host| async move { host.runs(&account).await }).await?;
        Ok(Response::new(page(runs, request.get_ref())?))
    }

    async fn get_quota(&self, request: Request<v1::GetQuotaRequest>) -> Reply<v1::GetQuotaResponse> {
        let account = self.team(request.metadata()).await?;
        let phase = request.into_inner().phase;
        let phase = if phase.is_empty() { None } else { Some(checked_id(&phase)?) };
        let quotas = |host: Arc<H>| async move { host.quotas(&account, phase.as_deref()).await };
        let quotas = call_host("look a quota up", &self.0.host, quotas).await?;
        let quotas = quotas.into_iter().map(wire::quota).collect();
        Ok(Response::new(v1::GetQuotaResponse { quotas }))
    }

    async fn who_am_i(&self, request: Request<v1::WhoAmIRequest>) -> Reply<v1::WhoAmIResponse> {
        let account = self.account(request.metadata()).await?;
        Ok(Response::new(v1::WhoAmIResponse {
            team: account.team,
            token_name: account.token_name,
            scope: wire::scope(account.scope).into(),
            expires_unix_s: wire::seconds(account.expires_unix_ms),
        }))
    }
}

impl<H: Host> RunCalls<H> {
    /// Sends the run after each change, until it is over, the caller hangs up or the server stops.
    async fn watch(
        self,
        account: Account,
        first: RunStatus,
        updates: mpsc::Sender<Result<v1::WatchRunResponse, Status>>,
    ) {
        let mut sent: Option<v1::Run> = None;
        let run = first.run.clone();
        let mut status = Ok(first);
        loop {
            let update = status.map(wire::run);
            let over = update.as_ref().map_or(true, |run| run.ended_unix_ms != 0);
            if update.as_ref().ok() != sent.as_ref() || over {
                sent = update.as_ref().ok().cloned();
                let response = update.map(|run| v1::WatchRunResponse { run: Some(run) });
                if updates.send(response.map_err(Status::from)).await.is_err() || over {
                    return;
                }
            }
            tokio::select! {
                biased;
                () = updates.closed() => return,
                () = self.0.registry.shutting() => {}
                () = sleep(WATCH_INTERVAL) => {}
            }
            status = match self.0.registry.check_open() {
                Ok(()) => self.status(&account, &run).await,
                Err(draining) => Err(draining.into()),
            };
        }
    }
}

fn scope_refusal(message: &str) -> Failure {
    Failure::new(Reason::TokenScope, message)
}

fn only_order(phases: &[PhaseInfo], id: &str) -> Result<Order, Refusal> {
    let Some(phase) = phases.iter().find(|phase| phase.id == id) else {
        let message = format!("phase '{id}' is unknown; list the phases with ListPhases");
        return Err(Refusal::new(Reason::PhaseUnknown, message));
    };
    if let [order] = phase.orders[..] {
        return Ok(order);
    }
    let message = format!("phase '{id}' has several orders; set order to ORDERED or UNORDERED");
    Err(Refusal::new(Reason::BadRequest, message))
}

fn checked_id(id: &str) -> Result<String, Refusal> {
    text("id", id, 1, Limits::MAX_TEXT_BYTES)
}

fn checked_method(method: v1::MethodInfo) -> Result<MethodInfo, Refusal> {
    Ok(MethodInfo {
        name: text("method.name", method.name.trim(), 1, MethodInfo::MAX_NAME_CHARS)?,
        version: text("method.version", method.version.trim(), 0, MethodInfo::MAX_VERSION_CHARS)?,
        method_type: wire::declared_type(method.method_type()),
        description: paragraphs("method.description", method.description.trim(), MAX_DESCRIPTION_CHARS)?,
        code_url: url("method.code_url", method.code_url.trim())?,
        paper_url: url("method.paper_url", method.paper_url.trim())?,
        weights_licence: text("method.weights_licence", method.weights_licence.trim(), 0, MAX_NOTE_CHARS)?,
        external_data: text("method.external_data", method.external_data.trim(), 0, MAX_NOTE_CHARS)?,
    })
}

fn url(field: &str, value: &str) -> Result<String, Refusal> {
    // Pages link to it: other schemes, such as javascript, would run in the browsers of visitors.
    let is_http = value.starts_with("https://") || value.starts_with("http://");
    if !value.is_empty() && !is_http {
        let message = format!("{field} is not an address; begin with https:// or leave it empty");
        return Err(Refusal::new(Reason::BadRequest, message));
    }
    text(field, value, 0, MAX_URL_CHARS)
}

/// Checks a text that may have several lines.
fn paragraphs(field: &str, value: &str, max: usize) -> Result<String, Refusal> {
    let lines: String = value.chars().map(|letter| if letter == '\n' { ' ' } else { letter }).collect();
    text(field, &lines, 0, max)?;
    Ok(value.to_owned())
}

/// Checks a text's length, in characters, and refuses control characters and invisible ones.
fn text(field: &str, value: &str, min: usize, max: usize) -> Result<String, Refusal> {
    if !is_visible_text(value, &(min..=max)) {
        let length = value.chars().count();
        let message = format!(
            "{field} has {length} characters; use {min} to {max}, none of them a control character or invisible"
        );
        return Err(Refusal::new(Reason::BadRequest, message));
    }
    Ok(value.to_owned())
}

/// Returns a page of runs. A page token is the id of the run before the page.
fn page(runs: Vec<RunStatus>, request: &v1::ListRunsRequest) -> Result<v1::ListRunsResponse, Refusal> {
    let size = match request.page_size as usize {
        0 => PAGE,
        size => size.min(LARGEST_PAGE),
    };
    let wanted = |run: &RunStatus| request.phase.is_empty() || run.phase == request.phase;
    let mut runs: Vec<_> = runs.into_iter().filter(wanted).collect();
    if !request.page_token.is_empty() {
        let last = runs.iter().position(|run| run.run == request.page_token);
        let last = last.ok_or_else(|| {
            Refusal::new(Reason::BadRequest, "page_token is not from ListRuns; start without it")
        })?;
        runs.drain(..=last);
    }
    let more = runs.len() > size;
    runs.truncate(size);
    let next = runs.last().filter(|_| more).map(|run| run.run.clone());
    Ok(v1::ListRunsResponse {
        runs: runs.into_iter().map(wire::run).collect(),
        next_page_token: next.unwrap_or_default(),
    })
}
