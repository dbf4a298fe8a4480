//! Test servers for the end-to-end tests in `tests/`.

pub mod clients;
pub mod hidden_facts;
pub mod http;
pub mod machine;
pub mod proxies;

use avln_arena::cache::CacheFolder;
use avln_arena::data::DataFolder;
use avln_arena::ids::new_token;
use avln_arena::servers::{Addresses, Limits, RunningServers, Security, Servers};
use avln_arena::setup::{NewPhase, NewSplit, admit, make_split, open_phase};
use avln_arena::{Arena, SCENE_MEMORY_MIB, now_unix_ms};
use avln_dataset::{Seed, SplitSecret};
pub use avln_lab::suite::{PASSED_M, Walker, distance_m};
use avln_store::{AuditNote, NewToken, Phase, Store, TokenScope, Visibility};
use std::collections::{BTreeMap, btree_map::Entry};
use std::env;
use std::fs::{self, File};
use std::io::{BufRead, BufReader, Lines};
use std::net::SocketAddr;
use std::os::unix::{fs::symlink, process::parent_id};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::{Arc, LazyLock};
use std::time::UNIX_EPOCH;
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
    share_cache(folder);
}

async fn make_split_files(setup: &TestSetup) -> Files {
    let folder = TempDir::new().expect("a folder for temporary files");
    share_cache(folder.path());
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
    let mut paths = machine::files(folder.path(), "");
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

/// This build's program, hosting a folder.
pub struct Server {
    process: Child,
    /// Output after the addresses; kept open, because a broken pipe ends the program.
    _output: Lines<BufReader<ChildStdout>>,
    /// gRPC address.
    pub grpc: SocketAddr,
    /// Web address.
    pub web: SocketAddr,
}

impl Server {
    /// Starts `program` on `folder` and waits for its addresses. The log is `server.log` in the folder.
    pub fn start(program: &str, folder: &Path) -> Self {
        Self::start_with(program, folder, &[])
    }

    /// Starts `program` on free ports with more `serve` options, without an admin server.
    pub fn start_with(program: &str, folder: &Path, options: &[&str]) -> Self {
        let free = ["--admin", "off", "--grpc", "127.0.0.1:0", "--web", "127.0.0.1:0"];
        Self::serve(program, folder, &[&free[..], options].concat())
    }

    /// Starts `program` with `options` for `serve`, which include the addresses.
    pub fn serve(program: &str, folder: &Path, options: &[&str]) -> Self {
        let path = folder.join("server.log");
        let log = File::options().create(true).append(true).open(&path).expect("a log of the server");
        let mut serve = Command::new(program);
        serve.arg("--data").arg(folder).arg("serve").args(options);
        let mut process = serve.stdout(Stdio::piped()).stderr(log).spawn().expect("the program starts");
        let mut output = BufReader::new(process.stdout.take().expect("its output")).lines();
        let addresses = address(&mut output, "agents").zip(address(&mut output, "leaderboard"));
        let Some((grpc, web)) = addresses else {
            let log = std::fs::read_to_string(path).unwrap_or_default();
            panic!(
                "the server ended before it printed its addresses ({:?}); its log:\n{log}",
                process.wait()
            );
        };
        Self { process, _output: output, grpc, web }
    }

    /// Process id.
    pub fn id(&self) -> u32 {
        self.process.id()
    }

    /// True while the process runs.
    pub fn is_running(&mut self) -> bool {
        self.process.try_wait().expect("a state").is_none()
    }

    /// Ends the process by SIGKILL, like a crash.
    pub fn kill(mut self) {
        self.process.kill().expect("it runs");
        self.process.wait().expect("it is gone");
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// The address printed after `name`.
fn address(output: &mut Lines<BufReader<ChildStdout>>, name: &str) -> Option<SocketAddr> {
    let line = output.map_while(Result::ok).find(|line| line.starts_with(name))?;
    line.rsplit('/').next().and_then(|address| address.parse().ok())
}

/// Start of the folders' names.
const NAME: &str = "avln-tests-cache-";

/// Folder of this run. Another build never uses it, because its preparation may differ.
static SHARED: LazyLock<PathBuf> = LazyLock::new(|| {
    let program = env::current_exe().and_then(fs::metadata).expect("this program");
    let built = program.modified().expect("a time").duration_since(UNIX_EPOCH).expect("after 1970");
    delete_old();
    // The parent is cargo, or another runner with a process per test.
    let folder = env::temp_dir().join(format!("{NAME}{}-{}", parent_id(), built.as_nanos()));
    fs::create_dir_all(&folder).expect("a folder for temporary files");
    folder
});

/// Lets a data folder without cache use the one that all tests of a run share: most of a short episode's time is the preparation
/// of its sounds.
pub fn share_cache(data: &Path) {
    let link = data.join(CacheFolder::IN_DATA);
    fs::create_dir_all(link.parent().expect("a folder")).expect("a folder");
    symlink(&*SHARED, link).expect("a link");
}

/// Deletes the folders of ended runs, where the system lists its processes.
fn delete_old() {
    if !Path::new("/proc/self").exists() {
        return;
    }
    for entry in fs::read_dir(env::temp_dir()).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let run = name.strip_prefix(NAME).and_then(|rest| rest.split('-').next());
        if run.is_some_and(|process| !Path::new("/proc").join(process).exists()) {
            let _ = fs::remove_dir_all(entry.path());
        }
    }
}
