//! Statistics of data sets, with their page and main numbers.

use crate::{cue::CueSpec, format::SceneFacts, mission::EpisodeSpec, survey::Removals};
use serde::{Deserialize, Serialize};
use std::{
    collections::BTreeMap,
    fmt::{Display, Write},
};

/// Counts over scenes and missions; sums of several scenes are allowed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Statistics {
    /// Scenes.
    pub scenes: u64,
    /// Missions.
    pub missions: u64,
    /// Rooms per scene.
    pub regions: Spread,
    /// Scenes by storey count.
    pub storeys: BTreeMap<u32, u64>,
    /// Walkable area per scene, square metres.
    pub area_m2: Spread,
    /// Potential targets per scene.
    pub instances: Spread,
    /// Instances of target categories removed by each test of the survey.
    #[serde(default)]
    pub removed: BTreeMap<String, u64>,
    /// Missions by goal count.
    pub goals: BTreeMap<usize, u64>,
    /// Goals by modality.
    pub modalities: BTreeMap<String, u64>,
    /// Missions by unordered modality combination.
    pub mixes: BTreeMap<String, u64>,
    /// Goals by target category.
    pub categories: BTreeMap<String, u64>,
    /// Goals by distractor count.
    pub distractors: BTreeMap<u8, u64>,
    /// Targets by mission count.
    pub uses: BTreeMap<u32, u64>,
    /// Ordered reference length, metres.
    pub ordered_m: Spread,
    /// Unordered reference length, metres.
    pub unordered_m: Spread,
    /// Reference lengths by goal count.
    #[serde(default)]
    pub lengths: BTreeMap<usize, Lengths>,
    /// Ordered reference steps.
    pub ordered_steps: Spread,
    /// Unordered reference steps.
    pub unordered_steps: Spread,
    /// Walking distance from the start to a success region, metres.
    pub start_m: Spread,
    /// Words per description.
    pub words: Spread,
}

/// Reference lengths and steps of missions with equal goal counts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lengths {
    /// Ordered length, metres.
    pub ordered_m: Spread,
    /// Unordered length, metres.
    pub unordered_m: Spread,
    /// Ordered steps.
    pub ordered_steps: Spread,
}

impl Default for Lengths {
    fn default() -> Self {
        Self { ordered_m: Spread::new(5.0), unordered_m: Spread::new(5.0), ordered_steps: Spread::new(25.0) }
    }
}

impl Lengths {
    fn note(&mut self, episode: &EpisodeSpec) {
        self.ordered_m.note(episode.ordered.length_m);
        self.unordered_m.note(episode.unordered.length_m);
        self.ordered_steps.note(f64::from(episode.ordered.steps));
    }

    fn add(&mut self, other: &Self) {
        self.ordered_m.add(&other.ordered_m);
        self.unordered_m.add(&other.unordered_m);
        self.ordered_steps.add(&other.ordered_steps);
    }
}

impl Default for Statistics {
    fn default() -> Self {
        Self {
            scenes: 0,
            missions: 0,
            regions: Spread::new(2.0),
            storeys: BTreeMap::new(),
            area_m2: Spread::new(25.0),
            instances: Spread::new(10.0),
            removed: BTreeMap::new(),
            goals: BTreeMap::new(),
            modalities: BTreeMap::new(),
            mixes: BTreeMap::new(),
            categories: BTreeMap::new(),
            distractors: BTreeMap::new(),
            uses: BTreeMap::new(),
            ordered_m: Spread::new(5.0),
            unordered_m: Spread::new(5.0),
            lengths: BTreeMap::new(),
            ordered_steps: Spread::new(25.0),
            unordered_steps: Spread::new(25.0),
            start_m: Spread::new(2.0),
            words: Spread::new(2.0),
        }
    }
}

impl Statistics {
    /// Returns the statistics of a scene.
    pub fn of_scene(facts: Option<SceneFacts>, episodes: &[EpisodeSpec]) -> Self {
        let mut numbers = Self { scenes: 1, missions: episodes.len() as u64, ..Self::default() };
        if let Some(facts) = facts {
            numbers.regions.note(f64::from(facts.regions));
            *numbers.storeys.entry(facts.storeys).or_default() += 1;
            numbers.area_m2.note(facts.area_m2);
            numbers.instances.note(f64::from(facts.instances));
            for (test, count) in facts.removed.iter().flat_map(Removals::by_test) {
                *numbers.removed.entry(test.to_owned()).or_default() += u64::from(count);
            }
        }
        let mut uses: BTreeMap<u32, u32> = BTreeMap::new();
        for episode in episodes {
            numbers.note(episode);
            for goal in &episode.goals {
                *uses.entry(goal.target.instance).or_default() += 1;
            }
        }
        uses.into_values().for_each(|count| *numbers.uses.entry(count).or_default() += 1);
        numbers
    }

