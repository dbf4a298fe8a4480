//! Tested differences: statistics, table rows, chart rows and text.
//!
//! Differences are paired by mission, or between groups in a house; houses are resampled as a whole.

use super::chart::ChartRow;
use avln_episode::Order;
use avln_geom::Rng;
use std::fmt::Write as _;

const SEED: u64 = 1;
/// Random sign patterns, for more houses than [`MOST_EXACT`].
const DRAWS: u32 = 20_000;
/// Most houses with all sign patterns: 65 536.
const MOST_EXACT: usize = 16;
/// Resamples per interval.
const RESAMPLES: usize = 4000;
/// Significance level.
const LEVEL: f64 = 0.05;

/// A difference with a two-sided test.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Difference {
    /// Compared missions or goals.
    pub(super) count: usize,
    /// Houses.
    pub(super) scenes: usize,
    pub(super) value: f64,
    /// 95 % interval, resampled by house; infinite with a single house.
    pub(super) low: f64,
    pub(super) high: f64,
    /// Probability of an equal or greater difference if the signs of the houses were random.
    pub(super) p: f64,
    /// Tests in the family for which `p` is corrected; 1 before the correction.
    pub(super) family: usize,
}

impl Difference {
    pub(super) fn is_significant(&self) -> bool {
        self.p < LEVEL
    }
}

/// A house's share of a weighted mean.
#[derive(Clone, Copy)]
struct SceneSum {
    sum: f64,
    weight: f64,
}

/// Tests the mean of paired differences by scene; `None` without pairs.
pub(super) fn paired(differences: &[(&str, f64)]) -> Option<Difference> {
    let mut sorted = differences.to_vec();
    // Floating-point sums depend on term order.
    sorted.sort_by(|a, b| a.0.cmp(b.0).then(a.1.total_cmp(&b.1)));
    // A scene's missions are alike: they are resampled, and their signs flip, together.
    let scenes = sorted.chunk_by(|a, b| a.0 == b.0).map(|scene| SceneSum {
        sum: scene.iter().map(|(_, value)| value).sum(),
        weight: scene.len() as f64,
    });
    test(&scenes.collect::<Vec<_>>(), sorted.len())
}

/// Tests the difference of two groups' means inside the scenes: scene, `true` for the first group, value. Scenes without one of
/// the groups do not count; the others count by the harmonic mean of the group sizes, the inverse variance.
pub(super) fn between(values: &[(&str, bool, f64)]) -> Option<Difference> {
    let mut sorted = values.to_vec();
    sorted.sort_by(|a, b| a.0.cmp(b.0).then(a.1.cmp(&b.1)).then(a.2.total_cmp(&b.2)));
    let (mut scenes, mut count) = (Vec::new(), 0);
    for scene in sorted.chunk_by(|a, b| a.0 == b.0) {
        let [second, first] = [false, true].map(|group| {
            let own = scene.iter().filter(|(_, of, _)| *of == group);
            own.fold((0.0, 0.0), |(sum, size), (_, _, value)| (sum + value, size + 1.0))
        });
        if first.1 > 0.0 && second.1 > 0.0 {
            let weight = first.1 * second.1 / (first.1 + second.1);
            scenes.push(SceneSum { sum: weight * (first.0 / first.1 - second.0 / second.1), weight });
            count += scene.len();
        }
    }
    test(&scenes, count)
}

fn test(scenes: &[SceneSum], count: usize) -> Option<Difference> {
    let value = mean(scenes.iter())?;
    let (low, high) = interval(scenes).unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
    let p = sign_flip(scenes);
    let (low, high) = (low.min(value), high.max(value));
    Some(Difference { count, scenes: scenes.len(), value, low, high, p, family: 1 })
}

fn mean<'a>(scenes: impl Iterator<Item = &'a SceneSum>) -> Option<f64> {
    let (sum, weight) =
        scenes.fold((0.0, 0.0), |(sum, weight), scene| (sum + scene.sum, weight + scene.weight));
    (weight > 0.0).then(|| sum / weight)
}

