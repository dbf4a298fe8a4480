//! Hidden phases with scenes or missions of public phases.

use super::counted;
use crate::{Failure, dataset::SplitFolder};
use avln_dataset::{PublicGoal, PublicMission};
use avln_store::{Phase, PhaseState, Visibility};
use std::{
    collections::{BTreeMap, BTreeSet, btree_map::Entry},
    fmt,
};

/// Remedy for an overlap.
pub(crate) const REMEDY: &str = "make another split: avln data split make NAME";

/// Digests of a split's scenes and missions, without their names.
#[derive(Default)]
pub(crate) struct Content {
    scenes: BTreeSet<String>,
    missions: BTreeSet<[u8; 32]>,
}

impl Content {
    /// Reads a split's scenes and missions.
    pub(crate) fn of(split: &SplitFolder) -> Result<Self, Failure> {
        let mut content = Self::default();
        for scene in split.scenes() {
            content.scenes.insert(scene.digest.clone());
            for mission in split.public(scene)? {
                content.missions.insert(mission_digest(&mission)?);
            }
        }
        Ok(content)
    }
}

/// Hashes a mission's start and kinds of goals by BLAKE3. The words of a sentence depend on the scene's name.
fn mission_digest(mission: &PublicMission) -> Result<[u8; 32], Failure> {
    let kind = |goal: &PublicGoal| match goal {
        PublicGoal::Category(label) => label.clone(),
        PublicGoal::Description(_) => "a sentence".to_owned(),
        PublicGoal::Image => "an image".to_owned(),
    };
    let goals: Vec<_> = mission.goals.iter().map(kind).collect();
    let json = serde_json::to_vec(&(&mission.start, goals)).map_err(Failure::internal)?;
    Ok(*blake3::hash(&json).as_bytes())
}

/// A hidden phase with scenes or missions of a public phase.
pub(crate) struct Overlap<'a> {
    pub(crate) hidden: &'a Phase,
    pub(crate) public: &'a Phase,
    scenes: usize,
    missions: usize,
}

impl Overlap<'_> {
    /// Returns true if both phases existed before, with the same episodes and visibility.
    pub(crate) fn is_old(&self, before: &[Phase]) -> bool {
        [self.hidden, self.public].into_iter().all(|phase| {
            before.iter().any(|old| {
                let is_same =
                    old.id == phase.id && old.split == phase.split && old.episodes == phase.episodes;
                is_same && [old.scores, old.replays] == [phase.scores, phase.replays]
            })
        })
    }
}

impl fmt::Display for Overlap<'_> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            formatter,
            "phase '{}' is hidden, but shares {} and {} with public phase '{}'",
            self.hidden.id,
            counted(self.scenes, "scene"),
            counted(self.missions, "mission"),
            self.public.id
        )
    }
}

/// Finds overlaps of hidden with public phases. `content` reads a split by name; it is not called without both kinds of
/// phases.
pub(crate) fn overlaps<'a>(
    phases: &'a [Phase],
    now_unix_ms: i64,
    mut content: impl FnMut(&str) -> Result<Content, Failure>,
) -> Result<Vec<Overlap<'a>>, Failure> {
    let is_hidden =
        |phase: &Phase| !is_public(phase) && phase.schedule.state(now_unix_ms) != PhaseState::Closed;
    let hidden: Vec<&Phase> = phases.iter().filter(|phase| is_hidden(phase)).collect();
    let public: Vec<&Phase> = phases.iter().filter(|phase| is_public(phase)).collect();
    if hidden.is_empty() || public.is_empty() {
        return Ok(Vec::new());
    }
    let mut contents: BTreeMap<&str, Content> = BTreeMap::new();
    for phase in hidden.iter().chain(&public) {
        if let Entry::Vacant(unread) = contents.entry(&phase.split) {
            unread.insert(content(&phase.split)?);
        }
    }
    let mut found = Vec::new();
    for &hidden in &hidden {
        for &public in &public {
            let (first, second) = (&contents[hidden.split.as_str()], &contents[public.split.as_str()]);
            let scenes = first.scenes.intersection(&second.scenes).count();
            let missions = first.missions.intersection(&second.missions).count();
            if scenes + missions > 0 {
                found.push(Overlap { hidden, public, scenes, missions });
            }
        }
    }
    Ok(found)
}

/// Returns true if participants see replays, and thereby the targets. Replays are not shown without scores.
fn is_public(phase: &Phase) -> bool {
    phase.replays == Visibility::Public && phase.scores != Visibility::Organiser
}
