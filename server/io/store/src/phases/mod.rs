//! What can be played, when, by whom and how often.

mod rows;

pub(crate) use rows::{PhaseHead, has_runs, read_heads, read_phases};

use crate::{Pick, StoreError, words::words};
use avln_episode::{Modality, Order, Rules, Sensors, TimeLimits};
use avln_scoring::Key;
use serde::{Deserialize, Serialize};

/// Who may see something.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Visibility {
    /// Everybody.
    Public,
    /// The team whose run it is.
    Team,
    /// The organiser alone.
    Organiser,
}
words!(Visibility, "visibility", { Public => "public", Team => "team", Organiser => "organiser" });

/// Whether runs may start at a given moment. Runs that were started have their wall time in every state; those without one
/// end when the phase closes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PhaseState {
    /// Not yet.
    Upcoming,
    /// They may.
    Open,
    /// Not until the organiser goes on.
    Paused,
    /// No more.
    Closed,
}

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

/// When runs may start.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Schedule {
    /// From when; `None` for at once. Milliseconds since 1970-01-01 UTC, like all moments.
    pub opens_unix_ms: Option<i64>,
    /// From when no more; `None` for never.
    pub closes_unix_ms: Option<i64>,
    /// Why none may start for now; `None` while they may.
    pub paused: Option<String>,
    /// Whether the organiser closed the phase by hand.
    pub closed: bool,
}

impl Schedule {
    /// Whether runs may start at `now_unix_ms`. Closing beats a pause, and a pause beats being open.
    pub fn state(&self, now_unix_ms: i64) -> PhaseState {
        if self.closed || self.closes_unix_ms.is_some_and(|closes| closes <= now_unix_ms) {
            PhaseState::Closed
        } else if self.opens_unix_ms.is_some_and(|opens| now_unix_ms < opens) {
            PhaseState::Upcoming
        } else if self.paused.is_some() {
            PhaseState::Paused
        } else {
            PhaseState::Open
        }
    }

    /// Refuses a start at `now_unix_ms` unless the phase, which is called `phase`, is open.
    pub(crate) fn refuse_start(&self, phase: &str, now_unix_ms: i64) -> Result<(), StoreError> {
        let phase = phase.to_owned();
        match self.state(now_unix_ms) {
            PhaseState::Open => Ok(()),
            PhaseState::Closed => Err(StoreError::PhaseClosed(phase)),
            PhaseState::Upcoming => {
                Err(StoreError::PhaseNotOpen { phase, opens_unix_ms: self.opens_unix_ms.unwrap_or_default() })
            }
            PhaseState::Paused => {
                Err(StoreError::PhasePaused { phase, reason: self.paused.clone().unwrap_or_default() })
            }
        }
    }
}

/// How many runs a team may start; `None` for any number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct QuotaLimits {
    /// Charged runs of a UTC day.
    pub day: Option<u32>,
    /// Charged runs of a UTC month.
    pub month: Option<u32>,
    /// Charged runs of the phase.
    pub total: Option<u32>,
    /// Runs that are open at the same time.
    pub concurrent: Option<u32>,
    /// Runs of the phase that were not charged, so that failing for free has an end too.
    pub uncharged: Option<u32>,
}

/// How runs are ranked unless somebody asks otherwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Ranking {
    /// The metric; it tells the direction.
    pub key: Key,
    /// Which run of a method of a team counts.
    pub entry: Pick,
}

/// Which teams may play.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Admission {
    /// Whether the organiser approves each team.
    pub approval: bool,
    /// The only teams that may know of the phase; empty: everybody may.
    pub allow: Vec<String>,
    /// Teams that may not play.
    pub deny: Vec<String>,
}

impl Admission {
    /// Whether `team` may know of the phase; `None` stands for everybody.
    pub(crate) fn shows_to(&self, team: Option<&str>) -> bool {
        self.allow.is_empty() || team.is_some_and(|team| self.allow.iter().any(|allowed| allowed == team))
    }
}

/// Which episodes a run plays, and in which order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Sampling {
    /// Whether each run has an order of its own, drawn by the phase's secret and the run's id.
    pub shuffle: bool,
    /// How many of the episodes a run plays; `None` for all.
    pub sample: Option<Sample>,
}

/// A draw from the episodes of a phase.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sample {
    /// Episodes of a run.
    pub episodes: u32,
    /// Of these, how many are the same for all runs, so that runs can be compared by pairs.
    #[serde(default)]
    pub anchors: u32,
}

/// One episode of a phase.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PhaseEpisode {
    /// Id of the episode inside the split.
    pub episode: String,
    /// Name of the scene.
    pub scene: String,
    /// The goals in the order of the mission.
    pub goals: Vec<GoalText>,
}

/// How a goal is told, in words.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct GoalText {
    /// Which kind of cue the agent gets.
    pub modality: Modality,
    /// The category's label or the sentence; `None` for a picture.
    pub text: Option<String>,
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

impl Sampling {
    /// Episodes that a run plays of `all`.
    pub(crate) fn episodes_of_run(&self, all: u32) -> u32 {
        self.sample.map_or(all, |sample| sample.episodes.min(all))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_state_follows_from_dates_the_pause_and_the_hand() {
        let dated = Schedule { opens_unix_ms: Some(10), closes_unix_ms: Some(20), ..Schedule::default() };
        let states = [9, 10, 19, 20].map(|now| dated.state(now));
        assert_eq!(states, [PhaseState::Upcoming, PhaseState::Open, PhaseState::Open, PhaseState::Closed]);
        let paused = Schedule { paused: Some("the roof leaks".to_owned()), ..dated.clone() };
        let states = [9, 10, 20].map(|now| paused.state(now));
        assert_eq!(states, [PhaseState::Upcoming, PhaseState::Paused, PhaseState::Closed]);
        let closed = Schedule { closed: true, ..paused };
        assert_eq!([9, 10].map(|now| closed.state(now)), [PhaseState::Closed; 2]);
        assert_eq!(Schedule::default().state(0), PhaseState::Open);
    }
}
