use std::path::{Path, PathBuf};

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
    /// The image.
    pub image: String,
    /// Program and arguments of the agent; empty: the default of the image.
    pub command: Vec<String>,
    /// Name for the container.
    pub name: String,
    /// Folder with the server's socket.
    pub folder: PathBuf,
    /// User and group that own the folder.
    pub owner: (u32, u32),
    /// Memory for all of the agent, MiB; `None`: any.
    pub memory_mib: Option<u32>,
    /// Devices that the agent may use.
    pub devices: Vec<PathBuf>,
}

/// Path of the folder inside the container.
const INSIDE: &str = "/avln";
/// Most processes and threads.
const PROCESSES: u32 = 4096;

impl Engine {
    /// Supported engines, preferred first.
    pub const ALL: [Self; 2] = [Self::Podman, Self::Docker];

    /// Name of the engine program.
    pub fn program(self) -> &'static str {
        match self {
            Self::Podman => "podman",
            Self::Docker => "docker",
        }
    }

    /// The first engine of which `path`, a list as in `PATH`, has the program.
    pub fn find(path: &std::ffi::OsStr) -> Option<Self> {
        let is_there =
            |engine: &Self| std::env::split_paths(path).any(|dir| dir.join(engine.program()).is_file());
        Self::ALL.into_iter().find(is_there)
    }

    /// Arguments that end a container at once.
    pub fn kill(name: &str) -> [&str; 2] {
        ["kill", name]
    }
}

impl Container {
    /// Enforced restrictions, for people.
    pub const ENFORCED: [&'static str; 6] = [
        "no network",
        "read-only root",
        "no capabilities",
        "no new privileges",
        "limits on processes and memory",
        "own processes, users and mounts by the container engine",
    ];

    /// Arguments of the engine's program. The token is not among them: it comes by the environment.
    pub fn arguments(&self, engine: Engine) -> Vec<String> {
        let mut arguments: Vec<String> =
            ["run", "--rm", "--interactive=false", "--network", "none", "--read-only"]
                .map(String::from)
                .into();
        let mut add = |flag: &str, value: String| arguments.extend([flag.to_owned(), value]);
        add("--cap-drop", "ALL".to_owned());
        add("--security-opt", "no-new-privileges".to_owned());
        add("--pids-limit", PROCESSES.to_string());
        if let Some(mib) = self.memory_mib {
            add("--memory", format!("{mib}m"));
            add("--memory-swap", format!("{mib}m"));
        }
        add("--tmpfs", "/tmp:rw,nosuid,nodev,size=1g".to_owned());
        add("--volume", format!("{}:{INSIDE}:ro", self.folder.display()));
        match (engine, self.owner) {
            (Engine::Podman, (user, _)) if user != 0 => add("--userns", "keep-id".to_owned()),
            (_, (user, group)) => add("--user", format!("{user}:{group}")),
        }
        for device in &self.devices {
            add("--device", device.display().to_string());
        }
        add("--name", self.name.clone());
        add("--env", "HOME=/tmp".to_owned());
        add("--env", format!("AVLN_SERVER=unix:{}", Self::socket().display()));
        add("--env", "AVLN_TOKEN".to_owned());
        arguments.push(self.image.clone());
        arguments.extend(self.command.iter().cloned());
        arguments
    }

    /// Path of the server socket inside the container.
    fn socket() -> PathBuf {
        crate::Plan::server_socket(Path::new(INSIDE))
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
            folder: "/run/cell".into(),
            owner: (1001, 1002),
            memory_mib: Some(2048),
            devices: vec!["/dev/dri".into()],
        }
    }

    #[test]
    fn docker_gets_everything_that_shuts_the_container() {
        let expected = "run --rm --interactive=false --network none --read-only --cap-drop ALL --security-opt no-new-privileges \
             --pids-limit 4096 --memory 2048m --memory-swap 2048m --tmpfs /tmp:rw,nosuid,nodev,size=1g \
             --volume /run/cell:/avln:ro --user 1001:1002 --device /dev/dri --name avln-run_1 --env HOME=/tmp \
             --env AVLN_SERVER=unix:/avln/arena.sock --env AVLN_TOKEN ada/walker:3 python3 play.py";
        assert_eq!(container().arguments(Engine::Docker).join(" "), expected);
    }

    #[test]
    fn podman_without_root_keeps_the_owner_and_no_memory_limit_is_made_up() {
        let plain = Container { memory_mib: None, devices: vec![], command: vec![], ..container() };
        let expected = "run --rm --interactive=false --network none --read-only --cap-drop ALL --security-opt no-new-privileges \
             --pids-limit 4096 --tmpfs /tmp:rw,nosuid,nodev,size=1g --volume /run/cell:/avln:ro --userns keep-id \
             --name avln-run_1 --env HOME=/tmp --env AVLN_SERVER=unix:/avln/arena.sock --env AVLN_TOKEN ada/walker:3";
        assert_eq!(plain.arguments(Engine::Podman).join(" "), expected);
        let root = Container { owner: (0, 0), ..plain };
        assert!(root.arguments(Engine::Podman).join(" ").contains("--user 0:0"));
    }

    #[test]
    fn engines_are_found_where_the_path_has_them() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(Engine::find(folder.path().as_os_str()), None);
        std::fs::write(folder.path().join("docker"), "").unwrap();
        assert_eq!(Engine::find(folder.path().as_os_str()), Some(Engine::Docker));
        std::fs::write(folder.path().join("podman"), "").unwrap();
        assert_eq!(Engine::find(folder.path().as_os_str()), Some(Engine::Podman));
    }
}
