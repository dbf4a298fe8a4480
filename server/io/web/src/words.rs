//! Numbers, times and enums in the words of the pages.

pub(crate) use avln_store::calendar::rfc3339;

use avln_episode::{Encoding, EndReason, Modality, Order, Sensors};
use avln_scoring::{Difference, Direction, Estimate, Key, Standing, Summary};
use avln_store::{
    EpisodeState, LeaderboardRow, PhaseState, QuotaWindow, Reference, RunChoice, RunState, Visibility,
};
use std::{collections::BTreeMap, fmt::Write};

/// What stands where there is nothing to say.
pub(crate) const NOTHING: &str = "–";

/// A share as a percentage with one decimal.
pub(crate) fn share(value: &f64) -> String {
    format!("{:.1} %", value * 100.0)
}

/// The same, for what may be missing.
pub(crate) fn maybe_share(value: &Option<f64>) -> String {
    value.as_ref().map_or_else(|| NOTHING.to_owned(), share)
}

/// A number with one decimal.
pub(crate) fn number(value: &f64) -> String {
    format!("{value:.1}")
}

/// A length in metres with two decimals.
pub(crate) fn metres(value: &f64) -> String {
    format!("{value:.2} m")
}

/// The same, for what may be missing.
pub(crate) fn maybe_metres(value: &Option<f64>) -> String {
    value.as_ref().map_or_else(|| NOTHING.to_owned(), metres)
}

/// A stretch of time.
pub(crate) fn duration(seconds: &f64) -> String {
    match *seconds {
        s if s < 100.0 => format!("{s:.2} s"),
        s if s < 6000.0 => format!("{:.1} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

/// Milliseconds, to hundredths.
pub(crate) fn maybe_milliseconds(milliseconds: Option<f64>) -> String {
    milliseconds.map_or_else(|| NOTHING.to_owned(), |ms| format!("{ms:.2} ms"))
}

/// A moment for people, UTC, whole minutes.
pub(crate) fn moment(unix_ms: i64) -> String {
    let stamp = rfc3339(unix_ms);
    format!("{} {} UTC", &stamp[..stamp.len() - 10], &stamp[stamp.len() - 9..stamp.len() - 4])
}

/// A `time` element. Digits only, so it needs no escaping.
pub(crate) fn time_html(unix_ms: &i64) -> String {
    format!("<time datetime=\"{}\">{}</time>", rfc3339(*unix_ms), moment(*unix_ms))
}

/// The same, for what may be missing.
pub(crate) fn maybe_time_html(unix_ms: &Option<i64>) -> String {
    unix_ms.as_ref().map_or_else(|| NOTHING.to_owned(), time_html)
}

/// Heading of a metric.
pub(crate) fn metric(key: &Key) -> &'static str {
    match key {
        Key::Sr => "SR",
        Key::Isr => "ISR",
        Key::Osr => "OSR",
        Key::Spl => "SPL",
        Key::SoftSpl => "SoftSPL",
        Key::Sna => "SNA",
        Key::Steps => "Steps",
        Key::PathM => "Path",
        Key::Collisions => "Collisions",
        Key::WrongSubmits => "Wrong submits",
    }
}

/// One sentence on a metric.
pub(crate) fn meaning(key: &Key) -> &'static str {
    match key {
        Key::Sr => "Success rate: share of episodes in which every goal was found",
        Key::Isr => "Share of the goals that were found, mean over episodes",
        Key::Osr => "Share of the goals whose success region was entered, claimed or not",
        Key::Spl => {
            "Success weighted by path length: SR times reference tour over the longer of tour and walk"
        }
        Key::SoftSpl => {
            "ISR weighted by path length: ISR times reference tour over the longer of tour and walk"
        }
        Key::Sna => "Success weighted by the number of actions",
        Key::Steps => "Actions taken in an episode",
        Key::PathM => "Length of the walk, metres",
        Key::Collisions => "Actions in which an obstacle held the body back",
        Key::WrongSubmits => "Claims that completed no goal",
    }
}

/// Which end of a metric is good.
pub(crate) fn better(direction: &Direction) -> &'static str {
    match direction {
        Direction::Higher => "more is better",
        Direction::Lower => "less is better",
    }
}

/// A mean of a metric.
pub(crate) fn mean(key: &Key, value: &f64) -> String {
    match key {
        Key::PathM => metres(value),
        Key::Steps | Key::Collisions | Key::WrongSubmits => number(value),
        Key::Sr | Key::Isr | Key::Osr | Key::Spl | Key::SoftSpl | Key::Sna => share(value),
    }
}

