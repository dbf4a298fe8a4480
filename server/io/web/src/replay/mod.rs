//! Episode replay: a map, plots, sound and a list of events, all at the same step.

mod map;
mod sound;
mod timeline;

pub(crate) use map::{MapView, colour, plan};
pub(crate) use sound::{SoundView, level_words};
pub(crate) use timeline::{Moment, ReplayEvent, moments};

use crate::{
    format,
    plot::{Curve, Curves, round_ticks},
    replay_renderer::size_px,
};
use avln_episode::Rules;
use avln_store::{EpisodeView, Replay, TargetView};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use timeline::events;

#[derive(Debug)]
pub(crate) struct ReplayView {
    pub(crate) map: MapView,
    pub(crate) plots: Plots,
    pub(crate) events: Vec<ReplayEvent>,
    /// State before the first and after every action.
    pub(crate) moments: Vec<Moment>,
    pub(crate) step: u32,
    pub(crate) rules: Rules,
    pub(crate) targets: Vec<TargetView>,
    pub(crate) picture_px: [u32; 2],
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
            rules: replay.rules.clone(),
            targets: replay.targets.clone(),
            picture_px: size_px(replay),
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

const LABELS: [&str; 8] = ["1", "2", "3", "4", "5", "6", "7", "8"];

#[derive(Debug)]
pub(crate) struct Plots {
    pub(crate) distances: Plot,
    pub(crate) bearings: Plot,
    pub(crate) walk: Plot,
    pub(crate) budget: Plot,
}

#[derive(Debug)]
pub(crate) struct Plot {
    pub(crate) svg: String,
    pub(crate) words: String,
}

pub(crate) fn plots(view: &EpisodeView, replay: &Replay, moments: &[Moment], step: u32) -> Plots {
    let last = moments.last().map_or(0, |moment| moment.step);
    Plots {
        distances: distances(replay, moments, last, step),
        bearings: bearings(replay, moments, last, step),
        walk: walk(view, moments, last, step),
        budget: budget(replay, moments, last, step),
    }
}

fn ticks(most: f64) -> Vec<(f64, String)> {
    let words = |value: f64| format!("{}", (value * 1000.0).round() / 1000.0);
    round_ticks(most).into_iter().map(|value| (value, words(value))).collect()
}

fn distances(replay: &Replay, moments: &[Moment], last: u32, step: u32) -> Plot {
    let at = |moment: &Moment, goal: usize| moment.distances_m.get(goal).copied().map_or(f64::NAN, f64::from);
    let line = |(goal, &label): (usize, &&'static str)| Curve {
        kind: goal,
        label,
        points: moments.iter().map(|moment| (moment.step, at(moment, goal))).collect(),
    };
    let lines: Vec<Curve<'_>> = LABELS.iter().take(replay.targets.len()).enumerate().map(line).collect();
    let radius_m = f64::from(replay.rules.success_radius_m);
    let most = lines.iter().flat_map(|line| &line.points).map(|(_, value)| *value).fold(radius_m, f64::max);
    let svg =
        Curves { ticks: ticks(most), curves: lines, levels: vec![(radius_m, "success")], last, step }.svg();
    Plot { svg, words: nearest_words(moments, replay.targets.len()) }
}

fn nearest_words(moments: &[Moment], goals: usize) -> String {
    let nearest = |goal: usize| {
        let at =
            |moment: &Moment| moment.distances_m.get(goal).copied().filter(|distance| distance.is_finite());
        let found = moments.iter().filter_map(|moment| Some((at(moment)?, moment.step)));
        let (distance, step) = found.min_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(format!("goal {} {} at step {step}", goal + 1, format::metres(&f64::from(distance))))
    };
    format!("Nearest to each target: {}.", (0..goals).filter_map(nearest).collect::<Vec<_>>().join(", "))
}

fn bearings(replay: &Replay, moments: &[Moment], last: u32, step: u32) -> Plot {
    let ticks = [(-180.0, "behind"), (-90.0, "right"), (0.0, "ahead"), (90.0, "left"), (180.0, "behind")];
    let ticks = ticks.map(|(value, words)| (value, words.to_owned())).to_vec();
    let line = |goal: usize| Curve { kind: goal, label: "", points: bearings_of(moments, goal) };
    let lines = (0..replay.targets.len()).map(line).collect();
    let svg = Curves { ticks, curves: lines, levels: vec![], last, step }.svg();
    let share = |goal: usize| {
        let steps = moments.iter().filter(|moment| moment.sounding == Some(goal as u8)).count();
        format!("goal {} in {}", goal + 1, format::plural(&(steps as u32), "step"))
    };
    let shares: Vec<String> = (0..replay.targets.len()).map(share).collect();
    Plot { svg, words: format!("Sounding goals: {}.", shares.join(", ")) }
}

/// Returns a goal's bearings, degrees. NaN marks silence and the wrap-around behind the agent.
fn bearings_of(moments: &[Moment], goal: usize) -> Vec<(u32, f64)> {
    const HALF_TURN: f64 = 180.0;
    let mut points: Vec<(u32, f64)> = Vec::new();
    for moment in moments {
        let sounds = moment.sounding.is_some_and(|sounding| usize::from(sounding) == goal);
        let bearing =
            moment.bearing_rad.filter(|_| sounds).map_or(f64::NAN, |rad| f64::from(rad.to_degrees()));
        if points.last().is_some_and(|(_, before)| (bearing - before).abs() > HALF_TURN) {
            points.push((moment.step, f64::NAN));
        }
        points.push((moment.step, bearing));
    }
    points
}

fn walk(view: &EpisodeView, moments: &[Moment], last: u32, step: u32) -> Plot {
    let points = moments.iter().map(|moment| (moment.step, moment.walked_m)).collect();
    let walked_m = moments.last().map_or(0.0, |moment| moment.walked_m);
    let reference = view.metrics.as_ref().map(|metrics| metrics.reference_m).filter(|m| m.is_finite());
    let levels = reference.map(|metres| (metres, "reference tour")).into_iter().collect();
    let lines = vec![Curve { kind: 0, label: "", points }];
    let most = walked_m.max(reference.unwrap_or(0.0));
    let svg = Curves { ticks: ticks(most), curves: lines, levels, last, step }.svg();
    let tour = reference.map_or_else(String::new, |m| format!(", reference tour {}", format::metres(&m)));
    Plot { svg, words: format!("Path length {}{tour}.", format::metres(&walked_m)) }
}

fn budget(replay: &Replay, moments: &[Moment], last: u32, step: u32) -> Plot {
    const PERCENT: f64 = 100.0;
    let submits_max = timeline::submit_limit(replay);
    let line = |kind: usize, left: fn(&Moment) -> u32, of: u32| Curve {
        kind,
        label: "",
        points: moments
            .iter()
            .map(|moment| (moment.step, PERCENT * f64::from(left(moment)) / f64::from(of.max(1))))
            .collect(),
    };
    let lines =
        vec![line(0, |m| m.actions_left, replay.rules.max_steps), line(1, |m| m.submits_left, submits_max)];
    let ticks = round_ticks(PERCENT).into_iter().map(|value| (value, format!("{value} %"))).collect();
    let svg = Curves { ticks, curves: lines, levels: vec![], last, step }.svg();
    let (actions, submits) =
        moments.last().map_or((0, 0), |moment| (moment.actions_left, moment.submits_left));
    let words = format!(
        "At the end, {actions} of {} actions ({} of simulated time) and {submits} of {} remained.",
        replay.rules.max_steps,
        format::duration(&(f64::from(actions) * f64::from(replay.rules.step_s))),
        format::plural(&submits_max, "Submit"),
    );
    Plot { svg, words }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_store::SceneMap;
    use timeline::Spot;

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

    fn moment(step: u32, sounding: Option<u8>, bearing_degrees: f32) -> Moment {
        Moment {
            step,
            at: Spot { x: 0.0, y: 0.0 },
            storey: 0,
            heading_rad: 0.0,
            action: None,
            collided: false,
            sounding,
            bearing_rad: Some(bearing_degrees.to_radians()),
            walked_m: 0.0,
            distances_m: vec![5.0 - step as f32, f32::NAN],
            actions_left: 0,
            submits_left: 0,
        }
    }

    #[test]
    fn bearings_wrap_at_pi() {
        let moments = [moment(1, Some(0), 170.0), moment(2, Some(0), -170.0), moment(3, Some(1), 0.0)];
        let points = bearings_of(&moments, 0);
        let drawn: Vec<Option<i32>> =
            points.iter().map(|(_, value)| value.is_finite().then(|| value.round() as i32)).collect();
        assert_eq!(drawn, [Some(170), None, Some(-170), None]);
    }

    #[test]
    fn nearest_approaches_skip_targets_without_distance() {
        let moments = [moment(1, None, 0.0), moment(3, None, 0.0), moment(2, None, 0.0)];
        assert_eq!(nearest_words(&moments, 2), "Nearest to each target: goal 1 2.00 m at step 3.");
    }
}
