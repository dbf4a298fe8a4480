//! The toy host.

use super::{Plan, Quirk, ToyRunner, soon};
use avln_challenge::{
    Account, Charge, EpisodeOutcome, MethodInfo, MethodType, PhaseInfo, PhaseState, Quota, QuotaWindow,
    RunState, RunStatus, TokenScope, Visibility,
};
use avln_episode::{Action, EndReason, FeedbackRule, Order, Rules, Sensors, TimeLimits};
use avln_grpc::{
    Acted, ClientRange, Digests, Episode, EpisodeLog, Host, HostedEpisode, Interrupted, OpenRun, Reason,
    Refusal, Restored, RunRequest, RunTicket, ServerInfo, StoredEnd,
};
use std::{
    collections::{BTreeMap, VecDeque},
    io,
    sync::{Arc, Mutex, MutexGuard},
    time::Duration,
};
use tokio::sync::watch;

pub(crate) const ACCOUNT: &str = "account-token";
/// Read-only token of the same team.
pub(crate) const LOOKING: &str = "looking-token";
/// Token of the organiser.
pub(crate) const ORGANISER: &str = "organiser-token";
pub(crate) const RUN: &str = "run_toy";
pub(crate) const RUN_TOKEN: &str = "run-token";

/// Episode that was concluded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Concluded {
    pub(crate) handle: String,
    pub(crate) end: Option<EndReason>,
    pub(crate) steps: u32,
}

pub(crate) struct ToyHost {
    state: Mutex<State>,
    concluded: watch::Sender<Vec<Concluded>>,
    total: u32,
    max_steps: u32,
    most_open: usize,
    max_slots: u32,
    shows_metrics: bool,
    time: TimeLimits,
    book: Book,
}

/// Log of open episodes by handle. A server with another's book continues the episodes.
pub(crate) type Book = Arc<Mutex<BTreeMap<String, Page>>>;

#[derive(Clone, Debug, Default)]
pub(crate) struct Page {
    slot: u32,
    pub(crate) actions: Vec<Action>,
    pub(crate) restarts: u32,
    sensors: Option<Sensors>,
}

struct ToyLog {
    book: Book,
    handle: String,
}

impl EpisodeLog for ToyLog {
    fn acting(&mut self, _: u32) -> io::Result<()> {
        Ok(())
    }

    fn acted(&mut self, acted: &Acted) -> io::Result<()> {
        let mut book = self.book.lock().unwrap();
        let page = book.get_mut(&self.handle).unwrap();
        page.actions.push(acted.action);
        assert_eq!(acted.step as usize, page.actions.len());
        Ok(())
    }

    fn clock_restarted(&mut self, _: u32, _: Duration) -> io::Result<()> {
        self.book.lock().unwrap().get_mut(&self.handle).unwrap().restarts += 1;
        Ok(())
    }
}

struct State {
    left: VecDeque<Quirk>,
    handed_out: u64,
    finished: bool,
    cancelled: bool,
    expired: bool,
    deadline_unix_ms: Option<i64>,
    /// Largest side of pictures that the phase allows.
    max_side: u32,
    lost: Vec<String>,
    requests: Vec<RunRequest>,
}