/// Returns the percentile bootstrap interval over scenes (Efron 1979); `None` with a single scene.
fn interval(scenes: &[SceneSum]) -> Option<(f64, f64)> {
    if scenes.len() < 2 {
        return None;
    }
    let mut rng = Rng::new(SEED);
    let mut resample = || mean((0..scenes.len()).map(|_| &scenes[rng.below(scenes.len())])).unwrap_or(0.0);
    let mut means: Vec<f64> = (0..RESAMPLES).map(|_| resample()).collect();
    means.sort_by(f64::total_cmp);
    Some((means[RESAMPLES / 40 - 1], means[RESAMPLES - RESAMPLES / 40]))
}

/// Returns the two-sided p-value of the sign-flip permutation test (Fisher 1935).
fn sign_flip(scenes: &[SceneSum]) -> f64 {
    let total = scenes.iter().map(|scene| scene.sum).sum::<f64>().abs() - 1e-9;
    let flipped = |is_kept: &mut dyn FnMut(usize) -> bool| {
        let terms =
            (0..).zip(scenes).map(|(index, scene)| if is_kept(index) { scene.sum } else { -scene.sum });
        terms.sum::<f64>().abs()
    };
    if scenes.len() <= MOST_EXACT {
        let patterns = 1_u32 << scenes.len();
        let extreme =
            (0..patterns).filter(|pattern| flipped(&mut |index| pattern >> index & 1 == 0) >= total);
        return extreme.count() as f64 / f64::from(patterns);
    }
    let mut rng = Rng::new(SEED);
    let extreme = (0..DRAWS).filter(|_| flipped(&mut |_| rng.next_u64() >> 63 == 0) >= total).count();
    // The observed pattern counts too, so that no p-value is 0.
    (extreme as f64 + 1.0) / (f64::from(DRAWS) + 1.0)
}

/// Corrects a family of p-values for their number (Holm 1979).
pub(super) fn holm<'a>(family: impl IntoIterator<Item = &'a mut Difference>) {
    let mut family: Vec<_> = family.into_iter().collect();
    family.sort_by(|a, b| a.p.total_cmp(&b.p));
    let (count, mut least) = (family.len(), 0.0);
    for (rank, difference) in family.into_iter().enumerate() {
        least = (difference.p * (count - rank) as f64).max(least).min(1.0);
        (difference.p, difference.family) = (least, count);
    }
}

/// Returns mean and count; 0 without values.
pub(super) fn average(values: impl Iterator<Item = f64>) -> (f64, usize) {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), value| (sum + value, count + 1));
    (if count == 0 { 0.0 } else { sum / count as f64 }, count)
}

/// Returns the middle value, the upper one of two; 0 without values.
pub(super) fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

pub(super) const ORDERS: [Order; 2] = [Order::Ordered, Order::Unordered];

/// A part of the page, with the charts in `images/` by file name.
#[derive(Default)]
pub(super) struct PageSection {
    pub(super) text: String,
    pub(super) charts: Vec<(String, String)>,
}

impl PageSection {
    /// Appends a chart with a description for readers without images; nothing without a chart.
    pub(super) fn add_chart(&mut self, name: &str, description: &str, svg: Option<String>) {
        let Some(svg) = svg else { return };
        let _ = write!(self.text, "\n![{description}](images/{name})\n");
        self.charts.push((name.to_owned(), svg));
    }
}

/// A tested difference, in percentage points.
pub(super) struct Contrast {
    pub(super) label: String,
    pub(super) order: Order,
    pub(super) test: Difference,
}

impl Contrast {
    /// Returns the difference with its p-value: `+12.3 points, p = 0.0010`.
    pub(super) fn words(&self) -> String {
        format!("{:+.1} points, {}", self.test.value, p(&self.test))
    }

    /// Returns the label with the order.
    pub(super) fn name(&self) -> String {
        format!("{}, {}", self.label, self.order.as_str())
    }
}