/// How two runs differ in a metric: by points of a hundred for shares.
pub(crate) fn difference(difference: &Difference) -> String {
    let Estimate { value, low, high } = difference.estimate;
    let (unit, digits) = match difference.key {
        Key::PathM => (1.0, 2),
        Key::Steps | Key::Collisions | Key::WrongSubmits => (1.0, 1),
        Key::Sr | Key::Isr | Key::Osr | Key::Spl | Key::SoftSpl | Key::Sna => (100.0, 1),
    };
    // What rounds to nothing has no sign.
    let signed = |value: f64| {
        let text = format!("{:+.digits$}", unit * value).replace('-', "−");
        if text.chars().any(|letter| matches!(letter, '1'..='9')) {
            text
        } else {
            text[text.find('0').unwrap_or(0)..].to_owned()
        }
    };
    format!("{} ({} to {})", signed(value), signed(low), signed(high))
}

/// What a difference says.
pub(crate) fn verdict(difference: &Difference) -> &'static str {
    let is_more = difference.estimate.value > 0.0;
    match (difference.is_sure, is_more == (difference.key.direction() == Direction::Higher)) {
        (false, _) => "≈ may be nothing",
        (true, true) => "the first is better",
        (true, false) => "the second is better",
    }
}

/// The estimate of a metric, for those that have an interval.
pub(crate) fn estimate(key: Key, summary: &Summary) -> Option<Estimate> {
    match key {
        Key::Sr => Some(summary.sr),
        Key::Isr => Some(summary.isr),
        Key::Osr => Some(summary.osr),
        Key::Spl => Some(summary.spl),
        Key::SoftSpl => Some(summary.soft_spl),
        Key::Sna => Some(summary.sna),
        Key::Steps | Key::PathM | Key::Collisions | Key::WrongSubmits => None,
    }
}

/// A metric of a summary as the inside of a cell: the number and, where there is one, its interval as text and bar.
/// Digits only, so it needs no escaping.
pub(crate) fn cell_html(key: &Key, summary: &Summary) -> String {
    match estimate(*key, summary) {
        Some(estimate) => estimate_html(&estimate),
        None if *key == Key::PathM => metres(&key.mean_of(summary)),
        None => number(&key.mean_of(summary)),
    }
}

/// A share with its interval as text and bar. Digits only, so it needs no escaping.
pub(crate) fn estimate_html(estimate: &Estimate) -> String {
    let at = |share: f64| (share.clamp(0.0, 1.0) * 90.0 + 5.0).round() as i64;
    let (low, value, high) = (at(estimate.low), at(estimate.value), at(estimate.high));
    let mut html = format!("<span class=\"value\">{}</span>", share(&estimate.value));
    let _ = write!(
        html,
        "<svg class=\"bar\" viewBox=\"0 0 100 10\" aria-hidden=\"true\">\
         <line class=\"axis\" x1=\"5\" y1=\"5\" x2=\"95\" y2=\"5\"/>\
         <line class=\"reach\" x1=\"{low}\" y1=\"5\" x2=\"{high}\" y2=\"5\"/>\
         <circle cx=\"{value}\" cy=\"5\" r=\"4\"/></svg>\
         <span class=\"interval\"><span class=\"hidden\">95 % interval </span>{:.1} to {:.1}</span>",
        estimate.low * 100.0,
        estimate.high * 100.0
    );
    html
}

/// How goals count.
pub(crate) fn order(order: &Order) -> &'static str {
    match order {
        Order::Ordered => "Ordered",
        Order::Unordered => "Unordered",
    }
}

/// Which run stands for a method.
pub(crate) fn pick(pick: &RunChoice) -> &'static str {
    match pick {
        RunChoice::Best => "best",
        RunChoice::Latest => "latest",
    }
}

/// How a goal was told.
pub(crate) fn reference(reference: &Reference) -> &'static str {
    match reference {
        Reference::Baseline => "baseline",
        Reference::Oracle => "oracle",
        Reference::Human => "people",
    }
}

/// The rank, and the ranks that it might have with other scenes. Digits only, so it needs no escaping.
pub(crate) fn rank_html(standing: &Option<Standing>) -> String {
    match standing {
        None => NOTHING.to_owned(),
        Some(Standing { rank, rank_low, rank_high, .. }) if rank_low == rank_high => rank.to_string(),
        Some(Standing { rank, rank_low, rank_high, .. }) => format!(
            "{rank} <span class=\"interval\"><span class=\"hidden\">95 % interval </span>{rank_low} to {rank_high}</span>"
        ),
    }
}