impl ToyHost {
    pub(crate) fn new(plan: Plan, book: Book) -> Self {
        let state = State {
            left: plan.episodes.into(),
            handed_out: 0,
            finished: false,
            cancelled: false,
            expired: false,
            deadline_unix_ms: None,
            max_side: 512,
            lost: Vec::new(),
            requests: Vec::new(),
        };
        Self {
            total: state.left.len() as u32,
            state: Mutex::new(state),
            concluded: watch::Sender::default(),
            max_steps: plan.max_steps,
            most_open: plan.most_open,
            max_slots: plan.max_slots,
            shows_metrics: plan.shows_metrics,
            time: plan.time,
            book,
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap()
    }

    fn run_state(&self) -> RunState {
        let state = self.state();
        match (state.expired, state.cancelled, state.finished) {
            (true, ..) => RunState::Expired,
            (_, true, _) => RunState::Cancelled,
            (.., true) => RunState::Completed,
            _ => RunState::Running,
        }
    }

    /// Adds a plain episode and reopens the run.
    pub(crate) fn refill(&self) {
        let mut state = self.state();
        (state.finished, state.cancelled) = (false, false);
        state.left.push_back(Quirk::None);
    }

    /// Lowers the largest side of pictures.
    pub(crate) fn narrow(&self, max_side: u32) {
        self.state().max_side = max_side;
    }

    fn finish_if(&self, none_is_open: bool) {
        let mut state = self.state();
        if none_is_open && state.left.is_empty() {
            state.finished = true;
        }
    }

    fn sensors(&self) -> Sensors {
        let side = self.state().max_side;
        Sensors::all(side, side)
    }

    /// Returns whether the run ended before all episodes were played.
    pub(crate) fn cancelled(&self) -> bool {
        self.state().cancelled
    }

    pub(crate) fn finished(&self) -> bool {
        self.state().finished
    }

    /// Lets the deadline of the run pass.
    pub(crate) fn time_is_over(&self) {
        self.state().deadline_unix_ms = Some(1);
    }

    /// Sets the deadline of the run, milliseconds since 1970.
    pub(crate) fn ends_at(&self, deadline_unix_ms: i64) {
        self.state().deadline_unix_ms = Some(deadline_unix_ms);
    }

    fn deadline_unix_ms(&self) -> Option<i64> {
        self.state().deadline_unix_ms
    }

    pub(crate) fn expired(&self) -> bool {
        self.state().expired
    }

    /// Returns the handles of lost episodes.
    pub(crate) fn lost(&self) -> Vec<String> {
        self.state().lost.clone()
    }

    pub(crate) fn requests(&self) -> Vec<RunRequest> {
        self.state().requests.clone()
    }

    /// Waits for `count` concluded episodes.
    pub(crate) async fn concluded(&self, count: usize) -> Vec<Concluded> {
        let mut watch = self.concluded.subscribe();
        soon(watch.wait_for(|list| list.len() >= count)).await.unwrap().clone()
    }

    /// Waits for `count` concluded episodes and returns their end reasons.
    pub(crate) async fn ends(&self, count: usize) -> Vec<Option<EndReason>> {
        self.concluded(count).await.into_iter().map(|concluded| concluded.end).collect()
    }

    fn hosted(&self, handle: String, episode: ToyRunner) -> HostedEpisode<ToyRunner> {
        let log = Box::new(ToyLog { book: self.book.clone(), handle: handle.clone() });
        HostedEpisode { handle, episode, ticket: 0, log, time: avln_grpc::TimeSpent::default() }
    }

    /// Returns the log of an open episode.
    pub(crate) fn page(&self, handle: &str) -> Page {
        self.book.lock().unwrap()[handle].clone()
    }

    fn done(&self) -> u32 {
        self.concluded.borrow().len() as u32
    }

    fn status(&self) -> RunStatus {
        RunStatus {
            run: RUN.into(),
            phase: "practice".into(),
            method: MethodInfo { method_type: Some(MethodType::Rl), ..MethodInfo::new("toy", "1") },
            order: Order::Unordered,
            state: self.run_state(),
            episodes: self.total,
            done: self.done(),
            in_flight: 2,
            created_unix_ms: 1_000,
            updated_unix_ms: 2_000,
            ends: vec![],
            metrics: self.shows_metrics.then(|| vec![("sr".into(), 0.5)]),
            ineligible_because: vec![],
            sealed: true,
            charge: Charge { run: RUN.into(), charged: true, reason: "it is open" },
            deadline_unix_ms: self.deadline_unix_ms(),
            url: String::new(),
        }
    }
}

fn account(scope: TokenScope) -> Account {
    Account { team: "red".into(), scope, token_name: "laptop".into(), expires_unix_ms: Some(77_000) }
}

/// Quota with one of three runs left today.
pub(crate) fn quota() -> Quota {
    Quota {
        phase: "practice".into(),
        window: QuotaWindow::Day,
        limit: Some(3),
        used: 2,
        remaining: Some(1),
        window_start_unix_ms: 86_400_000,
        next_increase_unix_ms: Some(172_800_000),
        charges: vec![Charge { run: "run_a".into(), charged: true, reason: "it was played" }],
    }
}

fn own(run: &str) -> Result<(), Refusal> {
    match run {
        RUN => Ok(()),
        other => Err(Refusal::new(Reason::RunUnknown, format!("the team has no run '{other}'"))),
    }
}

#[avln_grpc::async_trait]
impl Host for ToyHost {
    type Episode = ToyRunner;

