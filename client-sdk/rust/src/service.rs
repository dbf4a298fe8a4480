//! Phases, runs, quota and account.

use crate::action::{EndReason, MethodType, Order, wire_enum};
use crate::error::Error;
use crate::summary::{self, Metric, Progress};
use crate::task::FeedbackRule;
use avln_proto::v1;
use tonic::Streaming;

/// Server information.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ServerInfo {
    /// Name.
    pub name: String,
    /// Server program version.
    pub version: String,
    /// Highest supported minor version in `avln.v1`.
    pub api_minor: u32,
    /// Benchmark version; changes if scores may change.
    pub benchmark: String,
    /// True if the server is stopping and accepts no new runs.
    pub draining: bool,
    /// Announcement for people; empty: none.
    pub notice: String,
    /// The server's clock when it answered, milliseconds since 1970 UTC.
    pub time_unix_ms: i64,
}

/// A phase: episodes under equal conditions.
#[derive(Clone, Debug, PartialEq)]
pub struct Phase {
    /// Id used in [`RunOptions::new`].
    pub id: String,
    /// Name for people.
    pub title: String,
    /// Text for people.
    pub description: String,
    /// Orders available to a run.
    pub orders: Vec<Order>,
    /// Episodes in a run.
    pub episodes: u32,
    /// Most slots per run.
    pub max_slots: u32,
    /// Feedback to a Submit.
    pub feedback: FeedbackRule,
    /// Acceptance of new runs.
    pub state: PhaseState,
    /// Reason for the state, for people; may be empty.
    pub state_reason: String,
    /// Opening time, seconds since 1970 UTC; 0: always open.
    pub opens_unix_s: i64,
    /// Closing time, seconds since 1970 UTC; 0: never.
    pub closes_unix_s: i64,
    /// The organiser's commitment before the phase; may be empty.
    pub commitment: String,
    /// Rule set name and version.
    pub rules: String,
}

wire_enum! {
    /// A phase's acceptance for new runs.
    PhaseState {
        /// Not open yet.
        Upcoming,
        /// Accepts runs.
        Open,
        /// Paused by the organiser; open runs continue.
        Paused,
        /// Over.
        Closed,
    }
}

/// Settings for a new run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunOptions {
    pub(crate) phase: String,
    method: v1::MethodInfo,
    order: Order,
    pub(crate) request_id: String,
}

impl RunOptions {
    /// A run of `method`, the leaderboard name, in `phase`, or if empty in the practice phase; unordered.
    pub fn new(phase: impl Into<String>, method: impl Into<String>) -> Self {
        let method = v1::MethodInfo { name: method.into(), ..v1::MethodInfo::default() };
        Self { phase: phase.into(), method, order: Order::default(), request_id: String::new() }
    }

    /// Sets the goal order.
    pub fn order(mut self, order: Order) -> Self {
        self.order = order;
        self
    }

    /// Sets the method version.
    pub fn method_version(mut self, version: impl Into<String>) -> Self {
        self.method.version = version.into();
        self
    }

    /// Sets the method type, shown on the leaderboard.
    pub fn method_type(mut self, method_type: MethodType) -> Self {
        self.method.method_type = method_type.to_wire().into();
        self
    }

    /// Sets a description for people.
    pub fn description(mut self, text: impl Into<String>) -> Self {
        self.method.description = text.into();
        self
    }

    /// Sets the code address, http(s).
    pub fn code_url(mut self, url: impl Into<String>) -> Self {
        self.method.code_url = url.into();
        self
    }

    /// Sets the idempotency key, at most 64 characters: a repeated key returns the same run. Default: a unique key.
    pub fn request_id(mut self, id: impl Into<String>) -> Self {
        self.request_id = id.into();
        self
    }

    pub(crate) fn into_wire(self, client: v1::ClientInfo) -> v1::StartRunRequest {
        v1::StartRunRequest {
            phase: self.phase,
            order: self.order.to_wire() as i32,
            method: Some(self.method),
            client_request_id: self.request_id,
            client: Some(client),
        }
    }
}

/// A run with its token.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Run {
    /// Id; empty when only the token is known.
    pub id: String,
    /// Token for this run only.
    pub token: String,
    /// Episode count; 0 when only the token is known.
    pub episodes: u32,
    /// Most slots; 0 when only the token is known.
    pub max_slots: u32,
}

impl Run {
    /// Creates a run from its token, as in a sealed container.
    pub fn from_token(token: impl Into<String>) -> Self {
        Self { id: String::new(), token: token.into(), episodes: 0, max_slots: 0 }
    }

