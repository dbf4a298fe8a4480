//! Resource limits per session.

use crate::Arena;
use avln_episode::Sensors;
use avln_grpc::{Reason, Refusal};
use avln_referee::Referee;
use avln_world::SceneAssets;
use std::{sync::Arc, time::Duration};

/// Default memory for a session's open episodes, MiB: sixteen scans, or a hundred houses.
pub const SESSION_MEMORY_MIB: u32 = 4096;

/// Bytes per pixel for colour, depth and instance in rendering, observation, encoding and queue.
const BYTES_PER_PIXEL: usize = 40;

/// Session limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// Memory for open episodes, MiB: scenes (counted once), sound sources, ears and frames.
    pub session_memory_mib: u32,
    /// Longest episode preparation; longer ones count as hanging.
    pub preparation: Duration,
}

impl Default for Budget {
    fn default() -> Self {
        Self { session_memory_mib: SESSION_MEMORY_MIB, preparation: Duration::from_secs(600) }
    }
}

impl Budget {
    pub(crate) fn session_bytes(&self) -> usize {
        (self.session_memory_mib as usize).saturating_mul(1 << 20)
    }

    fn check(&self, bytes: usize) -> Result<(), Refusal> {
        if bytes <= self.session_bytes() {
            return Ok(());
        }
        let (mib, limit) = (bytes.div_ceil(1 << 20), self.session_memory_mib);
        let message = format!(
            "the session would use {mib} MiB, but {limit} MiB are allowed; the organiser can raise the limit with avln serve --session-memory"
        );
        Err(Refusal::new(Reason::SimFault, message))
    }

    pub(crate) fn check_file(&self, bytes: u64) -> Result<(), Refusal> {
        self.check(usize::try_from(bytes).unwrap_or(usize::MAX))
    }
}

#[derive(Clone)]
pub(crate) struct MemoryUse {
    pub(crate) scene: Arc<SceneAssets>,
    /// Bytes without the scene: ears and frames.
    pub(crate) own_bytes: usize,
}

impl MemoryUse {
    pub(crate) fn of(scene: Arc<SceneAssets>, referee: &Referee) -> Self {
        let own_bytes = referee.most_bytes() + frame_bytes(referee.sensors());
        Self { scene, own_bytes }
    }
}

impl Arena {
    /// Rejects an episode beyond the session memory.
    pub(crate) fn check_memory(&self, run: &str, new: &MemoryUse) -> Result<(), Refusal> {
        let uses = self.open_episodes().memory_of(run).cloned().chain([new.clone()]).collect();
        // Without the lock: measuring scenes takes time.
        self.budget.check(bytes_of(uses))
    }
}

/// Adds up the bytes; shared scenes count once.
fn bytes_of(mut uses: Vec<MemoryUse>) -> usize {
    let own: usize = uses.iter().map(|memory| memory.own_bytes).sum();
    uses.sort_by_key(|memory| Arc::as_ptr(&memory.scene));
    uses.dedup_by_key(|memory| Arc::as_ptr(&memory.scene));
    own + uses.iter().map(|memory| memory.scene.resident_bytes()).sum::<usize>()
}

fn frame_bytes(sensors: &Sensors) -> usize {
    let sees = sensors.rgb || sensors.depth;
    if sees { sensors.width as usize * sensors.height as usize * BYTES_PER_PIXEL } else { 0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_houses::{HouseOptions, house};
    use avln_world::Body;

    fn scene(seed: u64) -> Arc<SceneAssets> {
        let house = house("house", seed, &HouseOptions { rooms: 6..=6, ..HouseOptions::default() });
        Arc::new(SceneAssets::prepare(house, &Body::default()).expect("a house to walk in"))
    }

    #[test]
    fn shared_scenes_count_once() {
        let (a, b) = (scene(1), scene(2));
        let memory = |scene: &Arc<SceneAssets>| MemoryUse { scene: scene.clone(), own_bytes: 1000 };
        let one = bytes_of(vec![memory(&a)]);
        assert_eq!(one, a.resident_bytes() + 1000);
        assert!(a.resident_bytes() > 100_000, "a house is not nothing: {}", a.resident_bytes());
        assert_eq!(bytes_of(vec![memory(&a), memory(&b), memory(&a)]), one + b.resident_bytes() + 2000);
        assert_eq!(frame_bytes(&Sensors::all(256, 256)), 2_621_440);
    }

    #[test]
    fn refusals_name_size_limit_and_option() {
        let budget = Budget { session_memory_mib: 2, ..Budget::default() };
        assert_eq!(budget.check(2 << 20), Ok(()));
        let refused = budget.check((2 << 20) + 1).unwrap_err();
        assert_eq!(refused.reason, Reason::SimFault, "the server's fault, so that the episode is free");
        for part in ["3 MiB", "2 MiB", "--session-memory"] {
            assert!(refused.message.contains(part), "{refused}");
        }
    }
}
