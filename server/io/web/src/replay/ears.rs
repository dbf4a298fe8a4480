use super::{Moment, plots::Plot};
use crate::{
    onlooker::{Levels, Sound, window_of},
    plot::curves::{Curves, Line, round_ticks},
};
use avln_store::Replay;
use serde_json::json;
use std::{f32::consts::FRAC_PI_4, sync::Arc};

/// Directions in the plane, from straight ahead round to the left.
const DIRECTIONS: [&str; 8] =
    ["ahead", "ahead left", "left", "behind left", "behind", "behind right", "right", "ahead right"];
/// Why there are no levels although somebody asked.
const NOT_YET: &str = "No levels yet: the server is listening to this episode, or busy with others. Load the page again in some seconds.";

/// What an agent with ears was sent to hear, around the moment that is shown.
#[derive(Debug)]
pub(crate) struct EarsView {
    /// The first and the last step of the file that plays at this moment.
    pub(crate) window: [u32; 2],
    /// What there was to hear, in words, whenever it changed.
    pub(crate) lines: Vec<HeardLine>,
    /// Which of them is the last that has begun by this moment.
    newest: Option<usize>,
    /// How loud it was; `None` where nobody has listened yet.
    pub(crate) loud: Option<Loud>,
    /// Why not, where somebody asked for it.
    pub(crate) note: &'static str,
}

/// How loud an episode was.
#[derive(Debug)]
pub(crate) struct Loud {
    pub(crate) plot: Plot,
    /// At the moment that is shown, left and right.
    pub(crate) now_db: [Option<f64>; 2],
    /// Levels by step for the script, decibels; 0 for what nobody hears.
    pub(crate) columns: String,
}

/// Something that can be heard from a step on.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct HeardLine {
    pub(crate) step: u32,
    pub(crate) words: String,
}

impl EarsView {
    /// The ears at `step`; `sound` where the episode was heard again, and whether somebody asked for that.
    pub(crate) fn new(
        replay: &Replay,
        moments: &[Moment],
        step: u32,
        sound: Option<Arc<Sound>>,
        is_asked: bool,
    ) -> Self {
        let levels = sound.as_deref().map(Sound::levels);
        let last = moments.last().map_or(0, |moment| moment.step);
        let lines = lines(replay, moments, levels);
        Self {
            window: window_of(step.min(last), last),
            newest: lines.iter().rposition(|line| line.step <= step),
            lines,
            note: if is_asked && levels.is_none() { NOT_YET } else { "" },
            loud: levels.map(|levels| Loud::new(levels, last, step)),
        }
    }

    /// Whether the line at this place of the list is the last that has begun by the moment that is shown.
    pub(crate) fn is_newest(&self, place: &usize) -> bool {
        self.newest == Some(*place)
    }

    /// The steps of the file, as its name has them.
    pub(crate) fn file(&self) -> String {
        let [first, last] = self.window;
        format!("{first}-{last}")
    }
}

/// What stands for a level.
pub(crate) fn level_words(level_db: &Option<f64>) -> String {
    level_db.map_or_else(|| "not to be heard".to_owned(), |level| format!("{level:.0} dB"))
}

/// What can be heard, whenever another thing sounds or it comes from another side.
fn lines(replay: &Replay, moments: &[Moment], levels: Option<&[Levels]>) -> Vec<HeardLine> {
    let mut before = None;
    let mut lines = Vec::new();
    // Nobody wrote down what sounded before the first action.
    for moment in moments.iter().skip(1) {
        let now = (moment.sounding, moment.bearing_rad.map(direction));
        if before == Some(now) {
            continue;
        }
        before = Some(now);
        let level = levels.and_then(|levels| levels.get(moment.step as usize)).map(Levels::both_db);
        lines.push(HeardLine { step: moment.step, words: line(replay, now, level) });
    }
    lines
}

fn line(
    replay: &Replay,
    (sounding, direction): (Option<u8>, Option<&str>),
    level: Option<Option<f64>>,
) -> String {
    let Some(goal) = sounding else { return "silence".to_owned() };
    let category = replay.targets.get(usize::from(goal)).map_or("goal", |target| target.category.as_str());
    let direction = direction.unwrap_or("above or below");
    let level = level.map_or_else(String::new, |level| format!(", {}", level_words(&level)));
    format!("{} (goal {}), {direction}{level}", category.replace('_', " "), u32::from(goal) + 1)
}

/// The word for a bearing, which is positive to the left.
fn direction(bearing_rad: f32) -> &'static str {
    let eighth = (bearing_rad / FRAC_PI_4).round().rem_euclid(DIRECTIONS.len() as f32);
    DIRECTIONS[eighth as usize % DIRECTIONS.len()]
}

impl Loud {
    fn new(levels: &[Levels], last: u32, step: u32) -> Self {
        let ears: Vec<[Option<f64>; 2]> = levels.iter().map(Levels::ears_db).collect();
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
    let line = |(ear, label): (usize, &'static str)| Line {
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
        Some((level, step)) => format!("loudest at the {name} ear at step {step}, {level:.0} dB"),
        None => format!("nothing to be heard at the {name} ear"),
    });
    let words = words.collect::<Vec<_>>().join("; ");
    let most = (0..2).filter_map(loudest).map(|(level, _)| level).fold(60.0, f64::max);
    let ticks = round_ticks(most).into_iter().map(|value| (value, format!("{value} dB"))).collect();
    let svg = Curves { ticks, lines, levels: vec![], last, step }.svg();
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

    /// A walk of four steps in which something sounds from ahead at first and is passed by, and then falls silent.
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
    fn directions_have_words_all_around() {
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
    fn a_line_is_told_whenever_something_else_is_heard() {
        let replay = passing();
        let told = |lines: Vec<HeardLine>| -> Vec<(u32, String)> {
            lines.into_iter().map(|line| (line.step, line.words)).collect()
        };
        let words = |direction: &str, level: &str| format!("alarm clock (goal 1), {direction}{level}");
        let expected = vec![
            (1, words("ahead left", "")),
            (2, words("left", "")),
            (3, words("behind left", "")),
            (4, "silence".to_owned()),
        ];
        assert_eq!(told(lines(&replay, &moments(&replay), None)), expected);
        let levels = [0.0, 0.002, 0.02, 1e-9, 0.0].map(|rms| Levels { rms: [rms; 2] });
        let expected = vec![
            (1, words("ahead left", ", 40 dB")),
            (2, words("left", ", 60 dB")),
            (3, words("behind left", ", not to be heard")),
            (4, "silence".to_owned()),
        ];
        assert_eq!(told(lines(&replay, &moments(&replay), Some(&levels))), expected);
    }

    #[test]
    fn levels_are_drawn_for_each_ear_and_told_in_words() {
        let levels = [[0.002, 0.0], [0.02, 0.0]].map(|rms| Levels { rms });
        let loud = Loud::new(&levels, 1, 0);
        assert_eq!(
            loud.plot.words,
            "Loudest at the left ear at step 1, 60 dB; nothing to be heard at the right ear."
        );
        assert_eq!(loud.columns, "{\"left\":[40,60],\"right\":[0,0]}");
        assert_eq!(loud.now_db.map(|level| level_words(&level)), ["40 dB", "not to be heard"]);
    }
}
