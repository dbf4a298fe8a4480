use super::Reader;
use crate::StoreError;

/// How many runs and episodes there are. Names nobody.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Census {
    /// Runs by the word of their state.
    pub runs: Vec<(String, i64)>,
    /// Episodes by the words of their state and end reason.
    pub episodes: Vec<(String, Option<String>, i64)>,
}

impl Reader {
    /// How many runs and episodes there are in each state.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn census(&self) -> Result<Census, StoreError> {
        let mut tx = self.snapshot().await?;
        let runs = sqlx::query_as("SELECT state, COUNT(*) FROM runs GROUP BY state ORDER BY state");
        let episodes = sqlx::query_as(
            "SELECT state, end_reason, COUNT(*) FROM episodes GROUP BY state, end_reason ORDER BY state, end_reason",
        );
        Ok(Census { runs: runs.fetch_all(&mut *tx).await?, episodes: episodes.fetch_all(&mut *tx).await? })
    }
}
