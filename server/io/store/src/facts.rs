//! Stored episode facts, their binary format, and pruning.

use crate::{
    accounts::{AuditNote, add_notes},
    database::{Store, Transaction},
    error::{Result, StoreError},
};
use avln_episode::{Action, Point3, Pose};
use avln_scoring::Metrics;
use avln_truth::{EpisodeTruth, Record, StepFacts, SubmitFacts};
use sqlx::types::Json;

/// An episode's ground truth and facts: the input for scoring.
#[derive(Clone, Debug, PartialEq)]
pub struct Facts {
    /// Ground truth.
    pub truth: EpisodeTruth,
    /// Facts.
    pub record: Record,
}

/// An episode with a score.
#[derive(Clone, Debug, PartialEq)]
pub struct ScoredEpisode {
    /// Index in the run, from 0.
    pub ordinal: u32,
    /// Metrics computed when it was played.
    pub metrics: Metrics,
    /// Facts; `None` if they were pruned.
    pub facts: Option<Facts>,
}

/// Deleted rows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pruned {
    /// Episode records.
    pub records: u64,
    /// Truths without a record.
    pub truths: u64,
}

impl Store {
    /// Returns an episode's facts; `None` if it has none.
    pub async fn facts(&self, run: &str, ordinal: u32) -> Result<Option<Facts>> {
        let mut tx = self.read.begin().await?;
        read_facts(&mut tx, run, ordinal).await
    }

    /// Returns the scored episodes of a run in playing order.
    pub async fn scored_episodes(&self, run: &str) -> Result<Vec<ScoredEpisode>> {
        let mut tx = self.read.begin().await?;
        let select =
            "SELECT ordinal, metrics FROM episodes WHERE run = $1 AND metrics IS NOT NULL ORDER BY ordinal";
        let rows: Vec<(u32, Json<Metrics>)> = sqlx::query_as(select).bind(run).fetch_all(&mut *tx).await?;
        let mut episodes = Vec::with_capacity(rows.len());
        for (ordinal, Json(metrics)) in rows {
            let facts = read_facts(&mut tx, run, ordinal).await?;
            episodes.push(ScoredEpisode { ordinal, metrics, facts });
        }
        Ok(episodes)
    }

    /// Returns the runs that ended before `moment_unix_ms`, by id.
    pub async fn runs_ended_before(&self, moment_unix_ms: i64) -> Result<Vec<String>> {
        let select =
            "SELECT id FROM runs WHERE state NOT IN ('created', 'running') AND finished_ms < $1 ORDER BY id";
        Ok(sqlx::query_scalar(select).bind(moment_unix_ms).fetch_all(&self.read).await?)
    }

    /// Counts records that [`Store::prune_records`] would delete.
    pub async fn old_records(&self, moment_unix_ms: i64) -> Result<u64> {
        let select = "SELECT COUNT(*) FROM records WHERE run IN \
                      (SELECT id FROM runs WHERE state NOT IN ('created', 'running') AND finished_ms < $1)";
        let records: i64 = sqlx::query_scalar(select).bind(moment_unix_ms).fetch_one(&self.read).await?;
        Ok(records.unsigned_abs())
    }

    /// Deletes the records of runs that ended before `moment_unix_ms`. Scores stay; replays and rescoring become impossible.
    pub async fn prune_records(
        &self,
        moment_unix_ms: i64,
        note: AuditNote,
        now_unix_ms: i64,
    ) -> Result<Pruned> {
        let mut tx = self.begin().await?;
        let old = "DELETE FROM records WHERE run IN \
                   (SELECT id FROM runs WHERE state NOT IN ('created', 'running') AND finished_ms < $1)";
        let records = sqlx::query(old).bind(moment_unix_ms).execute(&mut *tx).await?.rows_affected();
        // Truths are shared between runs, so a truth goes with its last record.
        let unused = "DELETE FROM truths WHERE digest NOT IN (SELECT truth FROM records)";
        let truths = sqlx::query(unused).execute(&mut *tx).await?.rows_affected();
        if records > 0 {
            add_notes(&mut tx, &[note], now_unix_ms).await?;
        }
        tx.commit().await?;
        Ok(Pruned { records, truths })
    }
}

pub(crate) async fn read_facts(tx: &mut Transaction<'_>, run: &str, ordinal: u32) -> Result<Option<Facts>> {
    let select = "SELECT t.body, r.body FROM records r JOIN truths t ON t.digest = r.truth \
                  WHERE r.run = $1 AND r.ordinal = $2";
    let row: Option<(Vec<u8>, Vec<u8>)> =
        sqlx::query_as(select).bind(run).bind(ordinal).fetch_optional(&mut **tx).await?;
    let Some((truth, record)) = row else { return Ok(None) };
    let truth = serde_json::from_slice(&truth).map_err(|error| StoreError::damaged("truth", error))?;
    Ok(Some(Facts { truth, record: unpack(&record)? }))
}