    fn info(&self) -> ServerInfo {
        let range = ClientRange {
            name: "old-client".into(),
            min_version: "2.0.0".into(),
            install: "get version 2".into(),
            ..ClientRange::default()
        };
        ServerInfo {
            name: "toy".into(),
            version: "0.1.0".into(),
            benchmark: "1.0.0".into(),
            api_minor: 0,
            clients: vec![range],
        }
    }

    async fn phases(&self, account: Option<&Account>) -> Result<Vec<PhaseInfo>, Refusal> {
        Ok(vec![PhaseInfo {
            id: "practice".into(),
            title: if account.is_some() { "Practice of the team".into() } else { "Practice".into() },
            time: self.time,
            description: String::new(),
            orders: vec![Order::Unordered],
            rules: Rules::PAPER.into(),
            episode_count: self.total,
            feedback: FeedbackRule::None,
            max_slots: self.max_slots,
            sensors: self.sensors(),
            state: PhaseState::Open,
            state_reason: None,
            opens_unix_ms: None,
            closes_unix_ms: None,
            results: Visibility::Team,
            sealed: true,
            commitment: Some("c0ffee".into()),
            revealed: None,
        }])
    }

    async fn account(&self, token: &str) -> Result<Account, Refusal> {
        match token {
            ACCOUNT => Ok(account(TokenScope::Participant)),
            LOOKING => Ok(account(TokenScope::ReadOnly)),
            ORGANISER => Ok(account(TokenScope::Organiser)),
            "break" => panic!("the host's secret"),
            _ => Err(Refusal::new(Reason::TokenMalformed, "the token is unknown")),
        }
    }

    async fn start_run(&self, _: &Account, request: RunRequest) -> Result<RunTicket, Refusal> {
        if request.phase != "practice" {
            let message = format!("there is no phase '{}'", request.phase);
            return Err(Refusal::new(Reason::PhaseUnknown, message));
        }
        self.state().requests.push(request);
        Ok(RunTicket {
            run: RUN.into(),
            token: RUN_TOKEN.into(),
            episodes: self.total,
            max_slots: self.max_slots,
            time: self.time,
            quota: Some(quota()),
        })
    }

    async fn quotas(&self, _: &Account, _: Option<&str>) -> Result<Vec<Quota>, Refusal> {
        Ok(vec![quota()])
    }

    async fn run(&self, _: &Account, run: &str) -> Result<RunStatus, Refusal> {
        own(run).map(|()| self.status())
    }

    async fn runs(&self, _: &Account) -> Result<Vec<RunStatus>, Refusal> {
        let named = |run: &str| RunStatus { run: run.into(), ..self.status() };
        Ok(["run_c", "run_b", "run_a"].map(named).to_vec())
    }

    async fn cancel_run(&self, _: &Account, run: &str) -> Result<RunStatus, Refusal> {
        own(run)?;
        self.state().cancelled = true;
        Ok(self.status())
    }

    async fn open_run(&self, run_token: &str) -> Result<OpenRun, Refusal> {
        match run_token {
            RUN_TOKEN => Ok(OpenRun {
                run: RUN.into(),
                team: "red".into(),
                max_slots: self.max_slots,
                rules: Rules { max_steps: self.max_steps, ..Rules::paper() },
                sensors: self.sensors(),
                episodes: self.total,
                done: self.done(),
                sealed: false,
                digests: Digests::default(),
                time: self.time,
                deadline_unix_ms: self.deadline_unix_ms(),
                over: Some(self.run_state()).filter(|state| !state.is_open()),
            }),
            ACCOUNT => Err(Refusal::new(Reason::TokenScope, "an account token plays nothing")),
            _ => Err(Refusal::new(Reason::TokenMalformed, "the token is unknown")),
        }
    }