/// How many runs of a method there are, and what the middle one reached where there are several.
pub(crate) fn runs(row: &LeaderboardRow, key: &Key) -> String {
    let runs = plural(&row.runs_count, "run");
    if row.runs_count < 2 { runs } else { format!("{runs}, median {}", mean(key, &row.median)) }
}

pub(crate) fn modality(modality: &Modality) -> &'static str {
    match modality {
        Modality::Category => "category",
        Modality::Description => "sentence",
        Modality::Image => "picture",
    }
}

/// How far a run is.
pub(crate) fn run_state(state: &RunState) -> &'static str {
    match state {
        RunState::Created => "not begun",
        RunState::Running => "running",
        RunState::Completed => "completed",
        RunState::Failed => "lost by the server",
        RunState::Expired => "out of time",
        RunState::Cancelled => "cancelled",
    }
}

/// How far an episode is.
pub(crate) fn episode_state(state: &EpisodeState) -> &'static str {
    match state {
        EpisodeState::Pending => "pending",
        EpisodeState::Running => "being played",
        EpisodeState::Terminated => "ended",
        EpisodeState::Truncated => "cut off",
        EpisodeState::Infra => "lost by the server",
    }
}

/// Whether runs may start.
pub(crate) fn phase_state(state: &PhaseState) -> &'static str {
    match state {
        PhaseState::Upcoming => "not open yet",
        PhaseState::Open => "open",
        PhaseState::Paused => "paused",
        PhaseState::Closed => "closed",
    }
}

/// Which runs a quota counts.
pub(crate) fn window(window: &QuotaWindow) -> &'static str {
    match window {
        QuotaWindow::Day => "this day (UTC)",
        QuotaWindow::Month => "this month (UTC)",
        QuotaWindow::Total => "the whole phase",
        QuotaWindow::Concurrent => "open at a time",
        QuotaWindow::Uncharged => "not charged",
    }
}

/// How many; there may be no end to them.
pub(crate) fn maybe_count(count: &Option<u32>) -> String {
    count.map_or_else(|| "any number".to_owned(), |count| count.to_string())
}

/// Who may see something.
pub(crate) fn visibility(visibility: &Visibility) -> &'static str {
    match visibility {
        Visibility::Public => "everybody",
        Visibility::Team => "each team its own",
        Visibility::Organiser => "the organiser",
    }
}

/// Why an episode ended.
pub(crate) fn end(reason: &EndReason) -> &'static str {
    match reason {
        EndReason::Stopped => "stopped",
        EndReason::FinalSubmit => "last submit",
        EndReason::StepLimit => "step limit",
        EndReason::TimeBudget => "out of time",
        EndReason::Abandoned => "abandoned",
        EndReason::Disconnected => "disconnected",
        EndReason::ServerFault => "server fault",
    }
}

/// Why an episode ended, if it did.
pub(crate) fn maybe_end(reason: &Option<EndReason>) -> &'static str {
    reason.as_ref().map_or(NOTHING, end)
}

/// How many episodes ended in which way, the most frequent first.
pub(crate) fn ends(counts: &BTreeMap<&'static str, u32>) -> Vec<(u32, &'static str)> {
    let named =
        |word: &str| EndReason::ALL.into_iter().find(|r| r.as_str() == word).as_ref().map_or("other", end);
    let mut parts: Vec<(u32, &str)> = counts.iter().map(|(word, &times)| (times, named(word))).collect();
    parts.sort_by_key(|&(times, _)| std::cmp::Reverse(times));
    parts
}

/// The same in a sentence; lost attempts last.
pub(crate) fn health(counts: &BTreeMap<&'static str, u32>, server_faults: &u32) -> String {
    let parts = ends(counts);
    let mut words: Vec<String> = parts.iter().map(|(times, word)| format!("{times} {word}")).collect();
    if *server_faults > 0 {
        words.push(format!("{} lost by the server and repeated", plural(server_faults, "attempt")));
    }
    if words.is_empty() { NOTHING.to_owned() } else { words.join(", ") }
}

/// What an agent senses and what it does without, and how the numbers travel where they do not travel raw.
pub(crate) fn sensors(sensors: &Sensors) -> String {
    let Sensors { rgb, depth, audio, width, height, hfov_rad, encodings } = sensors;
    let all = [
        (*rgb, "colour", encodings.rgb),
        (*depth, "depth", encodings.depth),
        (*audio, "sound", encodings.audio),
    ];
    let mut words: Vec<String> =
        all.iter().filter(|(on, ..)| *on).map(|(_, name, encoding)| travelling(name, *encoding)).collect();
    if words.is_empty() {
        words.push("pose alone".to_owned());
    }
    words.extend(all.iter().filter(|(on, ..)| !*on).map(|(_, name, _)| format!("no {name}")));
    format!("{}; pictures of {width} × {height} pixels, {:.0}° wide", words.join(", "), hfov_rad.to_degrees())
}