    pub(crate) fn from_wire(started: v1::StartRunResponse) -> Result<Self, Error> {
        let run = started.run.ok_or_else(|| Error::protocol("StartRun returned no run"))?;
        let episodes = run.progress.unwrap_or_default().total;
        Ok(Self { id: run.id, token: started.run_token, episodes, max_slots: started.max_slots })
    }
}

wire_enum! {
    /// Run state.
    RunState {
        /// Started, never connected.
        Created,
        /// In progress.
        Running,
        /// The server is stopping: open episodes finish, no others begin.
        Draining,
        /// Over: the agent played every episode.
        Completed,
        /// Over: the server failed.
        Failed,
        /// Over: cancelled by the team, or left by the agent with episodes unplayed.
        Cancelled,
        /// Over: out of wall time.
        Expired,
    }
}

/// Run status.
#[derive(Clone, Debug, PartialEq)]
pub struct RunStatus {
    /// Id.
    pub id: String,
    /// Phase.
    pub phase: String,
    /// Method name.
    pub method: String,
    /// Method type; `None` if it is undeclared or unknown to this client version.
    pub method_type: Option<MethodType>,
    /// State.
    pub state: RunState,
    /// Reason for the state, for people.
    pub state_reason: String,
    /// Progress.
    pub progress: Progress,
    /// Episode count by end reason.
    pub ends: Vec<(EndReason, u32)>,
    /// Metrics; `None` if the phase hides them.
    pub metrics: Option<Vec<Metric>>,
    /// True if the run counts against the quota.
    pub charged: bool,
    /// Reason for (not) charging, for people.
    pub charge_reason: String,
    /// Web page; empty: none.
    pub url: String,
}

wire_enum! {
    /// Quota window.
    QuotaWindow {
        /// Calendar day, UTC.
        Day,
        /// Calendar month, UTC.
        Month,
        /// Whole phase.
        Total,
        /// Open runs.
        Concurrent,
        /// Uncharged runs in the whole phase.
        Uncharged,
    }
}

/// A team's remaining quota.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Quota {
    /// Phase.
    pub phase: String,
    /// Window.
    pub window: QuotaWindow,
    /// Runs granted in the window; `None`: unlimited.
    pub limit: Option<u32>,
    /// Runs counted in the window.
    pub used: u32,
    /// Runs left; `None`: unlimited.
    pub remaining: Option<u32>,
    /// Time when `remaining` next increases, seconds since 1970 UTC; 0: never.
    pub next_increase_unix_s: i64,
    /// Counted runs and reasons, oldest first.
    pub charges: Vec<(String, String)>,
}

impl Quota {
    /// Returns true if it limits the number of started runs, in total or per time.
    pub fn is_counted(&self) -> bool {
        self.limit.is_some() && !matches!(self.window, QuotaWindow::Concurrent | QuotaWindow::Uncharged)
    }
}

pub(crate) fn phase_to_practise<'a>(phases: &'a [Phase], quotas: &[Quota]) -> Result<&'a Phase, Error> {
    // A client without a chosen phase must not use up quota.
    let is_counted = |phase: &Phase| quotas.iter().any(|quota| quota.phase == phase.id && quota.is_counted());
    let open = phases.iter().filter(|phase| phase.state == PhaseState::Open);
    let free: Vec<_> = open.filter(|phase| !is_counted(phase)).collect();
    let usual = free.iter().find(|phase| phase.id == "practice");
    match (free.as_slice(), usual) {
        ([only], _) | (_, Some(only)) => Ok(only),
        _ => Err(Error::Phase {
            free: free.iter().map(|phase| phase.id.clone()).collect(),
            known: phases.iter().map(|phase| phase.id.clone()).collect(),
        }),
    }
}

/// Token owner.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Account {
    /// Team name.
    pub team: String,
    /// Token name.
    pub token_name: String,
    /// Expiry time, seconds since 1970 UTC; 0: never.
    pub expires_unix_s: i64,
}

/// A run's states as they change.
#[derive(Debug)]
pub struct RunWatch(pub(crate) Streaming<v1::WatchRunResponse>);

impl RunWatch {
    /// Returns the next state; `None` after an end state. Fails if the connection is lost.
    pub async fn next(&mut self) -> Result<Option<RunStatus>, Error> {
        let next = self.0.message().await.map_err(|status| Error::from_status("watch a run", &status))?;
        next.map(|response| RunStatus::from_wire(response.run)).transpose()
    }
}

impl ServerInfo {
    pub(crate) fn from_wire(info: v1::GetServerInfoResponse) -> Self {
        let draining = info.state() == v1::ServerState::Draining;
        Self {
            name: info.name,
            version: info.version,
            api_minor: info.api_minor,
            benchmark: info.benchmark,
            draining,
            notice: info.notice,
            time_unix_ms: info.server_time_unix_ms,
        }
    }
}

