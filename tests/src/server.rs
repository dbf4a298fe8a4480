//! The program itself, hosting a folder in a process of its own.

use std::{
    fs::File,
    net::SocketAddr,
    path::Path,
    process::{Child, Command, Stdio},
    time::Duration,
};

/// The program of this build, hosting a folder.
pub struct Server {
    process: Child,
    /// Where agents connect.
    pub grpc: SocketAddr,
    /// Where people look.
    pub web: SocketAddr,
}

impl Server {
    /// Starts `program` over `folder`, without waiting until it answers. Its log goes to `server.log` there.
    pub fn start(program: &str, folder: &Path) -> Self {
        Self::start_with(program, folder, &[])
    }

    /// The same with more options of `serve`.
    pub fn start_with(program: &str, folder: &Path, options: &[&str]) -> Self {
        let free =
            || std::net::TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr()).expect("a free port");
        let (grpc, web) = (free(), free());
        let log = folder.join("server.log");
        let log = File::options().create(true).append(true).open(log).expect("a log of the server");
        let mut serve = Command::new(program);
        serve.arg("--data").arg(folder).args(["serve", "--admin", "off"]).args(options);
        serve.args(["--grpc", &grpc.to_string(), "--web", &web.to_string()]);
        let process = serve.stdout(Stdio::null()).stderr(log).spawn().expect("the program starts");
        Self { process, grpc, web }
    }

    /// Number of its process.
    pub fn id(&self) -> u32 {
        self.process.id()
    }

    /// Whether it has not ended by itself.
    pub fn lives(&mut self) -> bool {
        self.process.try_wait().expect("a state").is_none()
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
