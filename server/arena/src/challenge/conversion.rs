//! Phase of a challenge file, converted.

use super::{
    Fault, PhaseFile,
    file::{KEPT, SOUND_SHARES, SPHERE, Sensor, unix_ms},
    one_line,
};
use crate::{
    Failure,
    data::{DataFolder, check_name},
    dataset::SplitFolder,
    now_unix_ms,
    setup::{self, check_sounds, rules_for_phase, sounds_for_phase},
};
use avln_episode::{HeadRule, Order, Rules, Sensors, Sounds};
use avln_store::{Phase, PhaseEpisode, PublishedSplits, Sampling, Schedule, Visibility};
use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
    sync::Arc,
};

/// Splits of a file by local name; `None` for a faulty entry.
pub(super) type FileSplits = BTreeMap<String, Option<Arc<SplitFolder>>>;

pub(super) struct PhaseConversion<'a> {
    pub(super) data: &'a DataFolder,
    /// Base folder for relative paths.
    pub(super) base: &'a Path,
    /// Index in the file, from 0.
    pub(super) index: &'a str,
    pub(super) entry: &'a PhaseFile,
    /// The previous version.
    pub(super) old: Option<&'a Phase>,
    /// The previous version, if runs fix a part of it.
    pub(super) fixed: Option<&'a Phase>,
    pub(super) published: &'a PublishedSplits,
}

/// Stores the value, or records its fault.
fn fill<T>(place: &mut T, found: Result<T, Fault>, faults: &mut Vec<Fault>) {
    match found {
        Ok(value) => *place = value,
        Err(fault) => faults.push(fault),
    }
}