    fn note(&mut self, episode: &EpisodeSpec) {
        *self.goals.entry(episode.goals.len()).or_default() += 1;
        let mut mix: Vec<_> = episode.goals.iter().map(|goal| goal.cue.modality().as_str()).collect();
        mix.sort_unstable();
        *self.mixes.entry(mix.join(" + ")).or_default() += 1;
        self.ordered_m.note(episode.ordered.length_m);
        self.unordered_m.note(episode.unordered.length_m);
        self.lengths.entry(episode.goals.len()).or_default().note(episode);
        self.ordered_steps.note(f64::from(episode.ordered.steps));
        self.unordered_steps.note(f64::from(episode.unordered.steps));
        for goal in &episode.goals {
            *self.modalities.entry(goal.cue.modality().as_str().to_owned()).or_default() += 1;
            *self.categories.entry(goal.target.category.clone()).or_default() += 1;
            *self.distractors.entry(goal.distractors).or_default() += 1;
            self.start_m.note(goal.target.start_distance_m);
            if let CueSpec::Description(sentence) = &goal.cue {
                self.words.note(sentence.text.split_whitespace().count() as f64);
            }
        }
    }

    /// Adds statistics from other scenes.
    pub fn add(&mut self, other: &Self) {
        self.scenes += other.scenes;
        self.missions += other.missions;
        add(&mut self.storeys, &other.storeys);
        add(&mut self.removed, &other.removed);
        add(&mut self.goals, &other.goals);
        add(&mut self.modalities, &other.modalities);
        add(&mut self.mixes, &other.mixes);
        add(&mut self.categories, &other.categories);
        add(&mut self.distractors, &other.distractors);
        add(&mut self.uses, &other.uses);
        for (goals, lengths) in &other.lengths {
            self.lengths.entry(*goals).or_default().add(lengths);
        }
        let mut other = other.clone();
        self.spreads().into_iter().zip(other.spreads()).for_each(|(mine, theirs)| mine.add(theirs));
    }

    fn spreads(&mut self) -> [&mut Spread; 9] {
        [
            &mut self.regions,
            &mut self.area_m2,
            &mut self.instances,
            &mut self.ordered_m,
            &mut self.unordered_m,
            &mut self.ordered_steps,
            &mut self.unordered_steps,
            &mut self.start_m,
            &mut self.words,
        ]
    }

    /// Returns the goal count.
    pub fn goal_count(&self) -> u64 {
        self.modalities.values().sum()
    }

    /// Returns the goal share with a modality, 0 to 1.
    pub fn share(&self, modality: &str) -> f64 {
        self.modalities.get(modality).copied().unwrap_or(0) as f64 / self.goal_count().max(1) as f64
    }
}

fn add<K: Ord + Clone>(mine: &mut BTreeMap<K, u64>, theirs: &BTreeMap<K, u64>) {
    for (key, count) in theirs {
        *mine.entry(key.clone()).or_default() += count;
    }
}

/// Distribution summary: count, sum, extremes, histogram.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spread {
    /// Value count.
    pub count: u64,
    /// Value sum.
    pub sum: f64,
    /// Minimum; 0 if empty.
    pub min: f64,
    /// Maximum; 0 if empty.
    pub max: f64,
    /// Histogram bin width.
    pub bin: f64,
    /// Counts per bin n, `[n * bin, (n + 1) * bin)`.
    pub bins: BTreeMap<u32, u64>,
}

impl Spread {
    /// Returns an empty distribution with bin width `bin`.
    pub fn new(bin: f64) -> Self {
        Self { count: 0, sum: 0.0, min: 0.0, max: 0.0, bin, bins: BTreeMap::new() }
    }

    /// Adds a value, 0 or more.
    pub fn note(&mut self, value: f64) {
        self.min = if self.count == 0 { value } else { self.min.min(value) };
        self.max = if self.count == 0 { value } else { self.max.max(value) };
        self.count += 1;
        self.sum += value;
        *self.bins.entry((value / self.bin).floor().max(0.0) as u32).or_default() += 1;
    }

    /// Adds another distribution with equal bin width.
    pub fn add(&mut self, other: &Self) {
        if other.count == 0 {
            return;
        }
        self.min = if self.count == 0 { other.min } else { self.min.min(other.min) };
        self.max = if self.count == 0 { other.max } else { self.max.max(other.max) };
        self.count += other.count;
        self.sum += other.sum;
        add(&mut self.bins, &other.bins);
    }

