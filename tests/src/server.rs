//! The program itself, hosting a folder in a process of its own.

use std::{
    fs::File,
    io::{BufRead, BufReader, Lines},
    net::SocketAddr,
    path::Path,
    process::{Child, ChildStdout, Command, Stdio},
};

/// The program of this build, hosting a folder.
pub struct Server {
    process: Child,
    /// What it says after it has told its doors; open, because a program whose reader has gone ends.
    _says: Lines<BufReader<ChildStdout>>,
    /// Where agents connect.
    pub grpc: SocketAddr,
    /// Where people look.
    pub web: SocketAddr,
}

impl Server {
    /// Starts `program` over `folder` and waits until it has told its doors. Its log goes to `server.log` there.
    pub fn start(program: &str, folder: &Path) -> Self {
        Self::start_with(program, folder, &[])
    }

    /// The same with more options of `serve`.
    pub fn start_with(program: &str, folder: &Path, options: &[&str]) -> Self {
        let path = folder.join("server.log");
        let log = File::options().create(true).append(true).open(&path).expect("a log of the server");
        let mut serve = Command::new(program);
        serve.arg("--data").arg(folder).args(["serve", "--admin", "off"]).args(options);
        serve.args(["--grpc", "127.0.0.1:0", "--web", "127.0.0.1:0"]);
        let mut process = serve.stdout(Stdio::piped()).stderr(log).spawn().expect("the program starts");
        let mut says = BufReader::new(process.stdout.take().expect("its output")).lines();
        let doors = door(&mut says, "agents").zip(door(&mut says, "leaderboard"));
        let Some((grpc, web)) = doors else {
            let log = std::fs::read_to_string(path).unwrap_or_default();
            panic!("the server ended before it told its doors ({:?}); its log:\n{log}", process.wait());
        };
        Self { process, _says: says, grpc, web }
    }

    /// Number of its process.
    pub fn id(&self) -> u32 {
        self.process.id()
    }

    /// Whether it has not ended by itself.
    pub fn is_running(&mut self) -> bool {
        self.process.try_wait().expect("a state").is_none()
    }

    /// Ends it as a crash would: SIGKILL, without a word.
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

/// The address that it says beside `name`.
fn door(says: &mut Lines<BufReader<ChildStdout>>, name: &str) -> Option<SocketAddr> {
    let line = says.map_while(Result::ok).find(|line| line.starts_with(name))?;
    line.rsplit('/').next().and_then(|address| address.parse().ok())
}
