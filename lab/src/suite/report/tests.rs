//! Tests of the whole page.

use super::*;
use crate::suite::results::samples::{line, moved};
use avln_pag_nav::{Preset, Weights};

const EPISODES: u32 = 22;

/// Returns results of an agent in both orders: a number of found goals by episode.
fn row_of(agent: &str, found: impl Fn(u32) -> u32) -> Vec<ResultLine> {
    let episode = |order| (0..EPISODES).map(move |episode| (order, episode));
    ORDERS
        .into_iter()
        .flat_map(episode)
        .map(|(order, episode)| line(agent, order, episode, found(episode)))
        .collect()
}

/// Returns results of methods, ablations and both tracks: PAG-Nav finds everything, the others every second goal or nothing.
fn sample() -> Vec<ResultLine> {
    let names = ["random", "sound-follower", "pag-nav", "pag-nav-no-audio", "shortest-path"];
    let found = |name: &str, episode: u32| match name {
        "random" => 0,
        "sound-follower" | "pag-nav-no-audio" => episode % 2,
        _ => 2,
    };
    let main = names.iter().flat_map(|name| row_of(name, |episode| found(name, episode)));
    let mut lines: Vec<_> = main.collect();
    let verdicts = ["pag-nav", "pag-nav-no-audio"];
    let verdicts = verdicts.iter().flat_map(|name| row_of(name, |_| 2)).collect::<Vec<_>>();
    lines.extend(verdicts.into_iter().map(|line| moved(line, "main", "verdict")));
    let hard = ["sound-follower", "shortest-path"];
    let hard =
        hard.iter().flat_map(|name| row_of(name, |_| if *name == FLOOR { 0 } else { 2 })).collect::<Vec<_>>();
    lines.extend(hard.into_iter().map(|line| moved(line, "hard", "none")));
    lines
}

fn page(lines: &[ResultLine]) -> SuiteReport {
    of_lines(&comparable(lines.iter())).expect("a page")
}

/// Returns the part of a page below a heading.
fn part<'a>(page: &'a str, heading: &str) -> &'a str {
    let (_, after) = page.split_once(&format!("{heading}\n")).expect("the heading");
    after.split_once("\n#").map_or(after, |(part, _)| part)
}

#[test]
fn head_states_missions_houses_and_versions() {
    let page = page(&sample()).page;
    for row in [
        "| missions | 22 in 11 houses: split `val` of the recipe `paper`",
        "| reference, ordered | 110.5 steps, 30.5 m on average |",
        "| storeys | 1 in 6 houses and 2 in 5 houses |",
        "| walkable area | 120 m² on average (120 to 120) |",
        "| images | 128 × 128 pixels, colour and depth |",
        "| clips | validation share of the bank |",
        "| versions | program 1, benchmark 2 |",
    ] {
        assert!(page.contains(row), "{row} in {page}");
    }
}

#[test]
fn fresh_missions_are_named() {
    let fresh = |mut line: ResultLine| {
        line.key.split_seed = Some(7);
        line
    };
    let lines: Vec<_> = sample().into_iter().map(fresh).collect();
    let SuiteReport { page, episodes, .. } = page(&lines);
    assert!(page.contains("unseen in training and tuning; split seed 7 |"), "{page}");
    assert!(episodes.lines().nth(1).is_some_and(|row| row.ends_with(",7")), "{episodes}");
}

#[test]
fn rows_show_type_and_distance_to_the_floor() {
    let page = page(&sample()).page;
    let table = part(&page, "### Unordered: all agents");
    let row = |name: &str| table.lines().find(|line| line.starts_with(name)).expect("a row");
    assert!(
        row("| pag-nav |")
            .contains("| learnt perception | yes | 22 | 100.0 [100.0, 100.0] | +100.0 [+100.0, +100.0] |")
    );
    assert!(
        row("| sound-follower |").contains("| training-free | yes | 22 | 0.0 [0.0, 0.0] | - |"),
        "{table}"
    );
    assert!(row("| shortest-path † |").starts_with("| shortest-path † | - | - | 22 |"), "{table}");
    assert!(!table.contains("no-audio"), "{table}");
    assert!(part(&page, "### Ablations, ordered").contains("| pag-nav-no-audio |"), "{page}");
}

#[test]
fn every_question_has_a_test_a_chart_and_an_answer() {
    let report = page(&sample());
    let charts: Vec<&str> = report.charts.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(charts, ["results-difficulty.svg", "results-sound.svg", "results-factors.svg"]);
    assert!(charts.iter().all(|name| report.page.contains(&format!("](images/{name})"))));
    assert_eq!(report.page.matches("**Answer.**").count(), 4, "{}", report.page);
    let answer = |start: &str| {
        let mut lines = report.page.lines();
        lines.find(|line| line.starts_with(&format!("**Answer.** {start}"))).expect("an answer").to_owned()
    };
    let first = answer("The best method without ground truth, pag-nav (learnt perception)");
    assert!(
        first.ends_with("the differences to random (the best of other types) are significant."),
        "{first}"
    );
    let second =
        answer("For pag-nav, hearing significantly raises the ISR of ordered missions (+75.0 points");
    assert!(
        second.contains("the largest significant benefit is that for image goals, ordered (+100.0 points"),
        "{second}"
    );
    let third =
        answer("On the ISR, of pag-nav unless another agent is named, no factor has a significant effect");
    assert!(third.ends_with("without results: number of goals and memory."), "{third}");
    let hard = answer(
        "The sound-follower completes 0.0 % of the ordered and 0.0 % of the unordered missions (within",
    );
    assert!(hard.ends_with("; pag-nav-plus has no results to compare."), "{hard}");
}

