//! Challenge file and data folder compared, and the changes in words.

use crate::{
    Failure,
    challenge::{
        ChallengeFile, Fault, PhaseFile, SplitSource, actor,
        conversion::{FileSplits, PhaseConversion},
        counted, notes, one_line,
        overlap::{Content, Overlap, REMEDY, overlaps},
    },
    data::{DataFolder, check_name},
    dataset::SplitFolder,
    now_unix_ms,
    phases::commit,
    setup::{self, fixed},
};
use avln_scoring::{common_episodes, smallest_difference};
use avln_store::{AuditNote, Phase, Store, StoreError, calendar::rfc3339};
use std::{collections::BTreeSet, path::Path, sync::Arc};

/// Computes and applies the changes by a challenge file.
pub struct Planner<'a> {
    /// Data folder.
    pub data: &'a DataFolder,
    /// Database.
    pub store: &'a Store,
    /// Base folder for relative paths.
    pub base: &'a Path,
    /// Reason for audit entries; may be empty.
    pub reason: &'a str,
}

/// Changes by a file.
#[derive(Debug, Default)]
pub struct ChallengeChanges {
    /// New splits: name and source.
    splits: Vec<(String, SplitSource)>,
    /// All phases of the file.
    phases: Vec<(Phase, PhaseChange)>,
    /// Audit entries for the differences.
    pub notes: Vec<AuditNote>,
    /// Phases missing in the file; they stay unchanged.
    pub left_out: Vec<String>,
    /// Defects of earlier versions that the file leaves as they are.
    pub warnings: Vec<String>,
}

/// A phase's change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PhaseChange {
    Added,
    Changed,
    Unchanged,
}

/// Planning errors.
#[derive(Debug)]
pub enum PlanError {
    /// Faults in the file.
    File(Vec<Fault>),
    /// Any other failure.
    Other(Failure),
}

impl From<Failure> for PlanError {
    fn from(failure: Failure) -> Self {
        Self::Other(failure)
    }
}

impl From<StoreError> for PlanError {
    fn from(error: StoreError) -> Self {
        Self::Other(error.into())
    }
}

impl Planner<'_> {
    /// Computes the changes. Writes nothing except imported recordings and heads.
    pub async fn plan(&self, file: &ChallengeFile) -> Result<ChallengeChanges, PlanError> {
        let before = self.store.phases().await?;
        let published = &self.store.published_splits().await?;
        let mut faults = repeated_ids(file);
        let splits = self.splits(file, &mut faults);
        let mut plan = ChallengeChanges::default();
        for (index, (entry, position)) in file.phases.iter().zip(positions(file, &before)).enumerate() {
            let old = before.iter().find(|phase| phase.id == entry.id);
            let fixed = fixed(self.store, old).await?;
            let (data, base, index) = (self.data, self.base, &index.to_string());
            match (PhaseConversion { data, base, index, entry, old, fixed, published }).phase(&splits) {
                Ok(phase) => plan.add(old, Phase { position, ..phase }, self.reason),
                Err(of_phase) => faults.extend(of_phase),
            }
        }
        let named = |phase: &&Phase| file.phases.iter().any(|entry| entry.id == phase.id);
        let left_out: Vec<&Phase> = before.iter().filter(|phase| !named(phase)).collect();
        plan.left_out = left_out.iter().map(|phase| phase.id.clone()).collect();
        let after = plan.phases.iter().map(|(phase, _)| phase).chain(left_out).cloned().collect::<Vec<_>>();
        match self.overlaps(&after, &splits) {
            Ok(found) => plan.warnings = sort_overlaps(&found, file, &before, &mut faults),
            // The split may be unreadable because of a reported fault.
            Err(failure) if faults.is_empty() => return Err(failure.into()),
            Err(_) => {}
        }
        if !faults.is_empty() {
            return Err(PlanError::File(faults));
        }
        let known = self.store.split_names().await?;
        plan.take_in(file, &known, self.reason);
        Ok(plan)
    }

    /// Applies the changes; phases and audit entries in a single transaction.
    pub async fn apply(&self, plan: ChallengeChanges) -> Result<(), Failure> {
        // Splits before phases: a phase refers to a registered split.
        for (name, source) in &plan.splits {
            self.data.link_split_as(name, &self.base.join(&source.dataset), &source.split)?;
            setup::register_split(self.store, name, &self.data.missions(name)?, &[]).await?;
        }
        if plan.notes.is_empty() {
            return Ok(());
        }
        let changed = plan.phases.into_iter().filter(|(_, change)| *change != PhaseChange::Unchanged);
        let phases: Vec<Phase> = changed.map(|(phase, _)| phase).collect();
        self.store.change_phases(&phases, &plan.notes, now_unix_ms()).await?;
        for phase in &phases {
            commit(self.store, &phase.id).await?;
        }
        Ok(())
    }

    fn splits(&self, file: &ChallengeFile, faults: &mut Vec<Fault>) -> FileSplits {
        let mut splits = FileSplits::new();
        for (name, SplitSource { dataset, split }) in &file.splits {
            let opened = check_name("split", name)
                .and_then(|()| SplitFolder::open(&self.base.join(dataset), split))
                .map_err(|failure| Fault::at_key(&["splits", name], one_line(&failure)));
            splits.insert(name.clone(), opened.map_err(|fault| faults.push(fault)).ok().map(Arc::new));
        }
        splits
    }

    fn overlaps<'a>(&self, after: &'a [Phase], splits: &FileSplits) -> Result<Vec<Overlap<'a>>, Failure> {
        overlaps(after, now_unix_ms(), |name| match splits.get(name) {
            Some(Some(split)) => Content::of(split),
            _ => Content::of(&self.data.missions(name)?),
        })
    }
}

