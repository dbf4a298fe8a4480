//! Replay sound: the audible goals in words, and the sound levels.

use super::{Plot, timeline::Moment};
use crate::{
    plot::{Curve, Curves, round_ticks},
    replay_renderer::{EpisodeSound, StepLevels, window_of},
};
use avln_store::Replay;
use serde_json::json;
use std::{f32::consts::FRAC_PI_4, sync::Arc};

/// Direction names, counter-clockwise from straight ahead in 45-degree steps.
const DIRECTIONS: [&str; 8] =
    ["ahead", "ahead left", "left", "behind left", "behind", "behind right", "right", "ahead right"];
const NOT_READY: &str = "The sound levels are not ready yet. Reload the page in a few seconds.";

#[derive(Debug)]
pub(crate) struct SoundView {
    pub(crate) window: [u32; 2],
    pub(crate) lines: Vec<SoundLine>,
    pub(crate) newest: Option<usize>,
    pub(crate) levels: Option<SoundLevels>,
    /// Note about missing levels; empty if none were requested.
    pub(crate) note: &'static str,
}

#[derive(Debug)]
pub(crate) struct SoundLevels {
    pub(crate) plot: Plot,
    /// Levels at the displayed step, left and right.
    pub(crate) now_db: [Option<f64>; 2],
    /// Levels by step as JSON for the script, decibels; 0 for inaudible sound.
    pub(crate) columns: String,
}

#[derive(Debug, PartialEq, Eq)]
pub(crate) struct SoundLine {
    pub(crate) step: u32,
    pub(crate) text: String,
}

impl SoundView {
    /// `sound` is the rendered sound, if available; `is_requested`: the visitor asked for levels.
    pub(crate) fn new(
        replay: &Replay,
        moments: &[Moment],
        step: u32,
        sound: Option<Arc<EpisodeSound>>,
        is_requested: bool,
    ) -> Self {
        let levels = sound.as_deref().map(EpisodeSound::levels);
        let last = moments.last().map_or(0, |moment| moment.step);
        let lines = lines(replay, moments, levels);
        Self {
            window: window_of(step.min(last), last),
            newest: lines.iter().rposition(|line| line.step <= step),
            lines,
            note: if is_requested && levels.is_none() { NOT_READY } else { "" },
            levels: levels.map(|levels| SoundLevels::new(levels, last, step)),
        }
    }

    pub(crate) fn file(&self) -> String {
        let [first, last] = self.window;
        format!("{first}-{last}")
    }
}

pub(crate) fn level_words(level_db: &Option<f64>) -> String {
    level_db.map_or_else(|| "inaudible".to_owned(), |level| format!("{level:.0} dB"))
}

fn lines(replay: &Replay, moments: &[Moment], levels: Option<&[StepLevels]>) -> Vec<SoundLine> {
    let mut before = None;
    let mut lines = Vec::new();
    // The record has no sounding goal before the first action.
    for moment in moments.iter().skip(1) {
        let now = (moment.sounding, moment.bearing_rad.map(direction));
        if before == Some(now) {
            continue;
        }
        before = Some(now);
        let level = levels.and_then(|levels| levels.get(moment.step as usize)).map(StepLevels::both_db);
        lines.push(SoundLine { step: moment.step, text: line(replay, now, level) });
    }
    lines
}

fn line(
    replay: &Replay,
    (sounding, direction): (Option<u8>, Option<&str>),
    level: Option<Option<f64>>,
) -> String {
    let Some(goal) = sounding else { return "silence".to_owned() };
    let level = level.map_or_else(String::new, |level| format!(", {}", level_words(&level)));
    let Some(target) = replay.targets.get(usize::from(goal)) else { return format!("a distractor{level}") };
    let direction = direction.unwrap_or("above or below");
    format!("{} (goal {}), {direction}{level}", target.category.replace('_', " "), u32::from(goal) + 1)
}

/// Returns the bearing name, which is positive to the left.
fn direction(bearing_rad: f32) -> &'static str {
    let eighth = (bearing_rad / FRAC_PI_4).round().rem_euclid(DIRECTIONS.len() as f32);
    DIRECTIONS[eighth as usize % DIRECTIONS.len()]
}

