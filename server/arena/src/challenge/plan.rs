//! Challenge file and data folder compared.

use crate::{
    Failure,
    challenge::{
        ChallengeFile, Fault, KeyPath, PhaseFile, SplitSource, actor,
        file::{KEPT, SPHERE, Sensor, unix_ms},
        notes,
    },
    data::{DataFolder, check_name},
    dataset::SplitFolder,
    now_unix_ms,
    phases::commit,
    setup::{self, check_seed, check_sounds, rules_for_phase, sounds_for_phase},
};
use avln_episode::{HeadRule, Order, Rules, Sensors, Sounds};
use avln_store::{AuditNote, Phase, PhaseEpisode, Sampling, Schedule, Store, Visibility};
use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

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
    /// New or changed phases.
    phases: Vec<Phase>,
    /// Audit entries for the differences.
    pub notes: Vec<AuditNote>,
    /// Phases missing in the file; they stay unchanged.
    pub left_out: Vec<String>,
}

/// Planning errors.
#[derive(Debug)]
pub enum PlanError {
    /// A fault in the file.
    File(Fault),
    /// Any other failure.
    Other(Failure),
}

impl From<Fault> for PlanError {
    fn from(fault: Fault) -> Self {
        Self::File(fault)
    }
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
        let splits = self.splits(file)?;
        refuse_repeated(file)?;
        let positions = positions(file, &before);
        let mut plan = ChallengeChanges::default();
        for (index, (entry, position)) in file.phases.iter().zip(positions).enumerate() {
            let old = before.iter().find(|phase| phase.id == entry.id);
            let conversion = PhaseConversion { planner: self, index: &index.to_string(), entry };
            let phase = Phase { position, ..conversion.phase(&splits, old)? };
            let differs = notes(&actor(), old, &phase, self.reason);
            if !differs.is_empty() {
                self.refuse_fixed(&conversion, old, &phase).await?;
                plan.phases.push(phase);
            }
            plan.notes.extend(differs);
        }
        let named = |id: &str| file.phases.iter().any(|entry| entry.id == id);
        plan.left_out = before.into_iter().map(|phase| phase.id).filter(|id| !named(id)).collect();
        let known = self.store.split_names().await?;
        plan.splits = file.splits.clone().into_iter().filter(|(name, _)| !known.contains(name)).collect();
        let taken_in = |(name, source): &(String, SplitSource)| AuditNote {
            actor: actor(),
            subject: format!("split {name}"),
            what: "taken in".to_owned(),
            after: Some(source.split.clone()),
            reason: self.reason.to_owned(),
            ..AuditNote::default()
        };
        plan.notes.extend(plan.splits.iter().map(taken_in));
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
        self.store.change_phases(&plan.phases, &plan.notes, now_unix_ms()).await?;
        for phase in &plan.phases {
            commit(self.store, &phase.id).await?;
        }
        Ok(())
    }

    fn splits(&self, file: &ChallengeFile) -> Result<BTreeMap<String, SplitFolder>, Fault> {
        let mut open = BTreeMap::new();
        for (name, SplitSource { dataset, split }) in &file.splits {
            let path = KeyPath { path: &["splits", name] };
            check_name("split", name).map_err(|failure| path.fault(one_line(&failure)))?;
            let folder = SplitFolder::open(&self.base.join(dataset), split);
            open.insert(name.clone(), folder.map_err(|failure| path.fault(one_line(&failure)))?);
        }
        Ok(open)
    }

    /// Rejects changes to settings fixed by existing runs.
    async fn refuse_fixed(
        &self,
        conversion: &PhaseConversion<'_>,
        old: Option<&Phase>,
        new: &Phase,
    ) -> Result<(), PlanError> {
        let Some(old) = old else { return Ok(()) };
        let key = if old.split != new.split || old.episodes != new.episodes {
            "split"
        } else if old.rules != new.rules {
            "rules"
        } else if old.sampling != new.sampling {
            "sample"
        } else {
            return Ok(());
        };
        if self.store.has_runs(&old.id).await? {
            let problem = "existing runs fix split, rules, feedback, silence, sounds, head, sample and shuffle; open another phase";
            return Err(conversion.fault(key, problem).into());
        }
        Ok(())
    }
}

struct PhaseConversion<'a> {
    planner: &'a Planner<'a>,
    /// Index in the file, from 0.
    index: &'a str,
    entry: &'a PhaseFile,
}