impl ChallengeChanges {
    /// Adds a phase with the differences from the previous version.
    fn add(&mut self, old: Option<&Phase>, phase: Phase, reason: &str) {
        let differences = notes(&actor(), old, &phase, reason);
        let change = match old {
            None => PhaseChange::Added,
            Some(_) if differences.is_empty() => PhaseChange::Unchanged,
            Some(_) => PhaseChange::Changed,
        };
        self.notes.extend(differences);
        self.phases.push((phase, change));
    }

    /// Adds the file's splits that the data folder lacks.
    fn take_in(&mut self, file: &ChallengeFile, known: &[String], reason: &str) {
        let splits = file.splits.clone().into_iter();
        self.splits = splits.filter(|(name, _)| !known.contains(name)).collect();
        let taken_in = |(name, source): &(String, SplitSource)| AuditNote {
            actor: actor(),
            subject: format!("split {name}"),
            what: "taken in".to_owned(),
            after: Some(source.split.clone()),
            reason: reason.to_owned(),
            ..AuditNote::default()
        };
        self.notes.extend(self.splits.iter().map(taken_in));
    }
}

/// Returns warnings for old overlaps, and records a fault for every other one.
fn sort_overlaps(
    found: &[Overlap<'_>],
    file: &ChallengeFile,
    before: &[Phase],
    faults: &mut Vec<Fault>,
) -> Vec<String> {
    let mut warnings = Vec::new();
    let index = |phase: &Phase| file.phases.iter().position(|entry| entry.id == phase.id);
    for overlap in found {
        let problem = format!("{overlap}; {REMEDY}");
        // A pair outside the file is unchanged, so it is old.
        match index(overlap.hidden).or_else(|| index(overlap.public)) {
            Some(index) if !overlap.is_old(before) => {
                faults.push(Fault::at_key(&["phases", &index.to_string(), "split"], problem));
            }
            _ => warnings.push(problem),
        }
    }
    warnings
}

fn repeated_ids(file: &ChallengeFile) -> Vec<Fault> {
    let mut seen = BTreeSet::new();
    let repeated = file.phases.iter().enumerate().filter(|(_, entry)| !seen.insert(&entry.id));
    let fault = |(index, entry): (usize, &PhaseFile)| {
        let problem = format!("'{}' is already the id of another phase", entry.id);
        Fault::at_key(&["phases", &index.to_string(), "id"], problem)
    };
    repeated.map(fault).collect()
}

/// Returns the positions: unchanged for the same order, otherwise counted from 0.
fn positions(file: &ChallengeFile, before: &[Phase]) -> Vec<u32> {
    let path = |id: &str| before.iter().position(|phase| phase.id == id);
    let known: Vec<usize> = file.phases.iter().map_while(|entry| path(&entry.id)).collect();
    let new = &file.phases[known.len()..];
    let kept = known.is_sorted() && new.iter().all(|entry| path(&entry.id).is_none());
    if !kept {
        return (0..file.phases.len() as u32).collect();
    }
    let next = before.iter().map(|phase| phase.position + 1).max().unwrap_or(0);
    let old = known.into_iter().map(|index| before[index].position);
    old.chain((next..).take(new.len())).collect()
}

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
