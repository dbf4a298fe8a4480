use crate::{Store, StoreError, packed};
use avln_truth::{EpisodeTruth, Record};
use sqlx::{Sqlite, Transaction};

/// The hidden side and the facts of a played episode: all that scoring it again needs.
#[derive(Clone, Debug, PartialEq)]
pub struct Facts {
    /// What was hidden.
    pub truth: EpisodeTruth,
    /// What happened.
    pub record: Record,
}

impl Store {
    /// The facts of the episode at place `ordinal` of a run; `None` while it has none.
    ///
    /// # Errors
    /// When the stored bytes are damaged or the database fails.
    pub async fn facts(&self, run: &str, ordinal: u32) -> Result<Option<Facts>, StoreError> {
        let mut tx = self.read.begin().await?;
        read_facts(&mut tx, run, ordinal).await
    }
}

pub(crate) async fn read_facts(
    tx: &mut Transaction<'_, Sqlite>,
    run: &str,
    ordinal: u32,
) -> Result<Option<Facts>, StoreError> {
    let select = "SELECT t.body, r.body FROM records r JOIN truths t ON t.digest = r.truth \
                  WHERE r.run = $1 AND r.ordinal = $2";
    let row: Option<(Vec<u8>, Vec<u8>)> =
        sqlx::query_as(select).bind(run).bind(ordinal).fetch_optional(&mut **tx).await?;
    let Some((truth, record)) = row else { return Ok(None) };
    let truth = serde_json::from_slice(&truth).map_err(|error| StoreError::damaged("truth", error))?;
    Ok(Some(Facts { truth, record: packed::unpack(&record)? }))
}
