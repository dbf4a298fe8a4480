//! Test servers for the end-to-end tests in `tests/`.

pub mod cache;
pub mod disk;
pub mod fault_proxy;
pub mod hidden_facts;
pub mod http;
pub mod python;
pub mod raw;
pub mod recording_proxy;
pub mod repository;
pub mod scripted_run;
pub mod server;
pub mod skipped;

use avln_arena::{
    Arena, SCENE_MEMORY_MIB,
    cache::CacheFolder,
    data::DataFolder,
    ids::new_token,
    now_unix_ms,
    servers::{Addresses, Limits, RunningServers, Security, Servers},
    setup::{NewPhase, NewSplit, admit, make_split, open_phase},
};
use avln_dataset::{Seed, SplitSecret};
pub use avln_lab::suite::{PASSED_M, Walker, distance_m};
use avln_store::Visibility;
use avln_store::{AuditNote, NewToken, Phase, Store, TokenScope};
use std::{
    collections::{BTreeMap, btree_map::Entry},
    fs,
    path::{Path, PathBuf},
    sync::Arc,
};
use tempfile::TempDir;
use tokio::sync::Mutex;

/// A running server with its own ports and data folder, one phase and one team.
pub struct TestServer {
    /// The data folder, deleted with the server.
    pub folder: TempDir,
    /// gRPC server and web server.
    pub servers: RunningServers,
    /// Account token for the team [`TEAM`].
    pub token: String,
}

/// Team on every test server.
pub const TEAM: &str = "test team";
/// Phase and split on every test server.
pub const PHASE: &str = "trial";

/// Contents of a test server's data folder.
#[derive(Clone, Debug)]
pub struct TestSetup {
    /// Procedural houses in the split.
    pub houses: u32,
    /// Missions per house.
    pub missions: usize,
    /// Visibility for scores, and for replays without `replays_to`.
    pub visible_to: Visibility,
    /// Visibility for replays, if different.
    pub replays_to: Option<Visibility>,
    /// The split of hidden phases, for a public phase.
    pub is_secret: bool,
}

impl Default for TestSetup {
    fn default() -> Self {
        Self { houses: 1, missions: 2, visible_to: Visibility::Public, replays_to: None, is_secret: false }
    }
}

impl TestSetup {
    /// Hidden phases require a secret, with the same bits in every test run.
    fn seed(&self) -> Seed {
        if self.has_secret() { Seed::Secret(SplitSecret::new([5; 32])) } else { Seed::Number(5) }
    }

    fn has_secret(&self) -> bool {
        let visibilities = [self.visible_to, self.replays_to.unwrap_or(self.visible_to)];
        self.is_secret || visibilities != [Visibility::Public; 2]
    }
}

impl TestServer {
    /// Builds scenes and missions, opens the phase and starts both servers.
    pub async fn open(setup: &TestSetup) -> Self {
        Self::open_with_tls(setup, &Security::default()).await
    }

    /// Starts a server with TLS if `security` names files.
    pub async fn open_with_tls(setup: &TestSetup, security: &Security) -> Self {
        let folder = TempDir::new().expect("a folder for temporary files");
        let token = set_up(folder.path(), setup).await;
        let servers = start_servers_with(folder.path(), security).await;
        Self { folder, servers, token }
    }

    /// gRPC address.
    pub fn agents_url(&self) -> String {
        format!("{}://{}", self.servers.scheme(), self.servers.grpc)
    }

    /// Starts a server with an admin server.
    pub async fn open_with_admin(setup: &TestSetup) -> Self {
        let folder = TempDir::new().expect("a folder for temporary files");
        let token = set_up(folder.path(), setup).await;
        let (servers, open) = bind_servers(folder.path(), &Security::default()).await;
        let free = "127.0.0.1:0".parse().expect("an address");
        let servers = open(servers.with_admin(free).await.expect("a free port"));
        Self { folder, servers, token }
    }

    /// Starts a server on a prepared folder, with a modified arena and modified limits.
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
        let servers = Servers::bind(&Addresses { grpc: free, web: free }).await.expect("free ports");
        let servers = servers.with_documents(avln_cli::documents()).with_limits(limits);
        let servers = servers.with_admin(free).await.expect("a free port");
        let servers = servers.open(Arc::new(arena(opened)), store.reader()).expect("running servers");
        Self { folder, servers, token }
    }

    /// Issues an organiser token.
    pub async fn organiser(&self) -> String {
        let secret = new_token("organiser").expect("randomness");
        let (kind, name) = (TokenScope::Organiser, "");
        let token = NewToken { secret: &secret, kind, name, team: None, expires_unix_ms: None };
        let store = store(self.folder.path()).await;
        store.issue_token(&token, now_unix_ms()).await.expect("a token");
        store.close().await;
        secret
    }

    /// Restarts the servers on the same folder.
    pub async fn reopen(self) -> Self {
        self.servers.close().await.expect("a shutdown");
        let servers = start_servers(self.folder.path()).await;
        Self { servers, ..self }
    }
}