    /// Returns the mean; 0 if empty.
    pub fn mean(&self) -> f64 {
        self.sum / self.count.max(1) as f64
    }
}

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#222}\
table{border-collapse:collapse;margin:.5rem 0 1.5rem}td,th{padding:.15rem .6rem;text-align:left;vertical-align:middle}\
td.n{text-align:right;font-variant-numeric:tabular-nums}.bar{background:#4a7ab5;height:.8rem;display:block}\
h2{margin-top:2.5rem;border-bottom:1px solid #ccc}";
/// Longest bar, em.
const LONGEST_BAR_EM: f64 = 20.0;

/// Returns the HTML statistics page with a section per split.
pub fn page(name: &str, splits: &[(String, Statistics)]) -> String {
    let name = escaped(name);
    let mut html = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>{name}: statistics</title>\
         <style>{STYLE}</style><h1>{name}: statistics</h1>"
    );
    for (split, numbers) in splits {
        let _ = write!(html, "<h2>{}</h2><table>", escaped(split));
        for (label, value) in summary(numbers) {
            let _ = write!(html, "<tr><th>{label}<td>{value}");
        }
        html.push_str("</table>");
        counts(&mut html, "Goals of a mission", &numbers.goals);
        counts(&mut html, "Modalities of goals", &numbers.modalities);
        counts(&mut html, "Modalities of a mission", &numbers.mixes);
        counts(&mut html, "Categories of targets", &numbers.categories);
        counts(&mut html, "Same-category distractors of a target", &numbers.distractors);
        counts(&mut html, "Missions that ask for a target", &numbers.uses);
        histogram(&mut html, "Reference length, ordered, metres", &numbers.ordered_m);
        histogram(&mut html, "Reference length, unordered, metres", &numbers.unordered_m);
        for (goals, lengths) in &numbers.lengths {
            let title = |order: &str| format!("Reference length, {order}, {goals} goals, metres");
            histogram(&mut html, &title("ordered"), &lengths.ordered_m);
            histogram(&mut html, &title("unordered"), &lengths.unordered_m);
        }
        histogram(&mut html, "Reference steps, ordered", &numbers.ordered_steps);
        histogram(&mut html, "Reference steps, unordered", &numbers.unordered_steps);
        histogram(&mut html, "Start to success region, metres", &numbers.start_m);
        histogram(&mut html, "Words of a description", &numbers.words);
        histogram(&mut html, "Rooms of a scene", &numbers.regions);
        counts(&mut html, "Storeys of a scene", &numbers.storeys);
        histogram(&mut html, "Walkable area of a scene, square metres", &numbers.area_m2);
        histogram(&mut html, "Possible targets of a scene", &numbers.instances);
        counts(&mut html, "Instances removed by each test", &numbers.removed);
    }
    html
}

/// Returns the main numbers with labels.
pub fn summary(numbers: &Statistics) -> Vec<(String, String)> {
    let spread = |spread: &Spread, unit: &str| {
        format!("{:.1}{unit} ({:.1} to {:.1})", spread.mean(), spread.min, spread.max)
    };
    let share = |modality| format!("{:.1} %", 100.0 * numbers.share(modality));
    let shares = ["category", "description", "image"].map(share);
    let targets: u64 = numbers.uses.values().sum();
    let per_target = per(numbers.goal_count(), targets);
    let most = numbers.uses.keys().next_back().copied().unwrap_or(0);
    let mut lines = vec![
        ("scenes", numbers.scenes.to_string()),
        ("missions", numbers.missions.to_string()),
        ("goals", numbers.goal_count().to_string()),
        ("category, description, image", shares.join(", ")),
        ("targets", format!("{targets}, each requested {per_target:.1} times, at most {most}")),
        ("reference length, ordered", spread(&numbers.ordered_m, " m")),
        ("reference length, unordered", spread(&numbers.unordered_m, " m")),
        ("reference steps, ordered", spread(&numbers.ordered_steps, "")),
        ("reference steps, unordered", spread(&numbers.unordered_steps, "")),
        ("start to success region", spread(&numbers.start_m, " m")),
        ("words of a description", spread(&numbers.words, "")),
        ("rooms of a scene", spread(&numbers.regions, "")),
        ("walkable area of a scene", spread(&numbers.area_m2, " m2")),
    ]
    .into_iter()
    .map(|(label, value)| (label.to_owned(), value))
    .collect::<Vec<_>>();
    lines.extend(numbers.lengths.iter().map(by_goals));
    lines.extend(removed(numbers));
    lines
}

/// Returns the mean reference lengths for a goal count (figure 2b of the paper).
fn by_goals((goals, lengths): (&usize, &Lengths)) -> (String, String) {
    let Lengths { ordered_m, unordered_m, ordered_steps } = lengths;
    let [ordered_m, unordered_m, steps] = [ordered_m, unordered_m, ordered_steps].map(Spread::mean);
    let value = format!("{ordered_m:.1} m ordered ({steps:.1} steps), {unordered_m:.1} m unordered");
    (format!("reference length, {goals} goals"), value)
}

/// Returns the instances removed by each test; `None` if not recorded.
fn removed(numbers: &Statistics) -> Option<(String, String)> {
    let counts: Vec<_> = numbers.removed.iter().map(|(test, count)| format!("{test} {count}")).collect();
    (!counts.is_empty()).then(|| ("removed instances".to_owned(), counts.join(", ")))
}

/// Escapes text for HTML. Categories of imported data sets are arbitrary text.
fn escaped(text: &str) -> String {
    // The ampersand first: it begins the other replacements.
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

fn per(count: u64, of: u64) -> f64 {
    count as f64 / of.max(1) as f64
}

fn counts<K: Display>(html: &mut String, title: &str, counts: &BTreeMap<K, u64>) {
    table(html, title, counts.iter().map(|(key, &count)| (key.to_string(), count)));
}

fn histogram(html: &mut String, title: &str, spread: &Spread) {
    let label = |bin: u32| format!("{} to {}", f64::from(bin) * spread.bin, f64::from(bin + 1) * spread.bin);
    table(html, title, spread.bins.iter().map(|(&bin, &count)| (label(bin), count)));
}

fn table(html: &mut String, title: &str, rows: impl Iterator<Item = (String, u64)>) {
    let rows: Vec<_> = rows.collect();
    let most = rows.iter().map(|row| row.1).max().unwrap_or(1).max(1);
    let total: u64 = rows.iter().map(|row| row.1).sum();
    let _ = write!(html, "<h3>{title}</h3><table>");
    for (label, count) in rows {
        let label = escaped(&label);
        let width = LONGEST_BAR_EM * count as f64 / most as f64;
        let share = 100.0 * per(count, total);
        let _ = write!(
            html,
            "<tr><td>{label}<td class=n>{count}<td class=n>{share:.1} %<td><span class=bar style=\"width:{width:.2}em\"></span>"
        );
    }
    html.push_str("</table>");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spreads_add_up() {
        let of = |values: &[f64]| {
            let mut spread = Spread::new(5.0);
            values.iter().for_each(|&value| spread.note(value));
            spread
        };
        let mut sum = of(&[1.0, 4.0]);
        sum.add(&of(&[5.0, 12.0]));
        sum.add(&of(&[]));
        assert_eq!(sum, of(&[1.0, 4.0, 5.0, 12.0]));
        assert_eq!((sum.mean(), sum.min, sum.max), (5.5, 1.0, 12.0));
        assert_eq!(sum.bins, BTreeMap::from([(0, 2), (1, 1), (2, 1)]));
    }

    #[test]
    fn page_escapes_names_and_categories() {
        let mut numbers = Statistics::default();
        numbers.categories.insert("<script>\"&".to_owned(), 1);
        let html = page("<b>", &[("<i>".to_owned(), numbers)]);
        assert!(html.contains("&lt;script&gt;&quot;&amp;") && html.contains("&lt;b&gt;: statistics"));
        assert!(!html.contains("<script") && !html.contains("<b>") && !html.contains("<i>"), "{html}");
    }

    #[test]
    fn summary_has_lengths_and_removals() {
        let mut numbers = Statistics::default();
        assert!(summary(&numbers).iter().all(|(label, _)| label != "removed instances"));
        let lengths = numbers.lengths.entry(2).or_default();
        [(20.0, 10.0, 120.0), (30.0, 20.0, 140.0)].into_iter().for_each(|(ordered_m, unordered_m, steps)| {
            lengths.ordered_m.note(ordered_m);
            lengths.unordered_m.note(unordered_m);
            lengths.ordered_steps.note(steps);
        });
        numbers.removed.insert("verifier".to_owned(), 7);
        let lines = summary(&numbers);
        let value =
            |name: &str| lines.iter().find(|(label, _)| label == name).map(|(_, value)| value.as_str());
        let lengths = value("reference length, 2 goals");
        assert_eq!(lengths, Some("25.0 m ordered (130.0 steps), 15.0 m unordered"));
        assert_eq!(value("removed instances"), Some("verifier 7"));
    }
}