/// The senses of an agent in few words.
pub(crate) fn senses(sensors: &Option<Sensors>) -> String {
    let Some(Sensors { rgb, depth, audio, .. }) = sensors else { return NOTHING.to_owned() };
    let word = |on: &bool, name: &str| if *on { name.to_owned() } else { format!("no {name}") };
    [word(rgb, "colours"), word(depth, "depth"), word(audio, "sound")].join(", ")
}

fn travelling(name: &str, encoding: Encoding) -> String {
    if encoding == Encoding::Raw { name.to_owned() } else { format!("{name} ({})", encoding.as_str()) }
}

/// A count with its noun, whose plural ends in s.
pub(crate) fn plural(count: &u32, noun: &str) -> String {
    let s = if *count == 1 { "" } else { "s" };
    format!("{count} {noun}{s}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_follow_the_calendar() {
        assert_eq!(rfc3339(0), "1970-01-01T00:00:00Z");
        assert_eq!(rfc3339(951_782_399_999), "2000-02-28T23:59:59Z");
        assert_eq!(rfc3339(951_782_400_000), "2000-02-29T00:00:00Z");
        assert_eq!(rfc3339(4_107_542_400_000), "2100-03-01T00:00:00Z");
        assert_eq!(rfc3339(-1), "1969-12-31T23:59:59Z");
        assert_eq!(moment(1_795_266_906_000), "2026-11-21 13:15 UTC");
    }

    #[test]
    fn differences_have_signs_and_say_who_is_better() {
        let estimate = |value, low, high| Estimate { value, low, high };
        let of = |key, estimate, is_sure| Difference { key, first: 0.0, second: 0.0, estimate, is_sure };
        let sr = of(Key::Sr, estimate(0.123, -0.0001, 0.25), false);
        assert_eq!((difference(&sr).as_str(), verdict(&sr)), ("+12.3 (0.0 to +25.0)", "≈ may be nothing"));
        let steps = of(Key::Steps, estimate(-31.0, -40.0, -22.0), true);
        assert_eq!(
            (difference(&steps).as_str(), verdict(&steps)),
            ("−31.0 (−40.0 to −22.0)", "the first is better")
        );
        assert_eq!(verdict(&of(Key::Spl, estimate(-0.5, -0.6, -0.4), true)), "the second is better");
    }

    #[test]
    fn an_interval_is_told_in_digits_and_drawn() {
        let html = estimate_html(&Estimate { value: 0.5, low: 0.25, high: 0.75 });
        assert!(html.contains("50.0 %") && html.contains("25.0 to 75.0"), "{html}");
        assert!(html.contains("x1=\"28\" y1=\"5\" x2=\"73\"") && html.contains("cx=\"50\""), "{html}");
    }

    #[test]
    fn what_an_agent_does_without_is_told() {
        let mut asked = Sensors { audio: false, ..Sensors::all(256, 128) };
        assert_eq!(sensors(&asked), "colour, depth, no sound; pictures of 256 × 128 pixels, 90° wide");
        asked.encodings.depth = Encoding::PackedMillimetres;
        assert!(
            sensors(&asked).starts_with("colour, depth (whole millimetres, packed), no sound;"),
            "{}",
            sensors(&asked)
        );
        let blind = Sensors { rgb: false, depth: false, ..asked };
        assert!(
            sensors(&blind).starts_with("pose alone, no colour, no depth, no sound;"),
            "{}",
            sensors(&blind)
        );
    }

    #[test]
    fn senses_that_are_not_there_are_told() {
        let deaf = Sensors { audio: false, ..Sensors::all(64, 64) };
        assert_eq!(senses(&Some(deaf)), "colours, depth, no sound");
        assert_eq!(senses(&None), NOTHING);
    }

    #[test]
    fn health_names_the_most_frequent_end_first() {
        let counts = BTreeMap::from([("final_submit", 2), ("stopped", 5)]);
        assert_eq!(health(&counts, &0), "5 stopped, 2 last submit");
        assert_eq!(
            health(&counts, &1),
            "5 stopped, 2 last submit, 1 attempt lost by the server and repeated"
        );
        assert_eq!(health(&BTreeMap::new(), &0), NOTHING);
    }

    #[test]
    fn stretches_of_time_choose_their_unit() {
        assert_eq!(duration(&1.5), "1.50 s");
        assert_eq!(duration(&120.0), "2.0 min");
        assert_eq!(duration(&7200.0), "2.0 h");
    }
}