impl PhaseConversion<'_> {
    pub(super) fn fault(&self, key: &str, problem: impl std::fmt::Display) -> Fault {
        let mut path = vec!["phases", self.index];
        path.extend(key.split('.'));
        Fault::at_key(&path, problem)
    }

    fn failed(&self, key: &str, failure: &Failure) -> Fault {
        self.fault(key, one_line(failure))
    }

    /// Returns the phase, or all its faults. Pause and closing by hand come from the previous version.
    pub(super) fn phase(&self, splits: &FileSplits) -> Result<Phase, Vec<Fault>> {
        let entry = self.entry;
        let mut faults = Vec::new();
        let mut phase = Phase {
            title: entry.title.clone().unwrap_or_else(|| entry.id.clone()),
            description: entry.description.clone(),
            scores: entry.scores,
            replays: entry.replays,
            quotas: entry.quota,
            time: entry.time,
            ranking: entry.ranking,
            admission: entry.teams.clone(),
            sealed: entry.sealed,
            ..Phase::new(&entry.id, &entry.split, Rules::paper(), Vec::new())
        };
        let named = check_name("phase", &entry.id).map_err(|failure| self.failed("id", &failure));
        let checked = [named, self.check_texts(), self.check_quotas(), self.check_time(), self.check_teams()];
        faults.extend(checked.into_iter().filter_map(Result::err));
        let mut side = 512;
        fill(&mut side, self.within("max_side", entry.max_side.unwrap_or(512), 64, 1024), &mut faults);
        fill(&mut phase.sensors, self.sensors(side), &mut faults);
        fill(
            &mut phase.max_slots,
            self.within("max_slots", entry.max_slots.unwrap_or(16), 1, 64),
            &mut faults,
        );
        fill(&mut phase.orders, self.orders(), &mut faults);
        fill(&mut phase.schedule, self.schedule(), &mut faults);
        match self.split(splits) {
            Ok(Some(split)) => self.fill_from_split(&split, &mut phase, &mut faults),
            Ok(None) => return Err(faults),
            Err(fault) => faults.push(fault),
        }
        if faults.is_empty() { Ok(phase) } else { Err(faults) }
    }

    /// Returns the split; `None` if its entry in the file is faulty.
    fn split(&self, splits: &FileSplits) -> Result<Option<Arc<SplitFolder>>, Fault> {
        if let Some(of_file) = splits.get(&self.entry.split) {
            return Ok(of_file.clone());
        }
        let found = self.data.missions(&self.entry.split);
        found.map(|split| Some(Arc::new(split))).map_err(|failure| self.failed("split", &failure))
    }

    /// Adds the settings that depend on the split.
    fn fill_from_split(&self, split: &SplitFolder, phase: &mut Phase, faults: &mut Vec<Fault>) {
        fill(&mut phase.rules, self.rules(split), faults);
        fill(&mut phase.rules.sounds, self.sounds(split), faults);
        fill(&mut phase.rules.head, self.head(), faults);
        phase.rules.feedback = self.entry.feedback.unwrap_or(phase.rules.feedback);
        phase.rules.silence = self.entry.silence.unwrap_or(phase.rules.silence);
        let PhaseFile { distractor_sources, extra_submit, stop_claims, .. } = self.entry;
        phase.rules.distractor_sources = distractor_sources.unwrap_or(phase.rules.distractor_sources);
        phase.rules.extra_submit = extra_submit.unwrap_or(phase.rules.extra_submit);
        phase.rules.stop_claims = stop_claims.unwrap_or(phase.rules.stop_claims);
        match self.episodes(split) {
            Ok(episodes) => {
                fill(&mut phase.sampling, self.sampling(&episodes), faults);
                phase.episodes = episodes;
            }
            Err(fault) => faults.push(fault),
        }
        faults.extend(self.check_secret(split, phase).err());
        // These compare settings, so they need correct ones.
        if faults.is_empty() {
            let sounds = check_sounds(self.data, phase);
            faults.extend(sounds.err().map(|failure| self.failed("sounds", &failure)));
            let distractors = split.check_distractors(&phase.rules);
            faults.extend(distractors.err().map(|failure| self.failed("rules", &failure)));
            faults.extend(self.changes_of_fixed(phase));
            let published = self.published.check(phase, split.digest(), now_unix_ms());
            faults.extend(published.err().map(|error| self.fault("split", error)));
        }
    }

    fn check_secret(&self, split: &SplitFolder, phase: &Phase) -> Result<(), Fault> {
        let visibility = |phase: &Phase| (phase.split.clone(), phase.scores, phase.replays);
        // An open phase from before this rule can still get other dates.
        if self.old.map(visibility) == Some(visibility(phase)) {
            return Ok(());
        }
        let checked = split.check_seed(phase.scores, phase.replays);
        checked.map_err(|failure| self.failed("split", &failure))
    }

    /// Returns a fault per change of a setting that existing runs fix.
    fn changes_of_fixed(&self, new: &Phase) -> Vec<Fault> {
        const PROBLEM: &str = "existing runs fix split, rules, claims, feedback, silence, sounds, distractors, head, sample and shuffle; open another phase";
        let Some(old) = self.fixed else { return Vec::new() };
        // Rules and sounds may come from the split.
        if old.split != new.split || old.episodes != new.episodes {
            return vec![self.fault("split", PROBLEM)];
        }
        let (is, was) = (&new.rules, &old.rules);
        let (sounds, head) = (was.sounds.clone(), was.head.clone());
        let Rules { feedback, silence, distractor_sources, extra_submit, stop_claims, .. } = *was;
        let claims = Rules { distractor_sources, extra_submit, stop_claims, ..is.clone() };
        let rest = Rules { sounds, head, feedback, silence, ..claims };
        let changes = [
            ("shuffle", new.sampling.shuffle != old.sampling.shuffle),
            ("sample", new.sampling.sample != old.sampling.sample),
            ("sounds", is.sounds != was.sounds),
            ("head", is.head != was.head),
            ("feedback", is.feedback != was.feedback),
            ("silence", is.silence != was.silence),
            ("distractor_sources", is.distractor_sources != was.distractor_sources),
            ("extra_submit", is.extra_submit != was.extra_submit),
            ("stop_claims", is.stop_claims != was.stop_claims),
            ("rules", rest != *was),
        ];
        let changed = changes.into_iter().filter(|(_, is_changed)| *is_changed);
        changed.map(|(key, _)| self.fault(key, PROBLEM)).collect()
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

    fn rules(&self, split: &SplitFolder) -> Result<Rules, Fault> {
        let of_split = setup::rules_of(&self.entry.split, split);
        let of_split = of_split.map_err(|failure| self.failed("split", &failure))?;
        let played = rules_for_phase(of_split, self.entry.rules.as_deref());
        played.map_err(|failure| self.failed("rules", &failure))
    }

    fn episodes(&self, split: &SplitFolder) -> Result<Vec<PhaseEpisode>, Fault> {
        let episodes = setup::phase_episodes(split).map_err(|failure| self.failed("split", &failure))?;
        if episodes.is_empty() {
            return Err(self.fault("split", format!("split '{}' has no episodes", self.entry.split)));
        }
        Ok(episodes)
    }

    fn sounds(&self, split: &SplitFolder) -> Result<Sounds, Fault> {
        let word = self.entry.sounds.as_deref();
        let data = self.data;
        let is_share = |word: &str| SOUND_SHARES.iter().any(|(share, _)| *share == word);
        let found = match word {
            Some(word) if !is_share(word) => match word.strip_prefix(KEPT) {
                Some(digest) => {
                    data.bank(&Sounds::Own(digest.to_owned())).map(|_| Sounds::Own(digest.to_owned()))
                }
                None => data.sounds().import(&self.base.join(word)).map(Sounds::Own),
            },
            share => sounds_for_phase(data, share, split),
        };
        found.map_err(|failure| self.failed("sounds", &failure))
    }

    fn head(&self) -> Result<HeadRule, Fault> {
        let heads = self.data.heads();
        let found = match self.entry.head.as_deref() {
            None | Some(SPHERE) => return Ok(HeadRule::Sphere),
            Some(word) => match word.strip_prefix(KEPT) {
                Some(digest) => heads.head(digest).map(|_| digest.to_owned()),
                None => heads.import(&self.base.join(word)),
            },
        };
        found.map(HeadRule::Measured).map_err(|failure| self.failed("head", &failure))
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

    fn schedule(&self) -> Result<Schedule, Fault> {
        let moment = |key, written| unix_ms(written, &["phases", self.index, key]);
        let opens = moment("opens", self.entry.opens.as_ref())?;
        let closes = moment("closes", self.entry.closes.as_ref())?;
        if let (Some(opens), Some(closes)) = (opens, closes)
            && opens >= closes
        {
            return Err(self.fault("closes", "the phase would close before it opens"));
        }
        let by_hand = self.old.map(|old| old.schedule.clone()).unwrap_or_default();
        Ok(Schedule { opens_unix_ms: opens, closes_unix_ms: closes, ..by_hand })
    }

    fn check_quotas(&self) -> Result<(), Fault> {
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
            None => Ok(()),
        }
    }

    fn check_time(&self) -> Result<(), Fault> {
        let time = self.entry.time;
        if time.disconnect_s > time.disconnect_total_s {
            let problem = "a single disconnection cannot last longer than all in total (disconnect_total_s)";
            return Err(self.fault("time.disconnect_s", problem));
        }
        Ok(())
    }

    fn check_teams(&self) -> Result<(), Fault> {
        let teams = &self.entry.teams;
        for (key, names) in [("teams.allow", &teams.allow), ("teams.deny", &teams.deny)] {
            if names.iter().any(|name| name.trim().is_empty()) {
                return Err(self.fault(key, "a team name is empty"));
            }
        }
        match teams.allow.iter().find(|name| teams.deny.contains(name)) {
            Some(both) => Err(self.fault("teams.deny", format!("team '{both}' is both allowed and denied"))),
            None => Ok(()),
        }
    }

    fn sampling(&self, pool: &[PhaseEpisode]) -> Result<Sampling, Fault> {
        if let Some(sample) = self.entry.sample {
            let most = pool.len() as u32;
            self.within("sample.episodes", sample.episodes, 1, most)?;
            self.within("sample.anchors", sample.anchors, 0, sample.episodes)?;
        }
        let shuffle = self.entry.shuffle.unwrap_or_else(|| self.shuffles());
        Ok(Sampling { shuffle, sample: self.entry.sample })
    }

    /// Returns the default of `shuffle`, which changed visibility must not change for existing runs.
    fn shuffles(&self) -> bool {
        self.fixed.map_or(self.entry.replays != Visibility::Public, |old| old.sampling.shuffle)
    }
}