/// The newest version of the record format.
const VERSION: u8 = 2;
/// The version without wrong-instance goals, still read.
const WITHOUT_WRONG_INSTANCES: u8 = 1;
const NONE: u8 = 255;
const COLLIDED: u8 = 0x80;

/// Binary record format: exact to the last bit, and 28 bytes a step instead of 250 in JSON.
///
/// Little-endian. Version 1: `u8` version; rules name as `u16` length and UTF-8; start pose (x, y, z, heading as
/// `f32`); end reason word, as the rules; `u8` count and one `u8` per goal for the regions at the start; `u8` count and
/// (`u8` present, `f64`) per goal for the final distances; `u32` step count, per step `u8` action with bit 7 for a collision, `u8`
/// regions, `u8` sounding goal or 255, pose, `u64` state hash; `u32` submit count, per submit `u32` step, `u8` completed goal or
/// 255, `u8` skipped goal or 255. Version 2 adds `u8` wrong-instance goal or 255 to every submit.
pub(crate) fn pack(record: &Record) -> Vec<u8> {
    let mut out = Vec::with_capacity(64 + record.steps.len() * 28 + record.submits.len() * 7);
    out.push(VERSION);
    pack_text(&mut out, &record.rules);
    pack_pose(&mut out, &record.start);
    pack_text(&mut out, record.end.as_str());
    pack_goals(&mut out, record);
    out.extend((record.steps.len() as u32).to_le_bytes());
    record.steps.iter().for_each(|step| pack_step(&mut out, step));
    out.extend((record.submits.len() as u32).to_le_bytes());
    for submit in &record.submits {
        out.extend(submit.step.to_le_bytes());
        let goals = [submit.completed, submit.skipped, submit.wrong_instance];
        out.extend(goals.map(|goal| goal.unwrap_or(NONE)));
    }
    out
}

/// Packs a name, cut to 65 535 bytes.
fn pack_text(out: &mut Vec<u8>, text: &str) {
    let bytes = &text.as_bytes()[..text.floor_char_boundary(usize::from(u16::MAX))];
    out.extend((bytes.len() as u16).to_le_bytes());
    out.extend(bytes);
}

fn pack_goals(out: &mut Vec<u8>, record: &Record) {
    out.push(record.in_region_at_start.len() as u8);
    out.extend(record.in_region_at_start.iter().map(|&inside| u8::from(inside)));
    out.push(record.final_distance_m.len() as u8);
    for distance in &record.final_distance_m {
        out.push(u8::from(distance.is_some()));
        out.extend(distance.unwrap_or(0.0).to_le_bytes());
    }
}

fn pack_step(out: &mut Vec<u8>, step: &StepFacts) {
    let collided = if step.collided { COLLIDED } else { 0 };
    out.extend([step.action.index() | collided, step.in_region, step.sounding.unwrap_or(NONE)]);
    pack_pose(out, &step.pose);
    out.extend(step.state_hash.to_le_bytes());
}

fn pack_pose(out: &mut Vec<u8>, pose: &Pose) {
    for value in [pose.position.x, pose.position.y, pose.position.z, pose.heading_rad] {
        out.extend(value.to_le_bytes());
    }
}

fn unpack(bytes: &[u8]) -> Result<Record> {
    let mut from = Unpack { bytes };
    let record = from.record();
    record
        .filter(|_| from.bytes.is_empty())
        .ok_or_else(|| StoreError::damaged("record", "its length or a value is invalid"))
}

struct Unpack<'a> {
    bytes: &'a [u8],
}

