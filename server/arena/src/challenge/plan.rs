//! Challenge file and data folder compared.

use crate::{
    Failure,
    challenge::{
        ChallengeFile, Fault, KeyPath, PhaseFile, SplitSource, actor,
        conversion::{FileSplits, PhaseConversion},
        notes, one_line,
        overlap::{Content, Overlap, REMEDY, overlaps},
    },
    data::{DataFolder, check_name},
    dataset::SplitFolder,
    now_unix_ms,
    phases::commit,
    setup::{self, fixed},
};
use avln_store::{AuditNote, Phase, Store};
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
    pub(super) splits: Vec<(String, SplitSource)>,
    /// All phases of the file.
    pub(super) phases: Vec<(Phase, PhaseChange)>,
    /// Audit entries for the differences.
    pub notes: Vec<AuditNote>,
    /// Phases missing in the file; they stay unchanged.
    pub left_out: Vec<String>,
    /// Defects of earlier versions that the file leaves as they are.
    pub warnings: Vec<String>,
}

/// A phase's change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PhaseChange {
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

impl From<avln_store::StoreError> for PlanError {
    fn from(error: avln_store::StoreError) -> Self {
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
                .map_err(|failure| KeyPath { path: &["splits", name] }.fault(one_line(&failure)));
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
                faults.push(KeyPath { path: &["phases", &index.to_string(), "split"] }.fault(problem));
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
        let path = KeyPath { path: &["phases", &index.to_string(), "id"] };
        path.fault(format!("'{}' is already the id of another phase", entry.id))
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
