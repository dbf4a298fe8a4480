//! Resource limits per session.

use crate::Arena;
use avln_episode::Sensors;
use avln_grpc::{Reason, Refusal};
use avln_referee::Referee;
use avln_world::SceneAssets;
use std::{sync::Arc, time::Duration};

/// Time after which another episode of the run may have ended, seconds.
const RETRY_S: u32 = 10;

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

    /// Rejects a scene beyond the session memory. That is the server's fault: no agent could play in it.
    fn check_scene(&self, bytes: usize) -> Result<(), Refusal> {
        if bytes <= self.session_bytes() {
            return Ok(());
        }
        let (mib, limit) = (bytes.div_ceil(1 << 20), self.session_memory_mib);
        let message = format!(
            "the scene uses {mib} MiB, but a session may use {limit} MiB; the organiser can raise the limit with avln serve --session-memory"
        );
        Err(Refusal::new(Reason::SimFault, message))
    }

    pub(crate) fn check_file(&self, bytes: u64) -> Result<(), Refusal> {
        self.check_scene(usize::try_from(bytes).unwrap_or(usize::MAX))
    }

    /// Rejects an episode that does not fit the session memory beside the run's open episodes, `open`.
    fn check(&self, open: Vec<MemoryUse>, new: MemoryUse) -> Result<(), Refusal> {
        let is_alone = open.is_empty();
        let scene_bytes = new.scene.resident_bytes();
        let uses = open.into_iter().chain([new]).collect();
        if bytes_of(uses) <= self.session_bytes() {
            return Ok(());
        }
        self.check_scene(scene_bytes)?;
        // Agents choose slots and picture size, so the rest is not the server's fault. No message has a size: sizes of scenes are
        // hidden.
        if !is_alone {
            let message = "the run's open episodes use the memory of the session; play the episode when another has ended, with fewer slots, or with smaller pictures";
            return Err(Refusal::new(Reason::NoCapacity, message).retry_after(RETRY_S));
        }
        let message = "pictures and sound of an episode exceed the memory of the session; start a run with smaller pictures or fewer sensors";
        Err(Refusal::new(Reason::SensorNotAllowed, message))
    }

    /// Returns whether the agent caused a refusal, by slots or sensors.
    pub(crate) fn is_agents_choice(refused: &Refusal) -> bool {
        matches!(refused.reason, Reason::NoCapacity | Reason::SensorNotAllowed | Reason::BadRequest)
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
        let open = self.open_episodes().memory_of(run).cloned().collect();
        // Without the lock: measuring scenes takes time.
        self.budget.check(open, new.clone())
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
        assert_eq!(budget.check_file(2 << 20), Ok(()));
        let refused = budget.check_file((2 << 20) + 1).unwrap_err();
        assert_eq!(refused.reason, Reason::SimFault, "the server's fault, so that the episode is free");
        for part in ["3 MiB", "2 MiB", "--session-memory"] {
            assert!(refused.message.contains(part), "{refused}");
        }
    }

    #[test]
    fn agents_answer_for_slots_and_pictures() {
        let scene = scene(1);
        let mib = |bytes: usize| bytes.div_ceil(1 << 20);
        let budget =
            Budget { session_memory_mib: mib(scene.resident_bytes()) as u32 + 10, ..Budget::default() };
        let with = |own_mib: usize| MemoryUse { scene: scene.clone(), own_bytes: own_mib << 20 };
        assert_eq!(budget.check(vec![with(4)], with(4)), Ok(()));
        let reason = |open, new| budget.check(open, new).unwrap_err().reason;
        assert_eq!(reason(vec![with(6)], with(6)), Reason::NoCapacity);
        assert_eq!(reason(vec![], with(12)), Reason::SensorNotAllowed);
        for refused in [budget.check(vec![with(6)], with(6)), budget.check(vec![], with(12))] {
            let refused = refused.unwrap_err();
            assert!(Budget::is_agents_choice(&refused) && !refused.message.contains("MiB"), "{refused}");
        }
        let small = Budget { session_memory_mib: 0, ..Budget::default() };
        let refused = small.check(vec![with(0)], with(0)).unwrap_err();
        assert_eq!(refused.reason, Reason::SimFault);
        assert!(!Budget::is_agents_choice(&refused));
    }
}
