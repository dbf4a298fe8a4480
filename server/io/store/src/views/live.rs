use super::{
    Reader, Viewer,
    run::{RunLine, Sight, find_run, line},
};
use crate::{
    Run, RunState, StoreError,
    phases::read_heads,
    runs::{RunFilter, read_runs},
    words::count,
};
use serde::Serialize;
use sqlx::{Sqlite, Transaction};

/// A run under way.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LiveRun {
    /// The run.
    pub line: RunLine,
    /// Episodes that are being played.
    pub playing: u32,
    /// Whether the viewer may see how far single episodes are: their lengths tell where targets are.
    pub steps_visible: bool,
}

impl Reader {
    /// How far the run called `id` is; `None` when there is none that the viewer may know of.
    ///
    /// # Errors
    /// When the database fails or holds damaged rows.
    pub async fn live_run(&self, viewer: &Viewer, id: &str) -> Result<Option<LiveRun>, StoreError> {
        let mut tx = self.snapshot().await?;
        match find_run(&mut tx, viewer, id).await? {
            Some((run, sight)) => live(&mut tx, run, sight).await.map(Some),
            None => Ok(None),
        }
    }

    /// The runs under way that the viewer may know of, the newest first, `limit` at most.
    ///
    /// # Errors
    /// When the database fails or holds damaged rows.
    pub async fn live_runs(&self, viewer: &Viewer, limit: u32) -> Result<Vec<LiveRun>, StoreError> {
        let mut tx = self.snapshot().await?;
        let phases = read_heads(&mut tx, None).await?;
        let mut runs = Vec::new();
        for state in [RunState::Running, RunState::Created] {
            runs.extend(read_runs(&mut tx, &RunFilter { state: Some(state), ..RunFilter::default() }).await?);
        }
        runs.sort_by(|a, b| b.created_unix_ms.cmp(&a.created_unix_ms).then_with(|| a.id.cmp(&b.id)));
        let mut found = Vec::new();
        for run in runs {
            let head = phases.iter().find(|head| head.phase.id == run.phase);
            if let Some(sight) = head.and_then(|head| Sight::of(viewer, &run.team, &head.phase)) {
                found.push(live(&mut tx, run, sight).await?);
            }
            if found.len() >= limit as usize {
                break;
            }
        }
        Ok(found)
    }
}

async fn live(tx: &mut Transaction<'_, Sqlite>, run: Run, sight: Sight) -> Result<LiveRun, StoreError> {
    let select = "SELECT COUNT(*) FROM episodes WHERE run = $1 AND state = 'running'";
    let playing: i64 = sqlx::query_scalar(select).bind(&run.id).fetch_one(&mut **tx).await?;
    Ok(LiveRun { playing: count(playing), steps_visible: sight.replays, line: line(tx, run, sight).await? })
}
