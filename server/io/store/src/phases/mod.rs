//! What can be played, when, by whom and how often.

mod rows;

pub(crate) use rows::{PhaseHead, has_runs, read_heads, read_phases};

use crate::StoreError;
use avln_challenge::{
    Admission, PhaseEpisode, PhaseState, QuotaLimits, RunChoice, Sampling, Schedule, Visibility,
};
use avln_episode::{Order, Rules, Sensors, TimeLimits};
use avln_scoring::Key;
use serde::{Deserialize, Serialize};

/// What can be played, under which rules, and who may see the results.
#[derive(Clone, Debug, PartialEq)]
pub struct Phase {
    /// Id in URLs and requests.
    pub id: String,
    /// Heading on pages.
    pub title: String,
    /// Text for people; may be empty.
    pub description: String,
    /// Place in the organiser's list, from 0.
    pub position: u32,
    /// The missions' split.
    pub split: String,
    /// The rules, with every option; what agents learn from a Submit is one of them.
    pub rules: Rules,
    /// Orders that a run may choose.
    pub orders: Vec<Order>,
    /// The most that an agent may ask for.
    pub sensors: Sensors,
    /// Who may see scores.
    pub scores: Visibility,
    /// Who may see paths, maps and targets.
    pub replays: Visibility,
    /// Episodes that a run may play side by side, at least 1.
    pub max_slots: u32,
    /// When runs may start.
    pub schedule: Schedule,
    /// How many runs a team may start.
    pub quotas: QuotaLimits,
    /// Wall time that agents have.
    pub time: TimeLimits,
    /// How runs are ranked unless somebody asks otherwise.
    pub ranking: Ranking,
    /// Which teams may play.
    pub admission: Admission,
    /// Which episodes a run plays, and in which order.
    pub sampling: Sampling,
    /// Whether only sealed runs may be played.
    pub sealed: bool,
    /// The episodes that runs draw from; without sampling or shuffling, in playing order.
    pub episodes: Vec<PhaseEpisode>,
}

/// Refuses a start at `now_unix_ms` unless the phase is open.
pub(crate) fn refuse_closed(phase: &Phase, now_unix_ms: i64) -> Result<(), StoreError> {
    let Phase { schedule, id, .. } = phase;
    let phase = id.clone();
    match schedule.state(now_unix_ms) {
        PhaseState::Open => Ok(()),
        PhaseState::Closed => Err(StoreError::PhaseClosed(phase)),
        PhaseState::Upcoming => {
            Err(StoreError::PhaseNotOpen { phase, opens_unix_ms: schedule.opens_unix_ms.unwrap_or_default() })
        }
        PhaseState::Paused => {
            Err(StoreError::PhasePaused { phase, reason: schedule.paused.clone().unwrap_or_default() })
        }
    }
}

/// How runs are ranked unless somebody asks otherwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Ranking {
    /// The metric; it tells the direction.
    pub key: Key,
    /// Which run of a method of a team counts.
    pub entry: RunChoice,
}

impl Phase {
    /// A phase on a split that everybody may play and see, at any time and as often as they like, in both orders.
    pub fn new(id: &str, split: &str, rules: Rules, episodes: Vec<PhaseEpisode>) -> Self {
        Self {
            id: id.to_owned(),
            title: id.to_owned(),
            description: String::new(),
            position: 0,
            split: split.to_owned(),
            rules,
            orders: vec![Order::Ordered, Order::Unordered],
            sensors: Sensors::all(512, 512),
            scores: Visibility::Public,
            replays: Visibility::Public,
            max_slots: 16,
            schedule: Schedule::default(),
            quotas: QuotaLimits::default(),
            time: TimeLimits::default(),
            ranking: Ranking::default(),
            admission: Admission::default(),
            sampling: Sampling::default(),
            sealed: false,
            episodes,
        }
    }

    /// Episodes of one run.
    pub fn episodes_of_run(&self) -> u32 {
        self.sampling.episodes_of_run(self.episodes.len() as u32)
    }
}
