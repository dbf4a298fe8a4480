//! Page texts for numbers, times, enums and addresses.

pub(crate) use crate::documents::linked_html;
pub(crate) use avln_store::calendar::rfc3339;

use avln_challenge::MethodType;
use avln_episode::{Encoding, EndReason, Order, Sensors};
use avln_scoring::{Difference, Direction, Estimate, FEW_SCENES, Key, Standing, Summary, Unit};
use avln_store::{EpisodeState, LeaderboardRow, PhaseState, PhaseView, QuotaWindow, RunState, Visibility};
use serde::Serialize;
use serde_json::Value;
use std::{collections::BTreeMap, fmt::Write};

pub(crate) const NOTHING: &str = "–";

pub(crate) fn url_encode(text: &str) -> String {
    askama::filters::urlencode_strict(text).map(|encoded| encoded.to_string()).unwrap_or_default()
}

/// Returns `data` as JSON with a time `x_at` by RFC 3339 for every field `x_unix_ms`.
pub(crate) fn with_named_times(data: &impl Serialize) -> serde_json::Result<Value> {
    let mut value = serde_json::to_value(data)?;
    name_times(&mut value);
    Ok(value)
}

fn name_times(value: &mut Value) {
    match value {
        Value::Array(items) => items.iter_mut().for_each(name_times),
        Value::Object(fields) => {
            for (mut name, mut value) in std::mem::take(fields) {
                name_times(&mut value);
                if let Some(stem) = name.strip_suffix("_unix_ms") {
                    value = value.as_i64().map_or(Value::Null, |ms| rfc3339(ms).into());
                    name = format!("{stem}_at");
                }
                fields.insert(name, value);
            }
        }
        _ => {}
    }
}

pub(crate) fn share(value: &f64) -> String {
    format!("{:.1} %", value * 100.0)
}

pub(crate) fn maybe_share(value: &Option<f64>) -> String {
    value.as_ref().map_or_else(|| NOTHING.to_owned(), share)
}

pub(crate) fn number(value: &f64) -> String {
    format!("{value:.1}")
}

pub(crate) fn metres(value: &f64) -> String {
    format!("{value:.2} m")
}

pub(crate) fn maybe_metres(value: &Option<f64>) -> String {
    value.as_ref().map_or_else(|| NOTHING.to_owned(), metres)
}

pub(crate) fn duration(seconds: &f64) -> String {
    match *seconds {
        s if s < 100.0 => format!("{s:.2} s"),
        s if s < 6000.0 => format!("{:.1} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

/// A time for people: UTC, whole minutes.
pub(crate) fn moment(unix_ms: i64) -> String {
    let stamp = rfc3339(unix_ms);
    format!("{} {} UTC", &stamp[..stamp.len() - 10], &stamp[stamp.len() - 9..stamp.len() - 4])
}

/// A `time` element. It contains only digits, so it needs no escaping.
pub(crate) fn time_html(unix_ms: &i64) -> String {
    format!("<time datetime=\"{}\">{}</time>", rfc3339(*unix_ms), moment(*unix_ms))
}

pub(crate) fn maybe_time_html(unix_ms: &Option<i64>) -> String {
    unix_ms.as_ref().map_or_else(|| NOTHING.to_owned(), time_html)
}

pub(crate) fn metric(key: &Key) -> &'static str {
    key.metric().label
}

pub(crate) fn meaning(key: &Key) -> &'static str {
    key.metric().meaning
}

pub(crate) fn better(direction: &Direction) -> &'static str {
    match direction {
        Direction::Higher => "higher is better",
        Direction::Lower => "lower is better",
    }
}

pub(crate) fn mean(key: &Key, value: &f64) -> String {
    match key.metric().unit {
        Unit::Metres => metres(value),
        Unit::Count => number(value),
        Unit::Share => share(value),
    }
}

/// A difference with interval; shares differ in percentage points.
pub(crate) fn difference(difference: &Difference) -> String {
    let Estimate { value, low, high } = difference.estimate;
    let (factor, digits) = match difference.key.metric().unit {
        Unit::Metres => (1.0, 2),
        Unit::Count => (1.0, 1),
        Unit::Share => (100.0, 1),
    };
    // A value that rounds to zero has no sign.
    let signed = |value: f64| {
        let text = format!("{:+.digits$}", factor * value).replace('-', "−");
        if text.chars().any(|letter| matches!(letter, '1'..='9')) {
            text
        } else {
            text[text.find('0').unwrap_or(0)..].to_owned()
        }
    };
    format!("{} ({} to {})", signed(value), signed(low), signed(high))
}

