//! Resource limits: memory of a session, and turns of the teams at the preparation of episodes.

use crate::{Arena, Failure, dataset::SplitFolder, lock};
use avln_dataset::SceneSource;
use avln_episode::Sensors;
use avln_grpc::{Reason, Refusal};
use avln_referee::Referee;
use avln_world::SceneAssets;
use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex},
    time::Duration,
};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// Time after which another episode of the run may have ended, seconds.
const RETRY_S: u32 = 10;

/// Default memory for a session's open episodes, MiB: sixteen scans, or sixty-four houses.
pub const SESSION_MEMORY_MIB: u32 = 4096;

/// Bytes per pixel for colour, depth and instance in rendering, observation, encoding and queue.
const BYTES_PER_PIXEL: usize = 40;

/// Bytes charged for a procedural house with its sound sources: more than a house of 24 rooms takes.
const HOUSE_BYTES: usize = 40 << 20;

/// Least bytes charged for a scene file with its sound sources.
const SCAN_BYTES: usize = 160 << 20;

/// Bytes charged per byte of the split's largest scene file: unpacked textures and the structures for rays and sound.
const BYTES_PER_FILE_BYTE: usize = 2;

/// Bytes charged for the ringing sound of an episode: eight sources with two seconds of reverberation.
const SOUND_BYTES: usize = 16 << 20;

/// Session limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// Memory for open episodes, MiB: an allowance for each scene, sound and frames.
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

    /// Returns the bytes charged for an episode. No argument depends on the scene of the episode: a charge by the scene would reveal
    /// its size to an agent that tries slots and picture sizes.
    pub(crate) fn charge(&self, scene_allowance: usize, sensors: &Sensors) -> usize {
        // Under a small limit too, half of the memory is left to pictures and sound.
        let scene = scene_allowance.min(self.session_bytes() / 2);
        let sound = if sensors.audio { SOUND_BYTES } else { 0 };
        scene + sound + frame_bytes(sensors)
    }

    /// Rejects an episode whose charge does not fit the session memory beside the run's open episodes, `open`.
    fn check(&self, open: Vec<MemoryUse>, new: MemoryUse) -> Result<(), Refusal> {
        self.check_scene(new.scene.resident_bytes())?;
        let is_alone = open.is_empty();
        let uses: Vec<_> = open.into_iter().chain([new]).collect();
        if uses.iter().map(|memory| memory.charged_bytes).sum::<usize>() <= self.session_bytes() {
            self.report_overuse(uses);
            return Ok(());
        }
        // Agents choose slots and picture size, so this is not the server's fault.
        if !is_alone {
            let message = "the run's open episodes use the memory of the session; play the episode when another has ended, with fewer slots, or with smaller pictures";
            return Err(Refusal::new(Reason::NoCapacity, message).retry_after(RETRY_S));
        }
        let message = "pictures and sound of an episode exceed the memory of the session; start a run with smaller pictures or fewer sensors";
        Err(Refusal::new(Reason::SensorNotAllowed, message))
    }

    /// Logs open episodes that use more than they are charged and than the session memory. They continue: a refusal would
    /// depend on their scenes.
    fn report_overuse(&self, uses: Vec<MemoryUse>) {
        let (episodes, bytes) = (uses.len(), bytes_of(uses));
        if bytes > self.session_bytes() {
            let (mib, limit_mib) = (bytes.div_ceil(1 << 20), self.session_memory_mib);
            tracing::warn!(
                episodes,
                mib,
                limit_mib,
                "open episodes of a run exceed the session memory; lower max_slots of the phase, or raise avln serve --session-memory"
            );
        }
    }

    /// Returns a warning for a phase whose scenes may exceed the session memory.
    fn warning(&self, phase: &str, scene_allowance: usize) -> Option<String> {
        let (mib, limit) = (scene_allowance.div_ceil(1 << 20), self.session_memory_mib);
        (scene_allowance > self.session_bytes()).then(|| {
            format!(
                "a scene of phase '{phase}' may use {mib} MiB, but a session may use {limit} MiB; episodes in larger scenes are server faults: raise --session-memory"
            )
        })
    }

    /// Returns whether the agent caused a refusal, by slots or sensors.
    pub(crate) fn is_agents_choice(refused: &Refusal) -> bool {
        matches!(refused.reason, Reason::NoCapacity | Reason::SensorNotAllowed | Reason::BadRequest)
    }
}

/// Returns the bytes charged for a scene, the same for all scenes of the split.
pub(crate) fn scene_allowance(split: &SplitFolder) -> usize {
    split.scenes().iter().map(|scene| allowance_of(&scene.source)).max().unwrap_or(HOUSE_BYTES)
}