#[test]
fn both_presets_have_effects_of_modality() {
    let mut lines = sample();
    lines.extend(row_of("pag-nav-plus", |_| 1));
    let page = page(&lines).page;
    let table = part(&page, "### Effect of modality");
    assert!(table.contains("corrected over the tests of each agent in this table.\n\n|"), "{table}");
    // The category goal is found and the image goal is not.
    assert!(table.contains("| image - category | ordered | 44 | -100.0 "), "{table}");
    assert!(table.contains("| pag-nav: image - category | ordered | 44 | +0.0 "), "{table}");
}

#[test]
fn hard_track_compares_sr_and_isr() {
    let mut lines = sample();
    let sighted = "pag-nav-plus-true-sight";
    let rows = [("pag-nav-plus", 1), (sighted, 2), ("pag-nav-plus-true-sight-no-search-sound", 1)];
    let rows = rows.into_iter().flat_map(|(name, found)| row_of(name, move |_| found));
    lines.extend(rows.map(|line| moved(line, "hard", "none")));
    let page = page(&lines).page;
    let table = part(&page, "### Hard track, unordered");
    for row in [
        "| ISR: pag-nav-plus-true-sight - pag-nav-plus-true-sight-no-search-sound | ordered | 22 | +50.0",
        "| SR: pag-nav-plus - sound-follower | ordered | 22 | +0.0",
        "| ISR: pag-nav-plus - sound-follower | unordered | 22 | +50.0",
    ] {
        assert!(table.contains(row), "{row} in {table}");
    }
    assert!(
        page.contains(
            "above: 2 significantly positive, 0 significantly negative, 2 not significant; differences of pag-nav-plus-true-sight: 4 \
             significantly positive, 0 significantly negative, 0 not significant."
        ),
        "{page}"
    );
    assert!(table.contains("corrected over the 4 tests of this table.\n\n|"), "{table}");
}

#[test]
fn verdict_rows_are_compared_among_themselves() {
    let page = page(&sample()).page;
    let table = part(&page, "## Question 2: benefit of sound beyond vision and language");
    let row = |start: &str| table.lines().find(|line| line.starts_with(start)).expect("a row");
    assert!(row("| pag-nav - no-audio | ordered | 22 |").contains("| +75.0 ["), "{table}");
    let verdicts = row("| pag-nav - no-audio, verdicts sent to both | ordered | 22 |");
    assert!(verdicts.contains("| +0.0 [+0.0, +0.0], p = 1.0000 |"), "{verdicts}");
    // SR, ISR and OSR in both orders.
    assert_eq!(table.matches("corrected over the 6 tests of this table").count(), 2, "{table}");
}

#[test]
fn both_presets_have_levels_and_differences_with_verdicts() {
    let names = ["pag-nav-plus", "pag-nav-plus-no-audio"];
    let more = names.iter().flat_map(|name| row_of(name, |_| 1)).map(|line| moved(line, "main", "verdict"));
    let none = sample().into_iter().filter(|line| line.key.feedback == "none");
    assert!(!page(&none.collect::<Vec<_>>()).page.contains("With verdicts"));
    let page = page(&sample().into_iter().chain(more).collect::<Vec<_>>()).page;
    for row in [
        "With verdicts, the server sends the outcome of every Submit to both variants.\n",
        "| pag-nav-no-audio | unordered | 22 | 100.0 [100.0, 100.0] | 100.0 [100.0, 100.0] |",
        "| pag-nav-plus-no-audio | ordered | 22 | 0.0 [0.0, 0.0] | 50.0 [50.0, 50.0] |",
        "| pag-nav-plus - no-audio, verdicts sent to both | ordered | 22 | +0.0",
        "| pag-nav - no-audio, verdicts sent to both | unordered | 22 | +0.0",
        "corrected over the 12 tests of this table",
    ] {
        assert!(page.contains(row), "{row} in {page}");
    }
}

#[test]
fn legends_explain_only_present_ablations() {
    let mut lines = sample();
    assert!(!page(&lines).page.contains("*no-search-sound*") && !page(&lines).page.contains("*no-map*"));
    for name in ["pag-nav-plus", "pag-nav-plus-no-search-sound", "pag-nav-plus-no-stairs"] {
        lines.extend(row_of(name, |_| 1));
    }
    let page = page(&lines).page;
    let Weights { verify_floor, verify_unheard, .. } = Preset::PagNavPlus.weights();
    let floors = format!("(in pag-nav-plus {verify_floor} instead of {verify_unheard})");
    assert_eq!(page.matches(&floors).count(), 2, "{page}");
    let legend = part(&page, "## Ablations of PAG-Nav");
    assert!(legend.contains("*no-audio*") && !legend.contains("*no-map*"), "{legend}");
    assert!(legend.contains("The other ablations remove an extension of the paper."), "{legend}");
}

#[test]
fn page_without_ablations_has_no_empty_sections() {
    let lines: Vec<_> =
        row_of("random", |_| 0).into_iter().map(|line| moved(line, "quick", "none")).collect();
    let report = page(&lines);
    assert!(report.page.contains("small houses") && !report.page.contains("Question 2"), "{}", report.page);
    assert_eq!(report.episodes.lines().count(), 1 + 2 * EPISODES as usize);
    assert!(of_lines(&[]).is_none());
}