/// The better run. With few scenes, the verdict is restricted to them.
pub(crate) fn verdict(difference: &Difference, has_few_scenes: bool) -> String {
    let is_more = difference.estimate.value > 0.0;
    let place = if has_few_scenes { " in these scenes" } else { "" };
    match (difference.is_sure, is_more == (difference.key.direction() == Direction::Higher)) {
        (false, _) => "≈ no clear difference".to_owned(),
        (true, true) => format!("first run is better{place}"),
        (true, false) => format!("second run is better{place}"),
    }
}

/// A mark for intervals from few scenes; empty for others.
pub(crate) fn few_scenes_html(scenes: &u32) -> String {
    if *scenes >= FEW_SCENES {
        return String::new();
    }
    let scenes = plural(scenes, "scene");
    format!(" <abbr title=\"from {scenes}; reliable from about {FEW_SCENES}\">few scenes</abbr>")
}

/// A caption sentence about marked intervals; empty without any.
pub(crate) fn few_scenes_note(has_few_scenes: bool) -> String {
    if has_few_scenes {
        format!(" Intervals from fewer than {FEW_SCENES} scenes are unreliable and marked.")
    } else {
        String::new()
    }
}

/// As [`few_scenes_note`], for a leaderboard's rows.
pub(crate) fn rows_note(rows: &[LeaderboardRow]) -> String {
    few_scenes_note(rows.iter().any(|row| row.summary.has_few_scenes()))
}

/// Table cell content: the mean and, if available, the interval as text and bar. It contains only numbers and fixed
/// words, so it needs no escaping.
pub(crate) fn cell_html(key: &Key, summary: &Summary) -> String {
    match key.metric().estimate_of(summary) {
        Some(estimate) => estimate_html(&estimate, summary.scenes),
        None => mean(key, &key.mean_of(summary)),
    }
}

pub(crate) fn estimate_html(estimate: &Estimate, scenes: u32) -> String {
    let class = if scenes < FEW_SCENES { "bar rough" } else { "bar" };
    let at = |share: f64| (share.clamp(0.0, 1.0) * 90.0 + 5.0).round() as i64;
    let (low, value, high) = (at(estimate.low), at(estimate.value), at(estimate.high));
    let mut html = format!("<span class=\"value\">{}</span>", share(&estimate.value));
    let _ = write!(
        html,
        "<svg class=\"{class}\" viewBox=\"0 0 100 10\" aria-hidden=\"true\">\
         <line class=\"axis\" x1=\"5\" y1=\"5\" x2=\"95\" y2=\"5\"/>\
         <line class=\"reach\" x1=\"{low}\" y1=\"5\" x2=\"{high}\" y2=\"5\"/>\
         <circle cx=\"{value}\" cy=\"5\" r=\"4\"/></svg>\
         <span class=\"interval\"><span class=\"hidden\">95 % interval </span>{:.1} to {:.1}{}</span>",
        estimate.low * 100.0,
        estimate.high * 100.0,
        few_scenes_html(&scenes)
    );
    html
}

pub(crate) fn order(order: &Order) -> &'static str {
    match order {
        Order::Ordered => "Ordered",
        Order::Unordered => "Unordered",
    }
}

/// The rank with interval. It contains only numbers and fixed words, so it needs no escaping.
pub(crate) fn rank_html(standing: &Option<Standing>, summary: &Summary) -> String {
    match standing {
        None => NOTHING.to_owned(),
        Some(Standing { rank, rank_low, rank_high, .. }) if rank_low == rank_high => rank.to_string(),
        Some(Standing { rank, rank_low, rank_high, .. }) => format!(
            "{rank} <span class=\"interval\"><span class=\"hidden\">95 % interval </span>{rank_low} to {rank_high}{}</span>",
            few_scenes_html(&summary.scenes)
        ),
    }
}

pub(crate) fn runs(row: &LeaderboardRow, key: &Key) -> String {
    let runs = plural(&row.runs_count, "run");
    if row.runs_count < 2 { runs } else { format!("{runs}, median {}", mean(key, &row.median)) }
}

pub(crate) fn method_type(method_type: &MethodType) -> &'static str {
    match method_type {
        MethodType::TrainingFree => "training-free",
        MethodType::LearntPerception => "learnt perception",
        MethodType::FoundationModels => "foundation models",
        MethodType::Imitation => "imitation",
        MethodType::Rl => "RL",
    }
}

pub(crate) fn maybe_method_type(declared: &Option<MethodType>) -> &'static str {
    declared.as_ref().map_or(NOTHING, method_type)
}

pub(crate) fn run_state(state: &RunState) -> &'static str {
    match state {
        RunState::Created => "not started",
        RunState::Running => "running",
        RunState::Completed => "completed",
        RunState::Failed => "lost by the server",
        RunState::Expired => "out of time",
        RunState::Cancelled => "cancelled",
    }
}

