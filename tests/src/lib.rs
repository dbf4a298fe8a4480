//! What only the whole house can show. The tests lie in `tests/`; here is the house that they open.

pub mod canary;
pub mod disk;
pub mod fault_proxy;
pub mod http;
pub mod python;
pub mod raw;
pub mod recording_proxy;
pub mod repository;
pub mod scripted_run;
pub mod server;
pub mod skipped;

use avln_arena::setup::{NewPhase, NewSplit, admit, make_split, open_phase};
use avln_arena::{
    Arena, SCENE_MEMORY_MIB,
    data::DataFolder,
    now_unix_ms,
    secret::new_token,
    servers::{Addresses, Limits, RunningServers, Security, Servers},
};
pub use avln_lab::suite::{PASSED_M, Walker, distance_m};
use avln_store::Visibility;
use avln_store::{AuditNote, NewToken, Phase, Store, TokenScope};
use std::{path::Path, sync::Arc};
use tempfile::TempDir;

/// A server with both doors open on ports of its own, over a data folder of its own, with one phase and one team.
pub struct TestServer {
    /// The data folder; it goes with the house.
    pub folder: TempDir,
    /// Both doors.
    pub doors: RunningServers,
    /// Account token of the team [`TEAM`].
    pub token: String,
}

/// The team of every house.
pub const TEAM: &str = "test team";
/// The phase of every house, and its split.
pub const PHASE: &str = "trial";

/// How a house is furnished.
#[derive(Clone, Debug)]
pub struct TestSetup {
    /// Procedural houses in the split.
    pub houses: u32,
    /// Missions in each.
    pub missions: usize,
    /// Who may see scores, and replays where `replays_to` does not say otherwise.
    pub visible_to: Visibility,
    /// Who may see replays, where that is not who may see scores.
    pub replays_to: Option<Visibility>,
}

impl Default for TestSetup {
    fn default() -> Self {
        Self { houses: 1, missions: 2, visible_to: Visibility::Public, replays_to: None }
    }
}

impl TestServer {
    /// Builds scenes and missions, opens the phase and both doors.
    pub async fn open(plan: &TestSetup) -> Self {
        Self::open_as(plan, &Security::default()).await
    }

    /// The same, with doors that speak TLS where `security` names files.
    pub async fn open_as(plan: &TestSetup, security: &Security) -> Self {
        let folder = TempDir::new().expect("a folder for temporary files");
        let token = furnish(folder.path(), plan).await;
        let doors = open_doors_as(folder.path(), security).await;
        Self { folder, doors, token }
    }

    /// Address of the agents' door.
    pub fn agents_url(&self) -> String {
        format!("{}://{}", self.doors.scheme(), self.doors.grpc)
    }

    /// Opens the house with a door for the operator beside the others.
    pub async fn open_with_admin(plan: &TestSetup) -> Self {
        let folder = TempDir::new().expect("a folder for temporary files");
        let token = furnish(folder.path(), plan).await;
        let (doors, open) = bound_doors(folder.path(), &Security::default()).await;
        let free = "127.0.0.1:0".parse().expect("an address");
        let doors = open(doors.with_admin(free).await.expect("a free port"));
        Self { folder, doors, token }
    }

    /// Opens a house over a furnished folder, with changes to what hosts it and to the limits of its door.
    pub async fn open_with(
        folder: TempDir,
        token: String,
        arena: impl FnOnce(Arena) -> Arena,
        limits: impl FnOnce(Limits) -> Limits,
    ) -> Self {
        let data = DataFolder::open(folder.path()).expect("the folder is writable");
        let store = data.store().await.expect("its database");
        let opened = Arena::open(&data, store.clone(), SCENE_MEMORY_MIB).await.expect("its phases");
        let free = "127.0.0.1:0".parse().expect("an address");
        let doors = Servers::bind(&Addresses { grpc: free, web: free }).await.expect("free ports");
        let doors = doors.with_admin(free).await.expect("a free port").with_limits(limits);
        let doors = doors.open(Arc::new(arena(opened)), store.reader()).expect("all doors");
        Self { folder, doors, token }
    }

    /// A new token of an organiser.
    pub async fn organiser(&self) -> String {
        let secret = new_token("organiser").expect("randomness");
        let (kind, name) = (TokenScope::Organiser, "");
        let token = NewToken { secret: &secret, kind, name, team: None, expires_unix_ms: None };
        let store = store(self.folder.path()).await;
        store.issue_token(&token, now_unix_ms()).await.expect("a token");
        store.close().await;
        secret
    }

    /// Closes the doors and opens them again over the same folder.
    pub async fn reopen(self) -> Self {
        self.doors.close().await.expect("both doors close");
        let doors = start_servers(self.folder.path()).await;
        Self { doors, ..self }
    }
}

/// Fills a data folder with a split, a phase and a team; gives back the team's token.
pub async fn furnish(folder: &Path, plan: &TestSetup) -> String {
    let data = DataFolder::open(folder).expect("the folder is writable");
    let store = data.store().await.expect("a new database");
    let make = NewSplit {
        name: PHASE.to_owned(),
        houses: plan.houses,
        scenes: vec![],
        missions: plan.missions,
        seed: 5,
        rules: "lh-avln-v1".to_owned(),
    };
    make_split(&data, &store, make, |_| ()).await.expect("houses hold missions");
    let open = NewPhase {
        scores: plan.visible_to,
        replays: plan.replays_to.unwrap_or(plan.visible_to),
        max_side: 256,
        ..NewPhase::public(PHASE, PHASE)
    };
    open_phase(&data, &store, &open).await.expect("the phase can be opened");
    let token = admit(&store, TEAM, None).await.expect("the team can be admitted");
    store.close().await;
    token
}

/// The database of a folder.
pub async fn store(folder: &Path) -> Store {
    DataFolder::open(folder).expect("the folder").store().await.expect("its database")
}

/// The organiser changes the phase of a furnished folder.
pub async fn rule(folder: &Path, change: impl FnOnce(&mut Phase)) {
    let store = store(folder).await;
    let mut phase = store.phase(PHASE).await.expect("the phase");
    change(&mut phase);
    store.change_phases(&[phase], &[AuditNote::default()], 1).await.expect("a change");
    store.close().await;
}

/// Opens both doors of a furnished folder on free ports.
pub async fn start_servers(folder: &Path) -> RunningServers {
    open_doors_as(folder, &Security::default()).await
}

async fn open_doors_as(folder: &Path, security: &Security) -> RunningServers {
    let (doors, open) = bound_doors(folder, security).await;
    open(doors)
}

/// Servers that are bound, and what opens them.
async fn bound_doors(
    folder: &Path,
    security: &Security,
) -> (Servers, impl FnOnce(Servers) -> RunningServers + use<>) {
    let data = DataFolder::open(folder).expect("the folder is writable");
    let store = data.store().await.expect("its database");
    let arena = Arena::open(&data, store.clone(), SCENE_MEMORY_MIB).await.expect("its phases");
    let free = "127.0.0.1:0".parse().expect("an address");
    let identity = security.identity().expect("files of a certificate");
    let doors = Servers::bind_as(&Addresses { grpc: free, web: free }, identity).await.expect("free ports");
    (doors, move |doors: Servers| doors.open(Arc::new(arena), store.reader()).expect("all doors"))
}
