//! Episode replay: a map, plots, sound and a list of events, all at the same step.

mod map;
mod plots;
mod sound;
mod storeys;
mod timeline;

pub(crate) use map::{MapView, colour, plan};
pub(crate) use plots::{Plots, plots};
pub(crate) use sound::{SoundView, level_words};
pub(crate) use timeline::{Moment, ReplayEvent, moments};

use avln_store::EpisodeView;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use timeline::events;

/// An episode with the displayed step.
#[derive(Debug)]
pub(crate) struct ReplayView {
    pub(crate) map: MapView,
    pub(crate) plots: Plots,
    pub(crate) events: Vec<ReplayEvent>,
    /// State before the first and after every action.
    pub(crate) moments: Vec<Moment>,
    /// Displayed step.
    pub(crate) step: u32,
}

impl ReplayView {
    /// Defaults: the last step and the agent's storey. `None` if the viewer may not see the replay.
    pub(crate) fn new(view: &EpisodeView, step: Option<u32>, storey: Option<usize>) -> Option<Self> {
        let replay = view.replay.as_ref()?;
        let moments = moments(replay);
        let last = u32::try_from(moments.len().checked_sub(1)?).ok()?;
        let step = step.map_or(last, |step| step.min(last));
        let moment = &moments[step as usize];
        Some(Self {
            map: MapView::new(replay, view.mission.as_ref(), moment, storey),
            plots: plots(view, replay, &moments, step),
            events: events(view, replay),
            moments,
            step,
        })
    }

    pub(crate) fn moment(&self) -> &Moment {
        &self.moments[self.step as usize]
    }

    pub(crate) fn last(&self) -> u32 {
        self.moments.last().map_or(0, |moment| moment.step)
    }

    /// Returns true for the last event up to the displayed step.
    pub(crate) fn is_newest(&self, index: &usize) -> bool {
        self.events.iter().rposition(|event| event.step <= self.step) == Some(*index)
    }

    /// Returns all moments as JSON columns for the page script.
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

    /// Returns a text column as dictionary and indices, which is shorter.
    fn coded(&self, words: fn(&Moment) -> String) -> Value {
        let mut all: Vec<String> = Vec::new();
        let mut indices: BTreeMap<String, usize> = BTreeMap::new();
        let mut index = |moment: &Moment| {
            *indices.entry(words(moment)).or_insert_with_key(|word| {
                all.push(word.clone());
                all.len() - 1
            })
        };
        let at: Vec<usize> = self.moments.iter().map(&mut index).collect();
        json!({ "words": all, "at": at })
    }
}

/// A number with two decimals; NaN becomes `null`.
fn rounded(value: f64) -> Value {
    json!((value * 100.0).round() / 100.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_episode::Rules;
    use avln_store::{Replay, SceneMap};

    /// Returns a straight path towards -Z in steps of 0.25 m, without targets and sound.
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
    fn moments_accumulate_path_length() {
        let moments = moments(&replay(4));
        assert_eq!(moments.len(), 5);
        assert_eq!((moments[0].walked_m, moments[4].walked_m), (0.0, 1.0));
        assert_eq!((moments[0].actions_left, moments[4].actions_left), (1000, 996));
        assert_eq!(moments[0].action_words(), "none yet");
        assert_eq!(
            (moments[4].sounding_words().as_str(), moments[4].bearing_words().as_str()),
            ("nothing", "–")
        );
    }

    #[test]
    fn an_empty_replay_has_no_moments() {
        let empty = Replay { path: vec![], headings_rad: vec![], ..replay(0) };
        assert_eq!(moments(&empty), vec![]);
    }
}
