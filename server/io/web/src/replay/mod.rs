//! A replay for people: one clock over a map, plots and a list of events.

mod ears;
mod events;
mod map;
mod moments;
mod plots;
mod storeys;

pub(crate) use ears::{EarsView, level_words};
pub(crate) use events::Event;
pub(crate) use map::{MapView, colour, plan};
pub(crate) use moments::{Moment, moments};
pub(crate) use plots::{Plots, plots};

use avln_store::EpisodeView;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Everything that happened, and the moment that is shown.
#[derive(Debug)]
pub(crate) struct ReplayView {
    pub(crate) map: MapView,
    pub(crate) plots: Plots,
    pub(crate) events: Vec<Event>,
    /// Before the first action and after each.
    pub(crate) moments: Vec<Moment>,
    /// The step that is shown.
    pub(crate) step: u32,
}

impl ReplayView {
    /// The replay of `view` at `step`, or at its end; on the storey that the body is on, or another one. `None` where there is
    /// nothing to replay.
    pub(crate) fn new(view: &EpisodeView, step: Option<u32>, storey: Option<usize>) -> Option<Self> {
        let replay = view.replay.as_ref()?;
        let moments = moments(replay);
        let last = u32::try_from(moments.len().checked_sub(1)?).ok()?;
        let step = step.map_or(last, |step| step.min(last));
        let moment = &moments[step as usize];
        Some(Self {
            map: MapView::new(replay, view.mission.as_ref(), moment, storey),
            plots: plots(view, replay, &moments, step),
            events: events::events(view, replay),
            moments,
            step,
        })
    }

    /// The moment that is shown.
    pub(crate) fn moment(&self) -> &Moment {
        &self.moments[self.step as usize]
    }

    /// Number of the last step.
    pub(crate) fn last(&self) -> u32 {
        self.moments.last().map_or(0, |moment| moment.step)
    }

    /// Whether the event at this place of the list is the last that has happened by the moment that is shown.
    pub(crate) fn is_newest(&self, place: &usize) -> bool {
        self.events.iter().rposition(|event| event.step <= self.step) == Some(*place)
    }

    /// All moments in columns for the script, which moves what the page shows.
    pub(crate) fn columns(&self) -> String {
        let column = |value: fn(&Moment) -> Value| -> Value { self.moments.iter().map(value).collect() };
        let mut columns = json!({
            "x": column(|m| rounded(f64::from(m.at.x))),
            "y": column(|m| rounded(f64::from(m.at.y))),
            "turn": column(|m| json!(m.turn_degrees())),
            "storey": column(|m| json!(m.storey)),
            "action": self.coded(Moment::action_words),
            "sounding": self.coded(Moment::sounding_words),
            "bearing": self.coded(Moment::bearing_words),
            "walked": column(|m| rounded(m.walked_m)),
            "actions-left": column(|m| json!(m.actions_left)),
            "submits-left": column(|m| json!(m.submits_left)),
        });
        for goal in 0..self.moment().distances_m.len() {
            let distance = |m: &Moment| m.distances_m.get(goal).map(|&distance| rounded(f64::from(distance)));
            columns[format!("distance-{goal}")] =
                json!(self.moments.iter().map(distance).collect::<Vec<_>>());
        }
        columns.to_string()
    }

    /// A column of words: each of them once, and which stands where.
    fn coded(&self, words: fn(&Moment) -> String) -> Value {
        let mut all: Vec<String> = Vec::new();
        let mut places: BTreeMap<String, usize> = BTreeMap::new();
        let mut place = |moment: &Moment| {
            *places.entry(words(moment)).or_insert_with_key(|word| {
                all.push(word.clone());
                all.len() - 1
            })
        };
        let at: Vec<usize> = self.moments.iter().map(&mut place).collect();
        json!({ "words": all, "at": at })
    }
}

/// Two decimals; `null` for what is no number.
fn rounded(value: f64) -> Value {
    json!((value * 100.0).round() / 100.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_episode::Rules;
    use avln_store::{Replay, SceneMap};

    /// A walk of so many steps towards -Z, 0.25 m each, in which nothing sounds and nothing is sought.
    pub(crate) fn replay(steps: usize) -> Replay {
        Replay {
            episode: "e".to_owned(),
            scene: "s".to_owned(),
            rules: Rules::paper(),
            sensors: None,
            hears: false,
            map: SceneMap::default(),
            path: (0..=steps).map(|step| [0.0, 0.0, step as f32 * -0.25]).collect(),
            headings_rad: vec![0.0; steps + 1],
            actions: vec!["MoveForward".to_owned(); steps],
            collisions: vec![],
            sounding: vec![None; steps],
            in_region: vec![0; steps],
            submits: vec![],
            targets: vec![],
            reference_path: vec![],
        }
    }

    #[test]
    fn a_walk_is_measured_from_moment_to_moment() {
        let moments = moments(&replay(4));
        assert_eq!(moments.len(), 5);
        assert_eq!((moments[0].walked_m, moments[4].walked_m), (0.0, 1.0));
        assert_eq!((moments[0].actions_left, moments[4].actions_left), (1000, 996));
        assert_eq!(moments[0].action_words(), "before the first");
        assert_eq!(
            (moments[4].sounding_words().as_str(), moments[4].bearing_words().as_str()),
            ("nothing", "–")
        );
    }

    #[test]
    fn a_replay_without_moments_is_none() {
        let empty = Replay { path: vec![], headings_rad: vec![], ..replay(0) };
        assert_eq!(moments(&empty), vec![]);
    }
}