pub(crate) fn episode_state(state: &EpisodeState) -> &'static str {
    match state {
        EpisodeState::Pending => "pending",
        EpisodeState::Running => "in progress",
        EpisodeState::Terminated => "ended",
        EpisodeState::Truncated => "truncated",
        EpisodeState::Infra => "lost by the server",
    }
}

pub(crate) fn phase_state(phase: &PhaseView) -> &'static str {
    match phase.state {
        PhaseState::Closed if phase.closed_by_hand => "closed by the organiser",
        PhaseState::Upcoming => "not open yet",
        PhaseState::Open => "open",
        PhaseState::Paused => "paused",
        PhaseState::Closed => "closed",
    }
}

pub(crate) fn window(window: &QuotaWindow) -> &'static str {
    match window {
        QuotaWindow::Day => "today (UTC)",
        QuotaWindow::Month => "this month (UTC)",
        QuotaWindow::Total => "the whole phase",
        QuotaWindow::Concurrent => "at the same time",
        QuotaWindow::Uncharged => "not charged",
    }
}

pub(crate) fn maybe_count(count: &Option<u32>) -> String {
    count.map_or_else(|| "unlimited".to_owned(), |count| count.to_string())
}

pub(crate) fn visibility(visibility: &Visibility) -> &'static str {
    match visibility {
        Visibility::Public => "everyone",
        Visibility::Team => "each team (its own)",
        Visibility::Organiser => "the organiser",
    }
}

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

pub(crate) fn maybe_end(reason: &Option<EndReason>) -> &'static str {
    reason.as_ref().map_or(NOTHING, end)
}

/// End reasons with their counts, the most frequent first.
pub(crate) fn ends(counts: &BTreeMap<&'static str, u32>) -> Vec<(u32, &'static str)> {
    let named =
        |word: &str| EndReason::ALL.into_iter().find(|r| r.as_str() == word).as_ref().map_or("other", end);
    let mut parts: Vec<(u32, &str)> = counts.iter().map(|(word, &times)| (times, named(word))).collect();
    parts.sort_by_key(|&(times, _)| std::cmp::Reverse(times));
    parts
}

/// End reasons in a sentence; lost attempts last.
pub(crate) fn health(counts: &BTreeMap<&'static str, u32>, server_faults: &u32) -> String {
    let parts = ends(counts);
    let mut words: Vec<String> = parts.iter().map(|(times, word)| format!("{times} {word}")).collect();
    if *server_faults > 0 {
        words.push(format!("{} lost by the server and replayed", plural(server_faults, "attempt")));
    }
    if words.is_empty() { NOTHING.to_owned() } else { words.join(", ") }
}

/// An agent's sensors, with encodings other than raw.
pub(crate) fn sensors(sensors: &Sensors) -> String {
    let Sensors { rgb, depth, audio, width, height, hfov_rad, encodings } = sensors;
    let all = [
        (*rgb, "colour", encodings.rgb),
        (*depth, "depth", encodings.depth),
        (*audio, "sound", encodings.audio),
    ];
    let encoded = |&(_, name, encoding): &(bool, &str, Encoding)| match encoding {
        Encoding::Raw => name.to_owned(),
        encoding => format!("{name} ({})", encoding.as_str()),
    };
    let mut words: Vec<String> = all.iter().filter(|(on, ..)| *on).map(encoded).collect();
    if words.is_empty() {
        words.push("pose only".to_owned());
    }
    words.extend(all.iter().filter(|(on, ..)| !*on).map(|(_, name, _)| format!("no {name}")));
    format!(
        "{}; images of {width} × {height} pixels, {:.0}° field of view",
        words.join(", "),
        hfov_rad.to_degrees()
    )
}

pub(crate) fn sensor_list(sensors: &Option<Sensors>) -> String {
    let Some(Sensors { rgb, depth, audio, .. }) = sensors else { return NOTHING.to_owned() };
    let word = |on: &bool, name: &str| if *on { name.to_owned() } else { format!("no {name}") };
    [word(rgb, "colour"), word(depth, "depth"), word(audio, "sound")].join(", ")
}