impl PhaseConversion<'_> {
    fn fault(&self, key: &str, problem: impl std::fmt::Display) -> Fault {
        let mut path = vec!["phases", self.index];
        path.extend(key.split('.'));
        KeyPath { path: &path }.fault(problem)
    }

    /// Returns the phase. Pause and closing by hand come from the previous version.
    fn phase(&self, splits: &BTreeMap<String, SplitFolder>, old: Option<&Phase>) -> Result<Phase, PlanError> {
        let entry = self.entry;
        check_name("phase", &entry.id).map_err(|failure| self.fault("id", one_line(&failure)))?;
        self.check_texts()?;
        let kept;
        let split = match splits.get(&entry.split) {
            Some(split) => split,
            None => {
                let found = self.planner.data.missions(&entry.split);
                kept = found.map_err(|failure| self.fault("split", one_line(&failure)))?;
                &kept
            }
        };
        let rules = self.rules(split)?;
        let episodes = setup::phase_episodes(split)?;
        if episodes.is_empty() {
            return Err(self.fault("split", format!("split '{}' has no episodes", entry.split)).into());
        }
        let side = self.within("max_side", entry.max_side.unwrap_or(512), 64, 1024)?;
        let phase = Phase {
            title: entry.title.clone().unwrap_or_else(|| entry.id.clone()),
            description: entry.description.clone(),
            orders: self.orders()?,
            sensors: self.sensors(side)?,
            scores: entry.scores,
            replays: entry.replays,
            max_slots: self.within("max_slots", entry.max_slots.unwrap_or(16), 1, 64)?,
            schedule: self.schedule(old)?,
            quotas: self.quotas()?,
            time: self.time()?,
            ranking: entry.ranking,
            admission: self.admission()?,
            sampling: self.sampling(&episodes)?,
            sealed: entry.sealed,
            ..Phase::new(&entry.id, &entry.split, rules, episodes)
        };
        let visibility = |phase: &Phase| (phase.split.clone(), phase.scores, phase.replays);
        // An open phase from before this rule can still get other dates.
        if old.map(visibility) != Some(visibility(&phase)) {
            check_seed(split, phase.scores, phase.replays)
                .map_err(|failure| self.fault("split", one_line(&failure)))?;
        }
        check_sounds(self.planner.data, &phase)
            .map_err(|failure| self.fault("sounds", one_line(&failure)))?;
        Ok(phase)
    }

    fn within(&self, key: &str, value: u32, least: u32, most: u32) -> Result<u32, Fault> {
        if (least..=most).contains(&value) {
            return Ok(value);
        }
        Err(self.fault(key, format!("{value} is outside of {least} to {most}")))
    }

    fn check_texts(&self) -> Result<(), Fault> {
        let title = self.entry.title.as_deref().unwrap_or("x");
        let description = self.entry.description.as_str();
        for (key, text, least, most) in [("title", title, 1, 200), ("description", description, 0, 2000)] {
            let length = text.chars().count();
            let printable = text.chars().all(|letter| !letter.is_control() || letter == '\n');
            if !(least..=most).contains(&length) || !printable {
                return Err(self.fault(key, format!("use {least} to {most} printable characters")));
            }
        }
        Ok(())
    }

    fn rules(&self, split: &SplitFolder) -> Result<Rules, PlanError> {
        let of_split = setup::rules_of(&self.entry.split, split)?;
        let played = rules_for_phase(of_split, self.entry.rules.as_deref());
        let mut rules = played.map_err(|failure| self.fault("rules", one_line(&failure)))?;
        rules.sounds = self.sounds(split)?;
        rules.head = self.head()?;
        rules.feedback = self.entry.feedback.unwrap_or(rules.feedback);
        rules.silence = self.entry.silence.unwrap_or(rules.silence);
        Ok(rules)
    }

    fn sounds(&self, split: &SplitFolder) -> Result<Sounds, Fault> {
        let word = self.entry.sounds.as_deref();
        let data = self.planner.data;
        let found = match word {
            None | Some("all" | "train" | "validation" | "test") => sounds_for_phase(data, word, split),
            Some(word) => match word.strip_prefix(KEPT) {
                Some(digest) => {
                    data.bank(&Sounds::Own(digest.to_owned())).map(|_| Sounds::Own(digest.to_owned()))
                }
                None => data.sounds().import(&self.planner.base.join(word)).map(Sounds::Own),
            },
        };
        found.map_err(|failure| self.fault("sounds", one_line(&failure)))
    }

    fn head(&self) -> Result<HeadRule, Fault> {
        let heads = self.planner.data.heads();
        let found = match self.entry.head.as_deref() {
            None | Some(SPHERE) => return Ok(HeadRule::Sphere),
            Some(word) => match word.strip_prefix(KEPT) {
                Some(digest) => heads.head(digest).map(|_| digest.to_owned()),
                None => heads.import(&self.planner.base.join(word)),
            },
        };
        found.map(HeadRule::Measured).map_err(|failure| self.fault("head", one_line(&failure)))
    }

    fn orders(&self) -> Result<Vec<Order>, Fault> {
        let orders = self.entry.orders.clone().unwrap_or_else(|| vec![Order::Ordered, Order::Unordered]);
        let different: BTreeSet<_> = orders.iter().map(|order| order.as_str()).collect();
        if orders.is_empty() || different.len() != orders.len() {
            return Err(self.fault("orders", "list one or both orders, without repetition"));
        }
        Ok(orders)
    }

    fn sensors(&self, side: u32) -> Result<Sensors, Fault> {
        let all = vec![Sensor::Rgb, Sensor::Depth, Sensor::Audio];
        let wanted = self.entry.sensors.clone().unwrap_or(all);
        if wanted.is_empty() {
            return Err(self.fault("sensors", "list at least one sensor"));
        }
        let has = |sensor| wanted.contains(&sensor);
        let (rgb, depth, audio) = (has(Sensor::Rgb), has(Sensor::Depth), has(Sensor::Audio));
        let encodings = self.entry.encodings;
        Ok(Sensors { rgb, depth, audio, encodings, ..Sensors::all(side, side) })
    }

    fn schedule(&self, old: Option<&Phase>) -> Result<Schedule, Fault> {
        let moment = |key, written| unix_ms(written, KeyPath { path: &["phases", self.index, key] });
        let opens = moment("opens", self.entry.opens.as_ref())?;
        let closes = moment("closes", self.entry.closes.as_ref())?;
        if let (Some(opens), Some(closes)) = (opens, closes)
            && opens >= closes
        {
            return Err(self.fault("closes", "the phase would close before it opens"));
        }
        let by_hand = old.map(|old| old.schedule.clone()).unwrap_or_default();
        Ok(Schedule { opens_unix_ms: opens, closes_unix_ms: closes, ..by_hand })
    }

    fn quotas(&self) -> Result<avln_store::QuotaLimits, Fault> {
        let quota = self.entry.quota;
        let limits = [
            ("quota.day", quota.day),
            ("quota.month", quota.month),
            ("quota.total", quota.total),
            ("quota.concurrent", quota.concurrent),
            ("quota.uncharged", quota.uncharged),
        ];
        match limits.into_iter().find(|(_, limit)| *limit == Some(0)) {
            Some((key, _)) => Err(self.fault(key, "0 permits no run; omit the key for any number of runs")),
            None => Ok(quota),
        }
    }

    fn time(&self) -> Result<avln_episode::TimeLimits, Fault> {
        let time = self.entry.time;
        if time.disconnect_s > time.disconnect_total_s {
            let problem = "a single disconnection cannot last longer than all in total (disconnect_total_s)";
            return Err(self.fault("time.disconnect_s", problem));
        }
        Ok(time)
    }

    fn admission(&self) -> Result<avln_store::Admission, Fault> {
        let teams = &self.entry.teams;
        for (key, names) in [("teams.allow", &teams.allow), ("teams.deny", &teams.deny)] {
            if names.iter().any(|name| name.trim().is_empty()) {
                return Err(self.fault(key, "a team name is empty"));
            }
        }
        match teams.allow.iter().find(|name| teams.deny.contains(name)) {
            Some(both) => Err(self.fault("teams.deny", format!("team '{both}' is both allowed and denied"))),
            None => Ok(teams.clone()),
        }
    }

    fn sampling(&self, pool: &[PhaseEpisode]) -> Result<Sampling, Fault> {
        let shuffle = self.entry.shuffle.unwrap_or(self.entry.replays != Visibility::Public);
        if let Some(sample) = self.entry.sample {
            let most = pool.len() as u32;
            self.within("sample.episodes", sample.episodes, 1, most)?;
            self.within("sample.anchors", sample.anchors, 0, sample.episodes)?;
        }
        Ok(Sampling { shuffle, sample: self.entry.sample })
    }
}

fn refuse_repeated(file: &ChallengeFile) -> Result<(), Fault> {
    let mut seen = BTreeSet::new();
    for (index, entry) in file.phases.iter().enumerate() {
        if !seen.insert(&entry.id) {
            let path = KeyPath { path: &["phases", &index.to_string(), "id"] };
            return Err(path.fault(format!("'{}' is already the id of another phase", entry.id)));
        }
    }
    Ok(())
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

fn one_line(failure: &Failure) -> String {
    failure.to_string().replace('\n', "; ")
}
