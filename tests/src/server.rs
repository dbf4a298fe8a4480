//! The program of this build as a process, hosting a data folder.

use std::{
    fs::File,
    net::{SocketAddr, TcpListener},
    path::Path,
    process::{Child, Command, Stdio},
    time::Duration,
};

/// A server in a process of its own. It is killed when it is dropped.
pub struct Server {
    process: Child,
    /// Where agents connect.
    pub grpc: SocketAddr,
    /// Where people look.
    pub web: SocketAddr,
}

impl Server {
    /// Starts `program` on free ports over `folder`.
    pub fn start(program: &str, folder: &Path) -> Self {
        let free = || TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr()).expect("a free port");
        let (grpc, web) = (free(), free());
        let log = folder.join("server.log");
        let log = File::options().create(true).append(true).open(log).expect("a log of the server");
        let addresses = [grpc, web].map(|address| address.to_string());
        let mut serve = Command::new(program);
        serve.arg("--data").arg(folder).args(["serve", "--admin", "off"]);
        serve.args(["--grpc", &addresses[0], "--web", &addresses[1]]);
        let process = serve.stdout(Stdio::null()).stderr(log).spawn().expect("the program starts");
        Self { process, grpc, web }
    }

    /// Ends it as a crash would: SIGKILL, without a word.
    pub fn kill(mut self) {
        self.process.kill().expect("it runs");
        self.process.wait().expect("it is gone");
    }

    /// Waits until it answers.
    pub async fn answers(&self) {
        for _ in 0..600 {
            if tokio::net::TcpStream::connect(self.grpc).await.is_ok() {
                return;
            }
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
        panic!("the server does not answer within 30 s");
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
