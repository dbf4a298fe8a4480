//! The Python wheel for this platform, installed into an empty environment: demo, training and evaluation.

use avln_tests::{
    Server,
    machine::{self, files, root},
    share_cache,
};
use std::{env, ffi::OsStr, fs, path::Path, path::PathBuf, process::Command};

/// Modules for the wheel and the environment, and the dependencies of the package.
const NEEDED: [&str; 6] = ["ensurepip", "google.protobuf", "grpc", "gymnasium", "hatchling", "numpy"];
const REMEDY: &str = "pip install -e \"client-sdk/python[dev]\"";

/// Folders of installed packages, one per line.
const PACKAGES: &str =
    "import sys; print(*[path for path in sys.path if path.endswith('-packages')], sep='\\n')";

/// Twenty steps of the teacher with the module of the wheel; prints the module's path and the steps.
const TRAINING: &str = "
import avln.sim
small = avln.sim.Curriculum(goals=(1, 2), distance_m=(1.0, 100.0), rooms=(3, 4), storeys=(1, 1))
envs = avln.sim.VectorEnv(2, threads=2, scenes=1, size=64, curriculum=small, privileged=True)
observations, infos = envs.reset(seed=1)
for _ in range(20):
    observations, rewards, terminated, truncated, infos = envs.step(infos['expert'])
assert observations['rgb'].any() and observations['audio'].any() and rewards.any()
print(avln.sim.options.native().__file__)
";

/// A virtual environment with the wheel, and nothing of the developer's environment.
struct Environment {
    folder: tempfile::TempDir,
}

impl Environment {
    /// Makes the wheel from this build and installs it without a network; `None` without the modules that this needs.
    fn with_wheel() -> Option<Self> {
        let mut venv = machine::python("the wheel for this platform", &NEEDED, REMEDY)?;
        let interpreter = venv.get_program().to_owned();
        let folder = tempfile::tempdir().expect("a folder");
        venv.args(["-m", "venv"]).arg(folder.path().join("venv"));
        machine::succeeds("python -m venv", venv);
        let environment = Self { folder };
        let wheel = environment.make_wheel(&interpreter);
        let mut install = environment.command("python");
        install.args(["-m", "pip", "install", "--quiet", "--no-index", "--no-deps"]).arg(wheel);
        machine::succeeds("pip install", install);
        environment.add_dependencies(&interpreter);
        Some(environment)
    }

    fn make_wheel(&self, interpreter: &OsStr) -> PathBuf {
        let folder = self.folder.path().join("wheel");
        let mut make = Command::new(root().join("packaging/wheel.sh"));
        make.arg(format!("{}-unknown-linux-gnu", env::consts::ARCH)).arg(machine::native_module());
        make.arg(env!("CARGO_BIN_EXE_avln_under_test")).arg(&folder).env("AVLN_PYTHON", interpreter);
        machine::succeeds("packaging/wheel.sh", make);
        let wheel = files(&folder, ".whl").pop().expect("a wheel");
        let name = wheel.file_name().expect("a name").to_string_lossy();
        assert!(name.contains("-cp310-abi3-manylinux_2_"), "{name}");
        wheel
    }

    /// Adds the packages of `interpreter` after those of the environment, because no index can be reached.
    fn add_dependencies(&self, interpreter: &OsStr) {
        let mut there = Command::new(interpreter);
        there.args(["-c", PACKAGES]);
        let mut here = self.command("python");
        here.args(["-c", PACKAGES]);
        let here = machine::succeeds("folders of packages", here);
        let file = Path::new(here.trim()).join("dependencies.pth");
        fs::write(file, machine::succeeds("folders of packages", there)).expect("a file");
    }

    /// A program of the environment.
    fn command(&self, program: &str) -> Command {
        let programs = self.folder.path().join("venv/bin");
        let mut command = Command::new(programs.join(program));
        for name in ["AVLN_NATIVE", "AVLN_SERVER", "AVLN_TOKEN", "AVLN_CA", "PYTHONPATH"] {
            command.env_remove(name);
        }
        command.env("AVLN_DATA", self.data()).current_dir(self.folder.path());
        command
    }

    fn data(&self) -> PathBuf {
        self.folder.path().join("data")
    }

    /// Runs the demo with one mission.
    fn demo(&self) {
        share_cache(&self.data());
        let mut demo = self.command("avln");
        demo.args(["demo", "--once", "--houses", "1", "--missions", "1"]);
        demo.args(["--grpc", "127.0.0.1:0", "--web", "127.0.0.1:0"]);
        let table = machine::succeeds("avln demo", demo);
        assert!(table.contains("PAG-Nav"), "{table}");
    }

    fn train(&self) {
        let mut train = self.command("python");
        train.args(["-c", TRAINING]);
        let module = machine::succeeds("training", train);
        let inside = Path::new(module.trim()).starts_with(self.folder.path());
        assert!(inside, "{module}");
    }

    /// Serves the demo's phase, checks the connection and plays a run with an example agent.
    fn evaluate(&self) {
        let mut add = self.command("avln");
        add.args(["challenge", "team", "add", "participant"]);
        let answer = machine::succeeds("avln challenge team add", add);
        let token = answer.split_whitespace().find(|word| word.starts_with("avln_")).expect("a token");
        let program = self.folder.path().join("venv/bin/avln");
        let server = Server::start(program.to_str().expect("a path in UTF-8"), &self.data());
        let connection = ["--server", &format!("http://{}", server.grpc), "--token", token];
        let mut doctor = self.command("avln");
        doctor.arg("doctor").args(connection).args(["--episodes", "1", "--steps", "20", "--size", "64"]);
        machine::succeeds("avln doctor", doctor);
        let mut agent = self.command("python");
        agent.arg(root().join("client-sdk/python/examples/random_walk.py")).args(connection);
        let summary = machine::succeeds("random_walk.py", agent);
        assert!(summary.contains("1 of 1 episodes, complete"), "{summary}");
    }
}

#[test]
fn wheel_brings_demo_training_and_evaluation() {
    let Some(environment) = Environment::with_wheel() else { return };
    environment.demo();
    environment.train();
    environment.evaluate();
}