impl Phase {
    pub(crate) fn from_wire(phase: v1::Phase) -> Self {
        Self {
            orders: phase.orders.iter().filter_map(|&order| Order::from_wire(order)).collect(),
            feedback: FeedbackRule::from_wire(phase.feedback),
            state: PhaseState::from_wire(phase.state),
            id: phase.id,
            title: phase.title,
            description: phase.description,
            episodes: phase.episodes,
            max_slots: phase.max_slots,
            rules: phase.rules,
            state_reason: phase.state_reason,
            opens_unix_s: phase.opens_unix_s,
            closes_unix_s: phase.closes_unix_s,
            commitment: phase.commitment,
        }
    }
}

impl RunStatus {
    pub(crate) fn from_wire(run: Option<v1::Run>) -> Result<Self, Error> {
        let run = run.ok_or_else(|| Error::protocol("the run status is empty"))?;
        let method = run.method.unwrap_or_default();
        Ok(Self {
            state: RunState::from_wire(run.state),
            progress: Progress::from_wire(run.progress),
            ends: summary::ends(&run.ends),
            metrics: run.metrics.map(summary::metrics),
            id: run.id,
            phase: run.phase,
            method_type: MethodType::from_wire(method.method_type()),
            method: method.name,
            state_reason: run.state_reason,
            charged: run.charged,
            charge_reason: run.charge_reason,
            url: run.url,
        })
    }
}

impl RunState {
    /// Returns true if the run has ended.
    pub fn is_over(self) -> bool {
        matches!(self, Self::Completed | Self::Failed | Self::Cancelled | Self::Expired)
    }
}

impl Quota {
    pub(crate) fn from_wire(quota: v1::Quota) -> Self {
        Self {
            window: QuotaWindow::from_wire(quota.window),
            phase: quota.phase,
            limit: quota.limit,
            used: quota.used,
            remaining: quota.remaining,
            next_increase_unix_s: quota.next_increase_unix_s,
            charges: quota.charges.into_iter().map(|charge| (charge.run, charge.reason)).collect(),
        }
    }
}

impl Account {
    pub(crate) fn from_wire(answer: v1::WhoAmIResponse) -> Self {
        Self { team: answer.team, token_name: answer.token_name, expires_unix_s: answer.expires_unix_s }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn phase(id: &str, state: v1::PhaseState) -> Phase {
        Phase::from_wire(v1::Phase { id: id.into(), state: state.into(), ..v1::Phase::default() })
    }

    fn quota(phase: &str, window: v1::QuotaWindow, limit: Option<u32>) -> Quota {
        Quota::from_wire(v1::Quota {
            phase: phase.into(),
            window: window.into(),
            limit,
            ..v1::Quota::default()
        })
    }

    #[test]
    fn method_types_cross_the_wire() {
        let options = RunOptions::new("practice", "walker").method_type(MethodType::Imitation);
        let method = options.into_wire(v1::ClientInfo::default()).method;
        assert_eq!(method.as_ref().map(v1::MethodInfo::method_type), Some(v1::MethodType::Imitation));
        let declared = |method| {
            RunStatus::from_wire(Some(v1::Run { method, ..v1::Run::default() })).unwrap().method_type
        };
        assert_eq!(declared(method), Some(MethodType::Imitation));
        assert_eq!(declared(None), None);
    }

    #[test]
    fn missing_phase_spends_no_run() {
        let open = v1::PhaseState::Open;
        let phases = [
            phase("val", open),
            phase("test", open),
            phase("practice", open),
            phase("old", v1::PhaseState::Closed),
        ];
        let day = |phase| quota(phase, v1::QuotaWindow::Day, Some(5));
        let side_by_side = quota("val", v1::QuotaWindow::Concurrent, Some(2));
        let meant = |count, quotas: &[Quota]| {
            phase_to_practise(&phases[..count], quotas)
                .map(|phase| phase.id.clone())
                .map_err(|error| error.to_string())
        };
        assert_eq!(meant(2, &[day("test"), side_by_side]).as_deref(), Ok("val"));
        assert_eq!(meant(4, &[day("test")]).as_deref(), Ok("practice"));
        let several = meant(2, &[]).unwrap_err();
        assert!(
            several.contains("several phases have no quota: val, test; choose a phase with --phase"),
            "{several}"
        );
        let counted = meant(2, &[day("test"), day("val")]).unwrap_err();
        assert!(counted.contains("known phases: val, test; choose a phase"), "{counted}");
        assert!(meant(0, &[]).unwrap_err().contains("no phase for your team"));
    }
}
