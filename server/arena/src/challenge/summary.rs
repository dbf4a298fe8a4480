//! Changes by a challenge file in words.

use super::{ChallengeChanges, SplitSource, counted, plan::PhaseChange};
use avln_scoring::{common_episodes, smallest_difference};
use avln_store::{AuditNote, Phase, calendar::rfc3339};
use std::collections::BTreeSet;

/// Form of a summary.
#[derive(Clone, Copy, Debug, Default)]
pub struct SummaryStyle {
    /// True after the changes, false before.
    pub is_applied: bool,
    /// True for all settings of new phases.
    pub is_verbose: bool,
}

impl ChallengeChanges {
    /// Returns the lines of a summary: changes by phase and split, warnings, and the number of changes.
    pub fn summary(&self, style: SummaryStyle) -> Vec<String> {
        let mut lines = Vec::new();
        for (phase, change) in &self.phases {
            match change {
                PhaseChange::Added => lines.push(format!("+ phase {}: {}", phase.id, described(phase))),
                PhaseChange::Changed => lines.push(format!("~ phase {}", phase.id)),
                PhaseChange::Unchanged => {}
            }
            if style.is_verbose || *change == PhaseChange::Changed {
                lines.extend(self.settings_of(phase));
            }
        }
        let split = |(name, source): &(String, SplitSource)| {
            format!("+ split {name}: split {} in {}", source.split, source.dataset.display())
        };
        lines.extend(self.splits.iter().map(split));
        lines.extend(self.warnings.iter().map(|warning| format!("warning: {warning}")));
        let left_out = |id: &String| format!("phase {id} is not in the file and stays unchanged");
        lines.extend(self.left_out.iter().map(left_out));
        if !style.is_applied {
            lines.extend(self.phases.iter().map(|(phase, _)| resolution(phase)));
        }
        lines.push(self.counts(style.is_applied));
        lines
    }

    /// Returns a phase's changed settings, a line each.
    fn settings_of(&self, phase: &Phase) -> impl Iterator<Item = String> {
        let subject = format!("phase {}", phase.id);
        let words = |value: &Option<String>| value.clone().unwrap_or_else(|| "-".to_owned());
        let of_phase = self.notes.iter().filter(move |note| note.subject == subject);
        of_phase.map(move |AuditNote { what, before, after, .. }| {
            format!("    {what}: {} -> {}", words(before), words(after))
        })
    }

    fn counts(&self, is_applied: bool) -> String {
        if self.notes.is_empty() {
            return "nothing to change".to_owned();
        }
        let count = |wanted: PhaseChange| self.phases.iter().filter(|(_, change)| *change == wanted).count();
        let added = counted(count(PhaseChange::Added), "phase");
        let (changed, same) = (count(PhaseChange::Changed), count(PhaseChange::Unchanged));
        let splits = counted(self.splits.len(), "split");
        if is_applied {
            format!("{added} added, {changed} changed, {splits} taken in; {same} unchanged")
        } else {
            format!("{added} to add, {changed} to change, {splits} to take in; {same} unchanged")
        }
    }
}

fn described(phase: &Phase) -> String {
    let all = counted(phase.episodes.len(), "episode");
    let episodes = match phase.sampling.sample {
        Some(sample) => format!("{} of {all} per run", sample.episodes),
        None => all,
    };
    let opens = phase.schedule.opens_unix_ms.map_or_else(|| "at once".to_owned(), rfc3339);
    let closes = phase.schedule.closes_unix_ms.map(|moment| format!(", closes {}", rfc3339(moment)));
    let (scores, replays) = (phase.scores, phase.replays);
    format!(
        "{episodes} of split {}, opens {opens}{}, scores {scores}, replays {replays}",
        phase.split,
        closes.unwrap_or_default()
    )
}

/// Returns a line with the smallest visible difference between two methods.
fn resolution(phase: &Phase) -> String {
    const FEW_SCENES: usize = 10;
    let all = phase.episodes.len() as u32;
    let sample = phase.sampling.sample.map(|sample| (sample.episodes, sample.anchors));
    let scenes = phase.episodes.iter().map(|episode| &episode.scene).collect::<BTreeSet<_>>().len();
    let common = common_episodes(all, sample);
    let points = smallest_difference(common, scenes as u32)
        .map_or_else(|| "over 25".to_owned(), |share| format!("about {:.0}", 100.0 * share));
    let episodes =
        counted(common.round() as usize, if sample.is_some() { "common episode" } else { "episode" });
    let few = if scenes < FEW_SCENES { ", few scenes" } else { "" };
    format!(
        "phase {}: two methods differ visibly from {points} points of SR ({episodes}, {}{few})",
        phase.id,
        counted(scenes, "scene")
    )
}
