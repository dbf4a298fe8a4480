//! Sealed agents in a container: command line of Podman or Docker.

use crate::{MAX_PROCESSES, SandboxPlan, SandboxReport};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// A program that runs containers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Engine {
    /// Podman.
    Podman,
    /// Docker.
    Docker,
}

/// A containerised agent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Container {
    /// Container image.
    pub image: String,
    /// The agent's program and arguments; empty for the image's default.
    pub command: Vec<String>,
    /// Container name.
    pub name: String,
    /// Folder with the server's socket.
    pub folder: PathBuf,
    /// The folder's user and group.
    pub owner: (u32, u32),
    /// Memory limit for the whole container, MiB; `None` for no limit.
    pub memory_mib: Option<u32>,
    /// Permitted devices.
    pub devices: Vec<PathBuf>,
    /// True if the engine can set the share of processor time.
    pub has_share: bool,
}

/// The folder's path inside the container.
const INSIDE: &str = "/avln";
/// Least share of processor time; the default is 1024.
const LEAST_SHARE: u32 = 2;

impl Engine {
    /// Supported engines, preferred first.
    pub const ALL: [Self; 2] = [Self::Podman, Self::Docker];

    /// Returns the engine's program name.
    pub fn program(self) -> &'static str {
        match self {
            Self::Podman => "podman",
            Self::Docker => "docker",
        }
    }

    /// Returns the first engine with a program in `path`, a list as in `PATH`.
    pub fn find(path: &std::ffi::OsStr) -> Option<Self> {
        let is_there =
            |engine: &Self| std::env::split_paths(path).any(|dir| dir.join(engine.program()).is_file());
        Self::ALL.into_iter().find(is_there)
    }

    /// Returns whether the engine can set shares of processor time for a container of `user`.
    pub fn has_shares(self, user: u32) -> bool {
        // Podman without root depends on the controllers that systemd delegates.
        let delegated =
            format!("/sys/fs/cgroup/user.slice/user-{user}.slice/user@{user}.service/cgroup.controllers");
        let is_delegated = || {
            fs::read_to_string(delegated)
                .is_ok_and(|names| names.split_whitespace().any(|name| name == "cpu"))
        };
        self == Self::Docker || user == 0 || is_delegated()
    }
}

impl Container {
    /// Returns the enforced and missing restrictions.
    pub fn report(&self) -> SandboxReport {
        let fixed = [
            "no network",
            "read-only root",
            "no capabilities",
            "no new privileges",
            "own processes, users and mounts by the container engine",
            "first to be killed when memory runs out",
        ];
        let processes = format!("at most {MAX_PROCESSES} processes");
        let memory = self.memory_mib.map(|mib| format!("memory limit of {mib} MiB"));
        let enforced = fixed.map(String::from).into_iter().chain([processes]).chain(memory).collect();
        let mut report = SandboxReport { enforced, missing: vec![] };
        let share = if self.has_share { Ok(()) } else { Err("the system delegates no processor controller") };
        report.note("lowest share of processor time", share);
        report
    }