impl SoundLevels {
    fn new(levels: &[StepLevels], last: u32, step: u32) -> Self {
        let ears: Vec<[Option<f64>; 2]> = levels.iter().map(StepLevels::ears_db).collect();
        let column = |ear: usize| -> Vec<i64> {
            ears.iter().map(|levels| levels[ear].map_or(0, |level| level.round() as i64)).collect()
        };
        Self {
            plot: plot(&ears, last, step),
            now_db: ears.get(step as usize).copied().unwrap_or_default(),
            columns: json!({ "left": column(0), "right": column(1) }).to_string(),
        }
    }
}

fn plot(ears: &[[Option<f64>; 2]], last: u32, step: u32) -> Plot {
    let line = |(ear, label): (usize, &'static str)| Curve {
        kind: ear,
        label,
        points: (0..).zip(ears).map(|(step, levels)| (step, levels[ear].unwrap_or(f64::NAN))).collect(),
    };
    let lines = ["L", "R"].into_iter().enumerate().map(line).collect();
    let loudest = |ear: usize| {
        let heard = (0_u32..).zip(ears).filter_map(|(step, levels)| Some((levels[ear]?, step)));
        heard.max_by(|a, b| a.0.total_cmp(&b.0))
    };
    let words = ["left", "right"].into_iter().enumerate().map(|(ear, name)| match loudest(ear) {
        Some((level, step)) => format!("maximum at the {name} ear {level:.0} dB at step {step}"),
        None => format!("nothing audible at the {name} ear"),
    });
    let words = words.collect::<Vec<_>>().join("; ");
    let most = (0..2).filter_map(loudest).map(|(level, _)| level).fold(60.0, f64::max);
    let ticks = round_ticks(most).into_iter().map(|value| (value, format!("{value} dB"))).collect();
    let svg = Curves { ticks, curves: lines, levels: vec![], last, step }.svg();
    Plot { svg, words: format!("{}.", capitalised(&words)) }
}

fn capitalised(words: &str) -> String {
    let mut letters = words.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::replay::{moments, tests::replay};
    use avln_episode::Modality;
    use avln_store::TargetView;

    /// Returns a four-step path past a sounding target, which then falls silent.
    fn passing() -> Replay {
        let target = TargetView {
            category: "alarm_clock".to_owned(),
            modality: Modality::Category,
            position: [0.0; 3],
            min: [0.0; 3],
            max: [0.0; 3],
            source: [-0.3, 1.0, -0.6],
            floor_y_m: 0.0,
        };
        Replay { targets: vec![target], sounding: vec![Some(0), Some(0), Some(0), None], ..replay(4) }
    }

    #[test]
    fn directions_have_names_all_around() {
        let words = [0.0, 44.0, 91.0, 136.0, 179.0, -179.0, -100.0, -40.0, -20.0]
            .map(|degrees: f32| direction(degrees.to_radians()));
        let expected = [
            "ahead",
            "ahead left",
            "left",
            "behind left",
            "behind",
            "behind",
            "right",
            "ahead right",
            "ahead",
        ];
        assert_eq!(words, expected);
    }

    #[test]
    fn each_change_of_the_sound_is_a_line() {
        let replay = passing();
        let texts = |lines: Vec<SoundLine>| -> Vec<(u32, String)> {
            lines.into_iter().map(|line| (line.step, line.text)).collect()
        };
        let words = |direction: &str, level: &str| format!("alarm clock (goal 1), {direction}{level}");
        let expected = vec![
            (1, words("ahead left", "")),
            (2, words("left", "")),
            (3, words("behind left", "")),
            (4, "silence".to_owned()),
        ];
        assert_eq!(texts(lines(&replay, &moments(&replay), None)), expected);
        let levels = [0.0, 0.002, 0.02, 1e-9, 0.0].map(|rms| StepLevels { rms: [rms; 2] });
        let expected = vec![
            (1, words("ahead left", ", 40 dB")),
            (2, words("left", ", 60 dB")),
            (3, words("behind left", ", inaudible")),
            (4, "silence".to_owned()),
        ];
        assert_eq!(texts(lines(&replay, &moments(&replay), Some(&levels))), expected);
    }

    #[test]
    fn levels_are_drawn_and_described() {
        let levels = [[0.002, 0.0], [0.02, 0.0]].map(|rms| StepLevels { rms });
        let loud = SoundLevels::new(&levels, 1, 0);
        assert_eq!(
            loud.plot.words,
            "Maximum at the left ear 60 dB at step 1; nothing audible at the right ear."
        );
        assert_eq!(loud.columns, "{\"left\":[40,60],\"right\":[0,0]}");
        assert_eq!(loud.now_db.map(|level| level_words(&level)), ["40 dB", "inaudible"]);
    }
}