impl Unpack<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, rest) = self.bytes.split_first_chunk::<N>()?;
        self.bytes = rest;
        Some(*head)
    }

    fn byte(&mut self) -> Option<u8> {
        self.take().map(|[byte]| byte)
    }

    /// Reads a byte with `NONE` for a missing value. The outer option is `None` past the last byte.
    fn optional(&mut self) -> Option<Option<u8>> {
        self.byte().map(|byte| (byte != NONE).then_some(byte))
    }

    fn count(&mut self) -> Option<u32> {
        self.take().map(u32::from_le_bytes)
    }

    fn record(&mut self) -> Option<Record> {
        let version = self.byte()?;
        if ![WITHOUT_WRONG_INSTANCES, VERSION].contains(&version) {
            return None;
        }
        let rules = self.text()?;
        let start = self.pose()?;
        let end = self.text()?.parse().ok()?;
        let in_region_at_start = (0..self.byte()?).map(|_| Some(self.byte()? != 0)).collect::<Option<_>>()?;
        let final_distance_m = (0..self.byte()?).map(|_| self.distance()).collect::<Option<_>>()?;
        // A damaged count must not allocate: collecting stops after the last byte.
        let steps = (0..self.count()?).map(|_| self.step()).collect::<Option<_>>()?;
        let submits = (0..self.count()?).map(|_| self.submit(version)).collect::<Option<_>>()?;
        Some(Record { rules, start, steps, submits, in_region_at_start, final_distance_m, end })
    }

    fn text(&mut self) -> Option<String> {
        let length = usize::from(u16::from_le_bytes(self.take()?));
        let (text, rest) = self.bytes.split_at_checked(length)?;
        self.bytes = rest;
        String::from_utf8(text.to_vec()).ok()
    }

    fn distance(&mut self) -> Option<Option<f64>> {
        let present = self.byte()? != 0;
        let distance = f64::from_le_bytes(self.take()?);
        Some(present.then_some(distance))
    }

    fn pose(&mut self) -> Option<Pose> {
        let mut value = || self.take().map(f32::from_le_bytes);
        // Built field by field: `Pose::new` would wrap the heading and change its bits.
        Some(Pose { position: Point3::new(value()?, value()?, value()?), heading_rad: value()? })
    }

    fn step(&mut self) -> Option<StepFacts> {
        let byte = self.byte()?;
        Some(StepFacts {
            action: Action::try_from(u32::from(byte & !COLLIDED)).ok()?,
            collided: byte & COLLIDED != 0,
            in_region: self.byte()?,
            sounding: self.optional()?,
            pose: self.pose()?,
            state_hash: u64::from_le_bytes(self.take()?),
        })
    }

    fn submit(&mut self, version: u8) -> Option<SubmitFacts> {
        Some(SubmitFacts {
            step: self.count()?,
            completed: self.optional()?,
            skipped: self.optional()?,
            wrong_instance: if version == VERSION { self.optional()? } else { None },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_episode::EndReason;

    fn sample() -> Record {
        let pose = |x: f32| Pose { position: Point3::new(x, 0.1, -3.7), heading_rad: -1.000_000_1 };
        let step = |index: u32| StepFacts {
            action: Action::ALL[index as usize % 5],
            pose: pose(index as f32 * 0.1),
            collided: index.is_multiple_of(3),
            in_region: index as u8,
            sounding: index.is_multiple_of(2).then_some(3),
            state_hash: u64::MAX - u64::from(index),
        };
        Record {
            rules: "lh-avln-v1".to_owned(),
            start: pose(0.0),
            steps: (0..7).map(step).collect(),
            submits: vec![
                SubmitFacts { step: 4, completed: Some(1), skipped: None, wrong_instance: None },
                SubmitFacts { step: 5, completed: None, skipped: Some(0), wrong_instance: Some(1) },
            ],
            in_region_at_start: vec![true, false],
            final_distance_m: vec![Some(0.1 + 0.2), None],
            end: EndReason::Disconnected,
        }
    }

    #[test]
    fn records_survive_bit_for_bit() {
        let record = sample();
        assert_eq!(unpack(&pack(&record)).expect("packed bytes"), record);
    }

    #[test]
    fn first_version_has_no_wrong_instance() {
        let one_submit =
            |wrong_instance| vec![SubmitFacts { step: 4, completed: None, skipped: None, wrong_instance }];
        let mut bytes = pack(&Record { submits: one_submit(Some(1)), ..sample() });
        bytes.pop();
        bytes[0] = WITHOUT_WRONG_INSTANCES;
        let expected = Record { submits: one_submit(None), ..sample() };
        assert_eq!(unpack(&bytes).expect("the layout of the first version"), expected);
    }

    #[test]
    fn wrong_lengths_are_rejected() {
        let bytes = pack(&sample());
        for length in 0..bytes.len() {
            assert!(unpack(&bytes[..length]).is_err(), "cut to {length} bytes");
        }
        assert!(unpack(&[bytes, vec![0]].concat()).is_err());
    }

    #[test]
    fn huge_count_without_content_is_rejected() {
        let mut bytes = pack(&Record { steps: vec![], submits: vec![], ..sample() });
        let steps_at = bytes.len() - 8;
        bytes[steps_at..steps_at + 4].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(unpack(&bytes).is_err());
    }
}
