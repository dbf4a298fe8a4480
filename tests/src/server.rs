//! The server program in a separate process.

use std::{
    fs::File,
    io::{BufRead, BufReader, Lines},
    net::SocketAddr,
    path::Path,
    process::{Child, ChildStdout, Command, Stdio},
};

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