fn allowance_of(source: &SceneSource) -> usize {
    let SceneSource::File { path } = source else { return HOUSE_BYTES };
    let file_bytes = std::fs::metadata(path).map_or(0, |file| file.len());
    let bytes = usize::try_from(file_bytes).unwrap_or(usize::MAX).saturating_mul(BYTES_PER_FILE_BYTE);
    bytes.max(SCAN_BYTES)
}

#[derive(Clone)]
pub(crate) struct MemoryUse {
    scene: Arc<SceneAssets>,
    /// Bytes without the scene: ears and frames.
    own_bytes: usize,
    /// Bytes by [`Budget::charge`].
    charged_bytes: usize,
}

impl MemoryUse {
    pub(crate) fn of(scene: Arc<SceneAssets>, referee: &Referee, charged_bytes: usize) -> Self {
        let own_bytes = referee.most_bytes() + frame_bytes(referee.sensors());
        Self { scene, own_bytes, charged_bytes }
    }
}

impl Arena {
    /// Rejects an episode beyond the session memory.
    pub(crate) fn check_memory(&self, run: &str, new: &MemoryUse) -> Result<(), Refusal> {
        let open = self.open_episodes().memory_of(run).cloned().collect();
        // Without the lock: measuring scenes takes time.
        self.budget.check(open, new.clone())
    }