/// Creates a split, a phase and a team in a data folder; returns the team token.
pub async fn set_up(folder: &Path, setup: &TestSetup) -> String {
    copy_split(folder, setup).await;
    let data = DataFolder::open(folder).expect("the folder is writable");
    let store = data.store().await.expect("its database");
    let open = NewPhase {
        scores: setup.visible_to,
        replays: setup.replays_to.unwrap_or(setup.visible_to),
        max_side: 256,
        ..NewPhase::public(PHASE, PHASE)
    };
    open_phase(&data, &store, &open).await.expect("the phase can be opened");
    let token = admit(&store, TEAM, None).await.expect("the team can be admitted");
    store.close().await;
    token
}

/// Relative path and bytes of every file in a folder.
type Files = Vec<(PathBuf, Vec<u8>)>;

/// Copies a data folder with the split, which the first test with this split makes.
async fn copy_split(folder: &Path, setup: &TestSetup) {
    static MADE: Mutex<BTreeMap<(u32, usize, bool), Files>> = Mutex::const_new(BTreeMap::new());
    let mut made = MADE.lock().await;
    let files = match made.entry((setup.houses, setup.missions, setup.has_secret())) {
        Entry::Occupied(made) => made.into_mut(),
        Entry::Vacant(size) => size.insert(make_split_files(setup).await),
    };
    for (path, bytes) in files {
        let path = folder.join(path);
        fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        fs::write(path, bytes).expect("a copy");
    }
    cache::share(folder);
}

async fn make_split_files(setup: &TestSetup) -> Files {
    let folder = TempDir::new().expect("a folder for temporary files");
    cache::share(folder.path());
    let data = DataFolder::open(folder.path()).expect("the folder is writable");
    let store = data.store().await.expect("a new database");
    let make = NewSplit {
        name: PHASE.to_owned(),
        houses: setup.houses,
        scenes: vec![],
        missions: setup.missions,
        seed: setup.seed(),
        rules: "lh-avln-v1".to_owned(),
    };
    make_split(&data, &store, make, |_| ()).await.expect("missions in the houses");
    store.close().await;
    let mut paths = repository::files(folder.path(), "");
    paths.retain(|path| !path.starts_with(folder.path().join(CacheFolder::IN_DATA)));
    let relative =
        |path: &PathBuf| path.strip_prefix(folder.path()).expect("a file in the folder").to_owned();
    paths.iter().map(|path| (relative(path), fs::read(path).expect("a file"))).collect()
}

/// A folder's database.
pub async fn store(folder: &Path) -> Store {
    DataFolder::open(folder).expect("the folder").store().await.expect("its database")
}

/// Changes the phase as the organiser.
pub async fn change_phase(folder: &Path, change: impl FnOnce(&mut Phase)) {
    let store = store(folder).await;
    let mut phase = store.phase(PHASE).await.expect("the phase");
    change(&mut phase);
    store.change_phases(&[phase], &[AuditNote::default()], 1).await.expect("a change");
    store.close().await;
}

/// Starts both servers on a prepared folder on free ports.
pub async fn start_servers(folder: &Path) -> RunningServers {
    start_servers_with(folder, &Security::default()).await
}

async fn start_servers_with(folder: &Path, security: &Security) -> RunningServers {
    let (servers, open) = bind_servers(folder, security).await;
    open(servers)
}

/// Bound servers, and a function that starts them.
async fn bind_servers(
    folder: &Path,
    security: &Security,
) -> (Servers, impl FnOnce(Servers) -> RunningServers + use<>) {
    let data = DataFolder::open(folder).expect("the folder is writable");
    let store = data.store().await.expect("its database");
    let arena = Arena::open(&data, store.clone(), SCENE_MEMORY_MIB).await.expect("its phases");
    let free = "127.0.0.1:0".parse().expect("an address");
    let identity = security.identity().expect("files of a certificate");
    let servers = Servers::bind_as(&Addresses { grpc: free, web: free }, identity).await.expect("free ports");
    let servers = servers.with_documents(avln_cli::documents());
    (servers, move |servers: Servers| servers.open(Arc::new(arena), store.reader()).expect("running servers"))
}