/// Tests all cases in both orders, as a family with corrected p-values. A test returns label and difference; `None` without
/// results.
pub(super) fn family<T>(
    cases: &[T],
    test: impl Fn(Order, &T) -> Option<(String, Difference)>,
) -> Vec<Contrast> {
    let mut family = Vec::new();
    for order in ORDERS {
        let tested = cases.iter().filter_map(|case| test(order, case));
        family.extend(tested.map(|(label, test)| Contrast { label, order, test }));
    }
    correct(&mut family);
    family
}

/// Corrects the p-values of a family.
pub(super) fn correct(family: &mut [Contrast]) {
    holm(family.iter_mut().map(|contrast| &mut contrast.test));
}

/// Names the families of a table's tests: one for the table, or one for each agent.
pub(super) fn family_note<'a>(tests: impl Iterator<Item = &'a Difference>) -> String {
    let sizes: Vec<usize> = tests.map(|test| test.family).collect();
    match sizes[..] {
        [1] => "The p-value of the only test is not corrected.".to_owned(),
        [size, ..] if size == sizes.len() => {
            format!("p-values are corrected over the {size} tests of this table.")
        }
        _ => "p-values are corrected over the tests of each agent in this table.".to_owned(),
    }
}

/// Returns the family of the tests, and a table with a row per difference in `number`.
pub(super) fn contrast_table(contrasts: &[Contrast], number: &str) -> String {
    let family = family_note(contrasts.iter().map(|contrast| &contrast.test));
    let mut text =
        format!("{family}\n\n| comparison | order | n | {number} difference | p |\n|---|---|---|---|---|\n");
    for Contrast { label, order, test } in contrasts {
        let cells = [label.clone(), order.as_str().to_owned(), test.count.to_string(), points(test), p(test)];
        let _ = writeln!(text, "| {} |", cells.join(" | "));
    }
    text
}

/// Returns the differences as chart rows.
pub(super) fn chart_rows(contrasts: &[Contrast]) -> Vec<ChartRow> {
    let row = |Contrast { label, order, test }: &Contrast| ChartRow {
        label: label.clone(),
        order: *order,
        value: test.value,
        low: test.low,
        high: test.high,
    };
    contrasts.iter().map(row).collect()
}

/// Returns a difference with its interval; `-` for the interval of a single house.
pub(super) fn points(test: &Difference) -> String {
    if test.low.is_finite() {
        format!("{:+.1} [{:+.1}, {:+.1}]", test.value, test.low, test.high)
    } else {
        format!("{:+.1} [-]", test.value)
    }
}

pub(super) fn p(test: &Difference) -> String {
    if test.p < 1e-4 { "p < 0.0001".to_owned() } else { format!("p = {:.4}", test.p) }
}