pub(crate) fn plural(count: &u32, noun: &str) -> String {
    let s = if *count == 1 { "" } else { "s" };
    format!("{count} {noun}{s}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn times_follow_the_calendar() {
        assert_eq!(rfc3339(0), "1970-01-01T00:00:00Z");
        assert_eq!(rfc3339(951_782_399_999), "2000-02-28T23:59:59Z");
        assert_eq!(rfc3339(951_782_400_000), "2000-02-29T00:00:00Z");
        assert_eq!(rfc3339(4_107_542_400_000), "2100-03-01T00:00:00Z");
        assert_eq!(rfc3339(-1), "1969-12-31T23:59:59Z");
        assert_eq!(moment(1_795_266_906_000), "2026-11-21 13:15 UTC");
    }

    #[test]
    fn times_are_rfc_3339_at_every_depth() {
        let data = json!({ "finished_unix_ms": null, "runs": [{ "created_unix_ms": 1000, "n": 2 }] });
        let expected =
            json!({ "finished_at": null, "runs": [{ "created_at": "1970-01-01T00:00:01Z", "n": 2 }] });
        assert_eq!(with_named_times(&data).expect("JSON"), expected);
    }

    #[test]
    fn differences_have_signs_and_verdicts() {
        let estimate = |value, low, high| Estimate { value, low, high };
        let of = |key, estimate, is_sure| Difference { key, first: 0.0, second: 0.0, estimate, is_sure };
        let sr = of(Key::Sr, estimate(0.123, -0.0001, 0.25), false);
        assert_eq!(
            (difference(&sr).as_str(), verdict(&sr, true).as_str()),
            ("+12.3 (0.0 to +25.0)", "≈ no clear difference")
        );
        let steps = of(Key::Steps, estimate(-31.0, -40.0, -22.0), true);
        assert_eq!(
            (difference(&steps).as_str(), verdict(&steps, false).as_str()),
            ("−31.0 (−40.0 to −22.0)", "first run is better")
        );
        let spl = of(Key::Spl, estimate(-0.5, -0.6, -0.4), true);
        assert_eq!(verdict(&spl, false), "second run is better");
        assert_eq!(verdict(&spl, true), "second run is better in these scenes");
    }

    #[test]
    fn intervals_are_written_and_drawn() {
        let html = estimate_html(&Estimate { value: 0.5, low: 0.25, high: 0.75 }, 10);
        assert!(html.contains("50.0 %") && html.contains("25.0 to 75.0"), "{html}");
        assert!(html.contains("x1=\"28\" y1=\"5\" x2=\"73\"") && html.contains("cx=\"50\""), "{html}");
        assert!(html.contains("class=\"bar\"") && !html.contains("few scenes"), "{html}");
    }

    #[test]
    fn intervals_from_few_scenes_are_marked() {
        let html = estimate_html(&Estimate { value: 0.5, low: 0.25, high: 0.75 }, 9);
        let mark = "75.0 <abbr title=\"from 9 scenes; reliable from about 10\">few scenes</abbr></span>";
        assert!(html.contains(mark) && html.contains("class=\"bar rough\""), "{html}");
        assert!(few_scenes_html(&1).contains("from 1 scene;") && few_scenes_html(&10).is_empty());
        assert!(few_scenes_note(true).contains("fewer than 10 scenes") && few_scenes_note(false).is_empty());
    }

    #[test]
    fn missing_sensors_are_listed() {
        let mut asked = Sensors { audio: false, ..Sensors::all(256, 128) };
        assert_eq!(sensors(&asked), "colour, depth, no sound; images of 256 × 128 pixels, 90° field of view");
        asked.encodings.depth = Encoding::PackedMillimetres;
        assert!(
            sensors(&asked).starts_with("colour, depth (whole millimetres, packed), no sound;"),
            "{}",
            sensors(&asked)
        );
        let blind = Sensors { rgb: false, depth: false, ..asked };
        assert!(
            sensors(&blind).starts_with("pose only, no colour, no depth, no sound;"),
            "{}",
            sensors(&blind)
        );
    }

    #[test]
    fn short_lists_name_missing_sensors() {
        let deaf = Sensors { audio: false, ..Sensors::all(64, 64) };
        assert_eq!(sensor_list(&Some(deaf)), "colour, depth, no sound");
        assert_eq!(sensor_list(&None), NOTHING);
    }

    #[test]
    fn the_most_frequent_end_comes_first() {
        let counts = BTreeMap::from([("final_submit", 2), ("stopped", 5)]);
        assert_eq!(health(&counts, &0), "5 stopped, 2 last submit");
        assert_eq!(
            health(&counts, &1),
            "5 stopped, 2 last submit, 1 attempt lost by the server and replayed"
        );
        assert_eq!(health(&BTreeMap::new(), &0), NOTHING);
    }

    #[test]
    fn durations_choose_their_unit() {
        assert_eq!(duration(&1.5), "1.50 s");
        assert_eq!(duration(&120.0), "2.0 min");
        assert_eq!(duration(&7200.0), "2.0 h");
    }
}