    async fn next_episode(
        &self,
        run: &str,
        slot: u32,
        sensors: &Sensors,
    ) -> Result<Option<HostedEpisode<ToyRunner>>, Refusal> {
        own(run)?;
        let mut state = self.state();
        if self.book.lock().unwrap().len() >= self.most_open {
            return Err(Refusal::new(Reason::NoCapacity, "the open episodes use the memory"));
        }
        let Some(quirk) = state.left.pop_front() else { return Ok(None) };
        state.handed_out += 1;
        let ticket = state.handed_out;
        let handle = format!("ep_{ticket}");
        let page = Page { slot, sensors: Some(sensors.clone()), ..Page::default() };
        self.book.lock().unwrap().insert(handle.clone(), page);
        Ok(Some(self.hosted(handle, ToyRunner::new(self.max_steps, sensors.clone(), quirk))))
    }

    async fn ended(&self, run: &str, handle: &str) -> Result<Option<StoredEnd>, Refusal> {
        own(run)?;
        let concluded = self.concluded.borrow();
        let found = concluded.iter().find(|concluded| concluded.handle == handle);
        let end = |c: &Concluded| StoredEnd {
            reason: c.end.unwrap_or(EndReason::ServerFault),
            steps: c.steps,
            outcome: None,
        };
        Ok(found.map(end))
    }

    async fn interrupted(&self) -> Result<Vec<String>, Refusal> {
        let open = !self.book.lock().unwrap().is_empty();
        Ok(open.then(|| RUN.to_owned()).into_iter().collect())
    }

    async fn restore(&self, run: &str) -> Result<Interrupted<ToyRunner>, Refusal> {
        own(run)?;
        let book = self.book.lock().unwrap().clone();
        let sensors = book.values().find_map(|page| page.sensors.clone()).unwrap();
        let restore = |(handle, page): (String, Page)| {
            let mut runner = ToyRunner::new(self.max_steps, sensors.clone(), Quirk::None);
            let mut last = (runner.start(), None);
            for action in page.actions {
                last = (runner.step(action).unwrap().observation, Some(action));
            }
            Restored { slot: page.slot, hosted: self.hosted(handle, runner), last, bank_left: Duration::ZERO }
        };
        let episodes = book.into_iter().map(restore).collect();
        Ok(Interrupted { open: self.open_run(RUN_TOKEN).await?, sensors, episodes, away: Duration::ZERO })
    }

    async fn conclude(
        &self,
        run: &str,
        hosted: HostedEpisode<ToyRunner>,
    ) -> Result<Option<EpisodeOutcome>, Refusal> {
        own(run)?;
        let is_last = {
            let mut book = self.book.lock().unwrap();
            book.remove(&hosted.handle);
            book.is_empty()
        };
        let toy = hosted.episode;
        let concluded = Concluded { handle: hosted.handle, end: toy.end(), steps: toy.steps() };
        self.finish_if(is_last);
        self.concluded.send_modify(|list| list.push(concluded));
        Ok(self.shows_metrics.then(|| EpisodeOutcome { metrics: vec![("isr".into(), 0.25)] }))
    }

    async fn lose(&self, run: &str, handle: &str, _: u64) -> Result<(), Refusal> {
        own(run)?;
        self.book.lock().unwrap().remove(handle);
        let mut state = self.state();
        state.lost.push(handle.to_owned());
        state.left.push_back(Quirk::None);
        Ok(())
    }

    async fn overdue(&self) -> Result<Vec<String>, Refusal> {
        let state = self.state();
        let is_over = state.deadline_unix_ms.is_some_and(|deadline| deadline < 1000) && !state.expired;
        Ok(is_over.then(|| RUN.to_owned()).into_iter().collect())
    }

    async fn expire_run(&self, run: &str) -> Result<(), Refusal> {
        own(run)?;
        self.state().expired = true;
        Ok(())
    }

    async fn finish_run(&self, run: &str, abandons: bool) -> Result<RunStatus, Refusal> {
        own(run)?;
        if abandons && self.run_state().is_open() {
            self.state().cancelled = true;
        }
        Ok(self.status())
    }
}