/// Joins words: `a`, `a and b`, `a, b and c`.
pub(super) fn list(words: &[String]) -> String {
    match words {
        [] => String::new(),
        [one] => one.clone(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOUSES: [&str; 11] = ["a", "b", "c", "d", "e", "f", "g", "h", "i", "j", "k"];

    #[test]
    fn eleven_agreeing_houses_have_probability_1_in_1024() {
        let tested = paired(&HOUSES.map(|house| (house, 0.5))).unwrap();
        assert_eq!((tested.count, tested.scenes, tested.p), (11, 11, 1.0 / 1024.0));
        assert_eq!((tested.value, tested.low, tested.high), (0.5, 0.5, 0.5));
        assert!(tested.is_significant());
    }

    #[test]
    fn median_ignores_outliers() {
        assert_eq!(median([5.0, 90.0, 4.0].into_iter()), 5.0);
        assert_eq!((median([1.0, 2.0].into_iter()), median(std::iter::empty())), (2.0, 0.0));
    }

    #[test]
    fn one_opposed_house_of_four_doubles_no_sign() {
        // Sums of ±1 ±1 ±1 ±1: |sum| >= 2 in 10 of 16 patterns.
        let tested = paired(&[("a", 1.0), ("b", 1.0), ("c", 1.0), ("d", -1.0)]).unwrap();
        assert_eq!((tested.value, tested.p), (0.5, 10.0 / 16.0));
    }

    #[test]
    fn missions_of_a_house_flip_together() {
        let one_house: Vec<_> = (0..100).map(|_| ("a", 1.0)).collect();
        let tested = paired(&one_house).unwrap();
        assert_eq!((tested.count, tested.scenes, tested.p), (100, 1, 1.0));
        assert_eq!((tested.low, tested.high), (f64::NEG_INFINITY, f64::INFINITY));
        assert_eq!(paired(&[]), None);
    }

    #[test]
    fn random_patterns_agree_with_all_patterns() {
        let names: Vec<String> = (0..17).map(|house| format!("{house:02}")).collect();
        let alike: Vec<_> = names.iter().map(|name| (name.as_str(), 1.0)).collect();
        assert!(paired(&alike).unwrap().p < 1e-3);
        let mixed: Vec<_> = (0..17).map(|house| (names[house].as_str(), [1.0, -1.0][house % 2])).collect();
        assert_eq!(paired(&mixed).unwrap().p, 1.0);
    }

    #[test]
    fn groups_are_compared_inside_houses() {
        // House b is easier for both groups: the difference is 0.5 in both houses.
        let values = [
            ("a", true, 0.5),
            ("a", true, 0.5),
            ("a", false, 0.0),
            ("b", true, 1.0),
            ("b", false, 0.5),
            ("c", true, 1.0),
        ];
        let tested = between(&values).unwrap();
        assert!((tested.value - 0.5).abs() < 1e-12, "{tested:?}");
        assert_eq!((tested.count, tested.scenes, tested.p), (5, 2, 0.5));
        assert_eq!(between(&values[5..]), None);
    }

    #[test]
    fn intervals_cover_the_spread_of_houses() {
        let tested = paired(&HOUSES.map(|house| (house, if house < "f" { 0.0 } else { 1.0 }))).unwrap();
        // Six of eleven houses: 0.545 ± 1.96 × sqrt(0.545 × 0.455 / 11) = 0.25 to 0.84.
        assert!((0.15..0.35).contains(&tested.low) && (0.75..0.95).contains(&tested.high), "{tested:?}");
    }

    #[test]
    fn holm_corrects_by_rank() {
        let of = |p| Difference { count: 1, scenes: 1, value: 1.0, low: 0.0, high: 2.0, p, family: 1 };
        let mut family = [of(0.04), of(0.01), of(0.03), of(0.9)];
        holm(&mut family);
        assert_eq!(family.map(|tested| (tested.p * 100.0).round() as u32), [9, 4, 9, 90]);
        let note = family_note(family.iter());
        assert_eq!(note, "p-values are corrected over the 4 tests of this table.");
        let two_agents = [family, family].concat();
        assert!(family_note(two_agents.iter()).contains("of each agent"));
        assert!(family_note([of(0.5)].iter()).contains("not corrected"));
    }

    #[test]
    fn differences_are_shown_with_interval_and_p() {
        let test = Difference { count: 9, scenes: 3, value: 1.5, low: -0.5, high: 3.0, p: 0.25, family: 1 };
        let contrast = Contrast { label: "a - b".to_owned(), order: Order::Ordered, test };
        let table = contrast_table(&[contrast], "ISR");
        assert!(table.ends_with("| a - b | ordered | 9 | +1.5 [-0.5, +3.0] | p = 0.2500 |\n"), "{table}");
        let single = Difference { low: f64::NEG_INFINITY, high: f64::INFINITY, p: 1e-5, ..test };
        assert_eq!((points(&single), p(&single)), ("+1.5 [-]".to_owned(), "p < 0.0001".to_owned()));
    }

    #[test]
    fn lists_end_with_and() {
        let words = ["a", "b", "c"].map(str::to_owned);
        assert_eq!(
            (list(&words), list(&words[..1]), list(&[])),
            ("a, b and c".into(), "a".into(), String::new())
        );
    }
}