    /// Returns a warning per phase whose scenes may exceed the session memory.
    pub async fn memory_warnings(&self) -> Result<Vec<String>, Failure> {
        let phases = self.phases.now(&self.store).await?;
        let warnings =
            phases.iter().filter_map(|phase| self.budget.warning(&phase.settings.id, phase.scene_allowance));
        Ok(warnings.collect())
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

/// Limits for jobs in progress, of every team and of all together. Waiting jobs of several teams alternate.
pub(crate) struct TeamTurns {
    per_team: usize,
    by_team: Mutex<BTreeMap<String, Arc<Semaphore>>>,
    all: Arc<Semaphore>,
}

/// A job's turn, until it is dropped.
pub(crate) struct Turn {
    _team: OwnedSemaphorePermit,
    _all: OwnedSemaphorePermit,
}

impl TeamTurns {
    /// A single job at a time.
    pub(crate) fn single() -> Self {
        Self::new(1, 1)
    }

    /// Half of the processor cores per team.
    pub(crate) fn half_of_cores() -> Self {
        let cores = std::thread::available_parallelism().map_or(2, usize::from);
        // No limit for all together: a job that hangs must not delay other teams.
        Self::new(cores.div_ceil(2), Semaphore::MAX_PERMITS)
    }

    fn new(per_team: usize, all: usize) -> Self {
        Self { per_team, by_team: Mutex::default(), all: Arc::new(Semaphore::new(all)) }
    }

    /// Waits for the team's turn. It always comes, because the semaphores are never closed.
    pub(crate) async fn next(&self, team: &str) -> Option<Turn> {
        // The team's own permit first: with it, at most `per_team` of its jobs are in the queue for all.
        let own = self.of(team).acquire_owned().await.ok()?;
        let all = self.all.clone().acquire_owned().await.ok()?;
        Some(Turn { _team: own, _all: all })
    }

    fn of(&self, team: &str) -> Arc<Semaphore> {
        let mut teams = lock(&self.by_team);
        let new = || Arc::new(Semaphore::new(self.per_team));
        teams.entry(team.to_owned()).or_insert_with(new).clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_houses::{HouseOptions, house};
    use avln_world::Body;
    use tokio::task::{JoinSet, yield_now};

    fn scene(seed: u64, rooms: u8) -> Arc<SceneAssets> {
        let house = house("house", seed, &HouseOptions { rooms: rooms..=rooms, ..HouseOptions::default() });
        Arc::new(SceneAssets::prepare(house, &Body::default()).expect("a house to walk in"))
    }

    #[test]
    fn shared_scenes_count_once() {
        let (a, b) = (scene(1, 6), scene(2, 6));
        let memory =
            |scene: &Arc<SceneAssets>| MemoryUse { scene: scene.clone(), own_bytes: 1000, charged_bytes: 0 };
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
        let scene = scene(1, 6);
        let budget = Budget { session_memory_mib: 64, ..Budget::default() };
        let with = |mib: usize| MemoryUse { scene: scene.clone(), own_bytes: 0, charged_bytes: mib << 20 };
        assert_eq!(budget.check(vec![with(32)], with(32)), Ok(()));
        let reason = |open, new| budget.check(open, new).unwrap_err().reason;
        assert_eq!(reason(vec![with(32)], with(33)), Reason::NoCapacity);
        assert_eq!(reason(vec![], with(65)), Reason::SensorNotAllowed);
        for refused in [budget.check(vec![with(32)], with(33)), budget.check(vec![], with(65))] {
            let refused = refused.unwrap_err();
            assert!(Budget::is_agents_choice(&refused) && !refused.message.contains("MiB"), "{refused}");
        }
        let small = Budget { session_memory_mib: 0, ..Budget::default() };
        let refused = small.check(vec![with(0)], with(0)).unwrap_err();
        assert_eq!(refused.reason, Reason::SimFault);
        assert!(!Budget::is_agents_choice(&refused));
    }

    #[test]
    fn answers_are_equal_for_small_and_large_scenes() {
        let (small, large) = (scene(1, 4), scene(2, 12));
        assert!(large.resident_bytes() > small.resident_bytes());
        let mut answers = Vec::new();
        for session_memory_mib in [64, 100, 200] {
            let budget = Budget { session_memory_mib, ..Budget::default() };
            for (side, open) in (64..=1024).step_by(64).flat_map(|side| [0, 1, 3].map(|open| (side, open))) {
                let sensors = Sensors::all(side, side);
                let charged_bytes = budget.charge(HOUSE_BYTES, &sensors);
                let answer = |scene: &Arc<SceneAssets>| {
                    let (scene, own_bytes) = (scene.clone(), frame_bytes(&sensors));
                    let new = MemoryUse { scene, own_bytes, charged_bytes };
                    budget.check(vec![new.clone(); open], new).err().map(|refused| refused.reason)
                };
                let expected = answer(&small);
                assert_eq!(answer(&large), expected, "{session_memory_mib} MiB, {side} pixels, {open} open");
                answers.push(expected);
            }
        }
        for seen in [None, Some(Reason::NoCapacity), Some(Reason::SensorNotAllowed)] {
            assert!(answers.contains(&seen), "{seen:?} is among the answers");
        }
    }

    #[test]
    fn default_memory_suffices_for_all_slots() {
        let budget = Budget::default();
        assert!(16 * budget.charge(SCAN_BYTES, &Sensors::all(1024, 1024)) <= budget.session_bytes());
        assert!(64 * budget.charge(HOUSE_BYTES, &Sensors::all(256, 256)) <= budget.session_bytes());
        assert_eq!(budget.warning("finals", SCAN_BYTES), None);
    }

    #[test]
    fn scene_files_are_charged_by_the_largest() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("scan.glb");
        std::fs::File::create(&path).and_then(|file| file.set_len(100 << 20)).expect("a sparse file");
        assert_eq!(allowance_of(&SceneSource::File { path: path.clone() }), 200 << 20);
        let budget = Budget { session_memory_mib: 100, ..Budget::default() };
        let warning = budget.warning("finals", 200 << 20).expect("a small limit");
        for part in ["phase 'finals'", "200 MiB", "100 MiB", "--session-memory"] {
            assert!(warning.contains(part), "{warning}");
        }
        std::fs::remove_file(&path).expect("the file");
        assert_eq!(allowance_of(&SceneSource::File { path }), SCAN_BYTES);
    }

    /// Returns the order in which the jobs of the teams ran.
    async fn order(turns: TeamTurns, busy: &str, teams: &[&'static str]) -> Vec<&'static str> {
        let (turns, order) = (Arc::new(turns), Arc::new(Mutex::new(Vec::new())));
        let first = turns.next(busy).await;
        let mut jobs = JoinSet::new();
        for &team in teams {
            let (turns, order) = (turns.clone(), order.clone());
            jobs.spawn(async move {
                let turn = turns.next(team).await;
                order.lock().expect("no panic").push(team);
                drop(turn);
            });
            yield_now().await;
        }
        drop(first);
        jobs.join_all().await;
        let order = order.lock().expect("no panic");
        order.clone()
    }

    #[tokio::test]
    async fn waiting_teams_alternate() {
        let teams = ["red", "red", "red", "blue"];
        assert_eq!(order(TeamTurns::single(), "green", &teams).await, ["red", "blue", "red", "red"]);
    }

    #[tokio::test]
    async fn busy_teams_delay_no_others() {
        let turns = TeamTurns::new(1, Semaphore::MAX_PERMITS);
        assert_eq!(order(turns, "red", &["red", "blue"]).await, ["blue", "red"]);
    }
}
