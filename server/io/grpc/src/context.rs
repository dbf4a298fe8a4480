//! State shared by all gRPC services.

use crate::{
    host::{Host, Interrupted, OpenRun},
    limits::Limits,
    refusal::{Failure, Refusal, Result, call_host},
    registry::{SessionGuard, SessionRegistry},
    session::Session,
    sim_pool::SimPool,
    spans::RunSpans,
    watchdog::Watchdog,
    wire,
};
use avln_net::{HeldPlace, Places};
use avln_proto::v1::{self, Reason};
use std::sync::Arc;
use tonic::{Response, Status, metadata::MetadataMap};

/// State shared by all gRPC services.
pub(crate) struct ServiceContext<H: Host> {
    pub(crate) host: Arc<H>,
    pub(crate) limits: Arc<Limits>,
    pub(crate) registry: Arc<SessionRegistry<Session<H>>>,
    pub(crate) spans: Arc<RunSpans>,
    pool: SimPool,
    watchdog: Watchdog,
    /// WatchRun calls per team.
    watchers: Arc<Places<String>>,
}

impl<H: Host> ServiceContext<H> {
    pub(crate) fn new(host: Arc<H>, limits: Limits) -> Arc<Self> {
        let limits = Arc::new(limits);
        let watchdog = host.control().map(|control| control.watchdog().clone()).unwrap_or_default();
        let pool = SimPool::new(limits.max_simulations, watchdog.clone());
        let watchers = Places::new(Some(limits.max_watchers), limits.max_watchers);
        let registry = SessionRegistry::new(limits.clone());
        Arc::new(Self { host, registry, limits, spans: Arc::default(), pool, watchdog, watchers })
    }

    /// Refuses new runs while too many simulations hang.
    pub(crate) fn check_sound(&self) -> Result<(), Refusal> {
        let hanging = self.watchdog.hanging();
        if hanging < self.limits.max_hanging.max(1) {
            return Ok(());
        }
        let message = format!(
            "{hanging} simulations of the server hang, so no run can start; running runs continue. The organiser must restart the server"
        );
        Err(Refusal::new(Reason::NoCapacity, message).retry_after(300))
    }

    /// Takes a team's place among WatchRun calls, until it is dropped.
    pub(crate) fn watch(&self, team: &str) -> Result<HeldPlace<String>, Refusal> {
        self.watchers.take(team.to_owned()).map_err(|share| {
            let all = self.limits.max_watchers;
            let message = format!("the team watches its share of {share} of {all} runs; use GetRun");
            Refusal::new(Reason::NoCapacity, message).retry_after(60)
        })
    }

    /// Returns a run token's open run.
    pub(crate) async fn open_run(&self, token: &str) -> Result<OpenRun> {
        let open = self.any_run(token).await?;
        let Some(state) = &open.over else { return Ok(open) };
        let message = format!("run '{}' is {state}; start another run", open.run);
        Err(Failure::new(Reason::RunOver, message))
    }

    /// Returns a run token's run, open or over.
    pub(crate) async fn any_run(&self, token: &str) -> Result<OpenRun> {
        let token = token.to_owned();
        call_host("open a run", &self.host, |host| async move { host.open_run(&token).await }).await
    }

    /// Completes a run without episodes left. With `abandons`, ends the run in any case.
    pub(crate) async fn finish_run(&self, run: &str, abandons: bool) -> Result<v1::RunEnd> {
        let id = run.to_owned();
        let finish = |host: Arc<H>| async move { host.finish_run(&id, abandons).await };
        let status = call_host("finish a run", &self.host, finish).await?;
        if !status.state.is_open() {
            self.spans.end(run, status.state.as_str());
        }
        Ok(wire::run_end(status))
    }

    pub(crate) fn session(&self, interrupted: Interrupted<H::Episode>) -> Arc<Session<H>> {
        let run = self.spans.enter(&interrupted.open.run);
        Arc::new(Session::open(self.host.clone(), self.pool.clone(), &self.limits, interrupted, &run))
    }
}

pub(crate) type RunGuard<H> = SessionGuard<Session<H>>;

pub(crate) type Reply<T> = Result<Response<T>, Status>;

pub(crate) fn bearer(metadata: &MetadataMap) -> Result<String, Refusal> {
    let Some(value) = metadata.get("authorization") else {
        let message = "this call needs the metadata 'authorization: Bearer <token>'";
        return Err(Refusal::new(Reason::TokenMissing, message));
    };
    let token = value.to_str().ok().and_then(|text| text.strip_prefix("Bearer ")).map(str::trim);
    match token {
        Some(token) if (1..=Limits::MAX_TOKEN_BYTES).contains(&token.len()) => Ok(token.to_owned()),
        _ => {
            let limit = Limits::MAX_TOKEN_BYTES;
            let message = format!("authorization is not 'Bearer ' and a token of 1 to {limit} bytes");
            Err(Refusal::new(Reason::TokenMalformed, message))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_bearer_tokens_pass() {
        let read = |value: Option<&str>| {
            let mut metadata = MetadataMap::new();
            if let Some(value) = value {
                metadata.insert("authorization", value.parse().unwrap());
            }
            bearer(&metadata).map_err(|refusal| refusal.reason)
        };
        assert_eq!(read(Some("Bearer abc")), Ok("abc".to_owned()));
        assert_eq!(read(None), Err(Reason::TokenMissing));
        let long = format!("Bearer {}", "x".repeat(Limits::MAX_TOKEN_BYTES + 1));
        for wrong in ["abc", "Basic abc", "Bearer ", "Bearer", &long] {
            assert_eq!(read(Some(wrong)), Err(Reason::TokenMalformed), "{wrong}");
        }
    }
}