    /// Returns the engine arguments that run the container. The token is in the environment.
    pub fn arguments(&self, engine: Engine) -> Vec<String> {
        let fixed = "run --rm --interactive=false --network none --read-only --cap-drop ALL --security-opt no-new-privileges";
        let mut arguments: Vec<String> = fixed.split(' ').map(String::from).collect();
        let mut add = |flag: &str, value: String| arguments.extend([flag.to_owned(), value]);
        add("--pids-limit", MAX_PROCESSES.to_string());
        add("--oom-score-adj", "1000".to_owned());
        if self.has_share {
            add("--cpu-shares", LEAST_SHARE.to_string());
        }
        if let Some(mib) = self.memory_mib {
            add("--memory", format!("{mib}m"));
            add("--memory-swap", format!("{mib}m"));
        }
        add("--tmpfs", "/tmp:rw,exec,nosuid,nodev,size=1g".to_owned());
        add("--volume", format!("{}:{INSIDE}:ro", self.folder.display()));
        // Podman without root maps the caller's own user into the container; Docker needs the ids.
        match (engine, self.owner) {
            (Engine::Podman, (user, _)) if user != 0 => add("--userns", "keep-id".to_owned()),
            (_, (user, group)) => add("--user", format!("{user}:{group}")),
        }
        for device in &self.devices {
            add("--device", device.display().to_string());
        }
        add("--name", self.name.clone());
        add("--env", "HOME=/tmp".to_owned());
        add("--env", format!("AVLN_SERVER=unix:{}", SandboxPlan::server_socket(Path::new(INSIDE)).display()));
        // Without a value: command lines are visible to other users, and the engine copies its own variable.
        add("--env", "AVLN_TOKEN".to_owned());
        arguments.push(self.image.clone());
        arguments.extend(self.command.iter().cloned());
        arguments
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn container() -> Container {
        Container {
            image: "ada/walker:3".to_owned(),
            command: vec!["python3".to_owned(), "play.py".to_owned()],
            name: "avln-run_1".to_owned(),
            folder: "/run/sandbox".into(),
            owner: (1001, 1002),
            memory_mib: Some(2048),
            devices: vec!["/dev/dri".into()],
            has_share: true,
        }
    }

    #[test]
    fn docker_arguments_restrict_the_container() {
        let expected = "run --rm --interactive=false --network none --read-only --cap-drop ALL --security-opt no-new-privileges \
             --pids-limit 4096 --oom-score-adj 1000 --cpu-shares 2 --memory 2048m --memory-swap 2048m \
             --tmpfs /tmp:rw,exec,nosuid,nodev,size=1g --volume /run/sandbox:/avln:ro --user 1001:1002 \
             --device /dev/dri --name avln-run_1 --env HOME=/tmp --env AVLN_SERVER=unix:/avln/arena.sock --env AVLN_TOKEN ada/walker:3 python3 play.py";
        assert_eq!(container().arguments(Engine::Docker).join(" "), expected);
    }

    #[test]
    fn memory_limit_is_reported_only_if_set() {
        let limits = |memory_mib| Container { memory_mib, ..container() }.report().enforced.split_off(6);
        let share = "lowest share of processor time";
        assert_eq!(limits(None), ["at most 4096 processes", share]);
        assert_eq!(limits(Some(2048)), ["at most 4096 processes", "memory limit of 2048 MiB", share]);
    }

    #[test]
    fn missing_share_is_reported_and_omitted() {
        let container = Container { has_share: false, ..container() };
        assert!(container.report().why("lowest share of processor time").is_some());
        assert!(!container.arguments(Engine::Podman).contains(&"--cpu-shares".to_owned()));
        assert!(Engine::Docker.has_shares(1001) && Engine::Podman.has_shares(0));
        assert!(!Engine::Podman.has_shares(u32::MAX), "no such user");
    }

    #[test]
    fn podman_without_root_keeps_the_owner() {
        let plain =
            Container { memory_mib: None, devices: vec![], command: vec![], has_share: false, ..container() };
        let expected = "run --rm --interactive=false --network none --read-only --cap-drop ALL --security-opt no-new-privileges \
             --pids-limit 4096 --oom-score-adj 1000 --tmpfs /tmp:rw,exec,nosuid,nodev,size=1g \
             --volume /run/sandbox:/avln:ro --userns keep-id --name avln-run_1 --env HOME=/tmp \
             --env AVLN_SERVER=unix:/avln/arena.sock --env AVLN_TOKEN ada/walker:3";
        assert_eq!(plain.arguments(Engine::Podman).join(" "), expected);
        let root = Container { owner: (0, 0), ..plain };
        assert!(root.arguments(Engine::Podman).join(" ").contains("--user 0:0"));
    }

    #[test]
    fn engines_are_found_in_the_path() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(Engine::find(folder.path().as_os_str()), None);
        std::fs::write(folder.path().join("docker"), "").unwrap();
        assert_eq!(Engine::find(folder.path().as_os_str()), Some(Engine::Docker));
        std::fs::write(folder.path().join("podman"), "").unwrap();
        assert_eq!(Engine::find(folder.path().as_os_str()), Some(Engine::Podman));
    }
}
