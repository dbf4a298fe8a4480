use crate::words;
use avln_store::{EpisodeView, Replay, SubmitMark};

/// Something that happened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Event {
    /// When; 0 is before the first action.
    pub(crate) step: u32,
    pub(crate) words: String,
    /// Whether a claim was right; `None` for what is no claim.
    pub(crate) is_right: Option<bool>,
}

/// What happened in a replay, in order of time.
pub(super) fn events(view: &EpisodeView, replay: &Replay) -> Vec<Event> {
    let mut events = vec![event(0, "Start".to_owned())];
    events.extend(sounds(&replay.sounding));
    events.extend(entries(replay));
    events.extend(replay.submits.iter().map(|submit| claim(replay, submit)));
    let reason = view.end.map(|end| format!("End: {}", words::end(&end)));
    events.extend(reason.map(|words| event(replay.actions.len() as u32, words)));
    // Stable: what happens in one step stays in the order above.
    events.sort_by_key(|event| event.step);
    events
}

fn event(step: u32, words: String) -> Event {
    Event { step, words, is_right: None }
}

/// Goals as people count them.
fn name(replay: &Replay, goal: u8) -> String {
    let number = u32::from(goal) + 1;
    let target = replay.targets.get(usize::from(goal));
    target.map_or_else(
        || format!("goal {number}"),
        |target| format!("goal {number} ({})", target.category.replace('_', " ")),
    )
}

/// When another goal begins to sound, or silence.
fn sounds(sounding: &[Option<u8>]) -> Vec<Event> {
    let mut last = None;
    let mut changes = Vec::new();
    for (step, &now) in (1..).zip(sounding) {
        if now != last {
            let words = now
                .map_or_else(|| "Silence".to_owned(), |goal| format!("Goal {} sounds", u32::from(goal) + 1));
            changes.push(event(step, words));
        }
        last = now;
    }
    changes
}

/// When the body first stood in the success region of each goal.
fn entries(replay: &Replay) -> Vec<Event> {
    let first = |goal: u8| {
        let inside = replay
            .in_region
            .iter()
            .position(|bits| bits.checked_shr(u32::from(goal)).unwrap_or(0) & 1 == 1)?;
        Some(event(inside as u32 + 1, format!("Enters the success region of {}", name(replay, goal))))
    };
    (0..replay.targets.len() as u8).filter_map(first).collect()
}

fn claim(replay: &Replay, submit: &SubmitMark) -> Event {
    let action =
        replay.actions.get((submit.step as usize).saturating_sub(1)).map_or("Submit", String::as_str);
    let words = match (submit.completed, submit.wrong_instance) {
        (Some(goal), _) => format!("{action}, right: {} is found", name(replay, goal)),
        (None, Some(goal)) => {
            format!("{action}, wrong: another instance of the category of {}", name(replay, goal))
        }
        (None, None) => format!("{action}, wrong"),
    };
    Event { step: submit.step, words, is_right: Some(submit.completed.is_some()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_of_what_sounds_is_told_once() {
        let told = sounds(&[Some(1), Some(1), Some(0), None, None]);
        let told: Vec<_> = told.iter().map(|event| (event.step, event.words.as_str())).collect();
        assert_eq!(told, [(1, "Goal 2 sounds"), (3, "Goal 1 sounds"), (4, "Silence")]);
        assert_eq!(sounds(&[]), []);
    }
}
