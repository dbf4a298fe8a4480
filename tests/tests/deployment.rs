//! Containers, Compose, systemd units and releases.

/// Scripts and commands of the compose file, in order, without an engine.
mod containers {
    use avln_tests::{
        Server,
        machine::{root, text},
        share_cache,
    };
    use std::{
        collections::BTreeSet,
        fs::{self, File},
        os::unix::{fs::symlink, process::CommandExt},
        path::{Path, PathBuf},
        process::{Child, Command},
        time::{Duration, Instant, SystemTime},
    };
    use tempfile::TempDir;
    use yaml_rust2::YamlLoader;

    const PROGRAM: &str = env!("CARGO_BIN_EXE_avln_under_test");
    /// Script folder in images.
    const SCRIPTS: &str = "/usr/local/lib/avln";
    const PATIENCE: Duration = Duration::from_secs(60);

    /// A container's folder.
    struct Container {
        folder: TempDir,
    }

    impl Container {
        fn new() -> Self {
            let folder = TempDir::new().expect("a folder");
            fs::create_dir(folder.path().join("bin")).expect("a folder");
            symlink(PROGRAM, folder.path().join("bin/avln")).expect("a link");
            Self { folder }
        }

        fn path(&self, name: &str) -> PathBuf {
            self.folder.path().join(name)
        }

        /// A command with the image's path and data folder.
        fn command(&self, words: &[String]) -> Command {
            let local = |word: &String| word.replace(SCRIPTS, &root().join("docker").display().to_string());
            let words: Vec<String> = words.iter().map(local).collect();
            let path = std::env::var("PATH").unwrap_or_default();
            let mut command = Command::new(&words[0]);
            command.args(&words[1..]).env("PATH", format!("{}:{path}", self.path("bin").display()));
            command.env("AVLN_DATA", self.path("data")).env_remove("AVLN_TOKEN").env_remove("AVLN_CA");
            command.env("AVLN_TOKEN_FILE", self.path("token"));
            command
        }

        fn succeeds(&self, mut command: Command) -> String {
            let output = command.output().expect("it starts");
            let text = String::from_utf8_lossy(&output.stdout).into_owned();
            assert!(
                output.status.success(),
                "{command:?}: {text}{}",
                String::from_utf8_lossy(&output.stderr)
            );
            text
        }
    }

    /// A service's command in the compose file.
    fn command_of(service: &str) -> Vec<String> {
        let documents = YamlLoader::load_from_str(&text("docker/compose.yaml")).expect("YAML");
        let command = documents[0]["services"][service]["command"].as_vec().expect("words");
        command.iter().map(|word| word.as_str().expect("a word").to_owned()).collect()
    }

    /// The agent image's entry point.
    fn entry() -> String {
        let file = text("docker/agents.Dockerfile");
        let entry = file.lines().find_map(|line| line.strip_prefix("ENTRYPOINT [\"")).expect("an entry");
        entry.trim_end_matches("\"]").to_owned()
    }

    #[test]
    fn trial_setup_runs_once_for_its_agent() {
        let container = Container::new();
        share_cache(&container.path("data"));
        let setup = || container.succeeds(container.command(&command_of("trial-setup")));
        assert!(setup().contains("phase practice is open"));
        let token = fs::read_to_string(container.path("token")).expect("a token");
        assert!(setup().is_empty(), "a second start finds it");
        assert_eq!(fs::read_to_string(container.path("token")).expect("a token"), token);

        let server = Server::start(PROGRAM, &container.path("data"));
        let words = [vec![entry()], command_of("trial-random")].concat();
        let mut agent = container.command(&words);
        agent.env("AVLN_SERVER", format!("http://{}", server.grpc));
        assert!(container.succeeds(agent).contains("6 of 6 episodes, complete"));
    }

    /// Backups in `folder`.
    fn backups(folder: &Path) -> BTreeSet<PathBuf> {
        let files = fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path());
        files.filter(|file| file.extension().is_some_and(|end| end == "tar")).collect()
    }

    fn wait(what: &str, until: impl Fn() -> bool) {
        let begun = Instant::now();
        while !until() {
            assert!(begun.elapsed() < PATIENCE, "not within {PATIENCE:?}: {what}");
            std::thread::sleep(Duration::from_millis(100));
        }
    }

    /// Ends a script and its children.
    fn end(mut script: Child) {
        let group = format!("-{}", script.id());
        assert!(Command::new("kill").args(["-KILL", "--", &group]).status().expect("kill").success());
        script.wait().expect("it is gone");
    }

    #[test]
    fn the_latest_backups_are_kept() {
        let container = Container::new();
        let words = |line: &str| line.split(' ').map(str::to_owned).collect::<Vec<_>>();
        container.succeeds(container.command(&words("avln challenge team add Ada")));
        let folder = container.path("backups");
        fs::create_dir(&folder).expect("a folder");
        let start = |keep: &str| {
            let mut script = container.command(&command_of("challenge-backup"));
            script.env("BACKUPS", &folder).env("KEEP", keep).process_group(0);
            script.spawn().expect("it starts")
        };
        let yesterday = SystemTime::now() - Duration::from_secs(86_400);
        let mut known = BTreeSet::new();
        for _ in 0..3 {
            for file in backups(&folder) {
                File::open(file).and_then(|file| file.set_modified(yesterday)).expect("our file");
            }
            let script = start("2");
            wait("a backup is made", || !backups(&folder).is_subset(&known));
            known.extend(backups(&folder));
            wait("what is too old goes", || backups(&folder).len() <= 2);
            // File names have a resolution of a second.
            std::thread::sleep(Duration::from_secs(1));
            end(script);
        }
        assert_eq!(known.len(), 3, "{known:?}");
        assert!(backups(&folder).iter().eq(known.iter().skip(1)), "{known:?}");
        let script = start("1");
        wait("the older backup goes", || backups(&folder).len() == 1);
        end(script);
        let newest = known.last().expect("a backup");
        assert!(backups(&folder).contains(newest), "a restart on the same day adds none");
        let restored = container.path("restored");
        let mut restore = container.command(&words("avln data db restore"));
        restore.arg(newest).env("AVLN_DATA", &restored);
        assert!(container.succeeds(restore).contains("1 teams"));
    }
}

/// Privileges of containers; a sealed agent reaches only its server.
mod packages {
    use avln_tests::machine::{docker, excluded, root, skipped, text};
    use std::process::{Command, Output};
    use yaml_rust2::{Yaml, YamlLoader, yaml::Hash};

    const PROFILES: [&str; 3] = ["trial", "challenge", "sealed"];

    /// A mapping with resolved `<<` keys; own keys have priority.
    fn merged(value: &Yaml) -> Yaml {
        match value {
            Yaml::Hash(entries) => {
                let key = Yaml::String("<<".into());
                let base = entries.get(&key).map(merged);
                let mut whole = base.map_or_else(Hash::new, |base| base.into_hash().expect("a mapping"));
                for (name, value) in entries.iter().filter(|(name, _)| **name != key) {
                    whole.replace(name.clone(), merged(value));
                }
                Yaml::Hash(whole)
            }
            Yaml::Array(list) => Yaml::Array(list.iter().map(merged).collect()),
            other => other.clone(),
        }
    }

    fn compose() -> Yaml {
        let documents = YamlLoader::load_from_str(&text("docker/compose.yaml")).expect("YAML");
        assert_eq!(documents.len(), 1);
        merged(&documents[0])
    }

    /// Mapping entries; empty if absent.
    fn entries(value: &Yaml) -> Vec<(String, Yaml)> {
        let entries = value.as_hash().into_iter().flatten();
        entries.map(|(name, value)| (name.as_str().expect("a name").to_owned(), value.clone())).collect()
    }

    /// List items; empty if absent.
    fn words(value: &Yaml) -> Vec<&str> {
        value.as_vec().into_iter().flatten().map(|word| word.as_str().expect("a word")).collect()
    }

    fn services() -> Vec<(String, Yaml)> {
        let services = entries(&compose()["services"]);
        assert!(services.len() > 5, "{services:?}");
        services
    }

    fn service(name: &str) -> Yaml {
        compose()["services"][name].clone()
    }

    fn is_agent(service: &Yaml) -> bool {
        service["image"].as_str().expect("an image").contains("avln-agents")
    }

    #[test]
    fn each_container_may_do_next_to_nothing() {
        for (name, service) in services() {
            assert_eq!(service["user"].as_str(), Some("10001:10001"), "{name}");
            assert_eq!(service["read_only"].as_bool(), Some(true), "{name}");
            assert_eq!(words(&service["cap_drop"]), ["ALL"], "{name}");
            assert_eq!(words(&service["security_opt"]), ["no-new-privileges=true"], "{name}");
            assert!(service["pids_limit"].as_i64().is_some_and(|limit| limit > 0), "{name}");
            for wider in ["privileged", "cap_add", "devices", "pid", "ipc", "userns_mode", "volumes_from"] {
                assert!(service[wider].is_badvalue(), "{name}: {wider}");
            }
            let network = service["network_mode"].as_str();
            assert!(network.is_none() || network == Some("none"), "{name}: {network:?}");
            assert!(words(&service["volumes"]).iter().all(|volume| !volume.contains(".sock")), "{name}");
        }
    }

    #[test]
    fn service_names_start_with_profile() {
        for (name, service) in services() {
            let [profile] = words(&service["profiles"])[..] else { panic!("{name} is of one profile") };
            assert!(PROFILES.contains(&profile) && name.starts_with(&format!("{profile}-")), "{name}");
            for (other, _) in entries(&service["depends_on"]) {
                assert!(other.starts_with(&format!("{profile}-")), "{name} waits for {other}");
            }
        }
    }

    #[test]
    fn services_wait_for_healthy_server() {
        assert!(text("docker/server.Dockerfile").contains("HEALTHCHECK"));
        for profile in PROFILES {
            let server = format!("{profile}-server");
            assert!(service(&server)["healthcheck"].is_badvalue(), "{server} has that of its image");
            let waits = |(_, service): &(String, Yaml)| {
                service["depends_on"][server.as_str()]["condition"].as_str() == Some("service_healthy")
            };
            assert!(services().iter().any(waits), "something waits for {server}");
        }
        for (name, service) in services().iter().filter(|(_, service)| is_agent(service)) {
            let profile = words(&service["profiles"])[0];
            let waits_for = |other: &str| service["depends_on"][other]["condition"].as_str();
            let is_ready = waits_for(&format!("{profile}-server")) == Some("service_healthy");
            assert!(is_ready || waits_for("sealed-check") == Some("service_healthy"), "{name}");
        }
    }

    #[test]
    fn a_sealed_agent_reaches_nothing_but_its_server() {
        let agent = service("sealed-agent");
        assert_eq!(words(&agent["networks"]), ["sealed"]);
        for way in ["ports", "volumes", "secrets", "configs", "extra_hosts", "dns", "links", "network_mode"] {
            assert!(agent[way].is_badvalue(), "{way}");
        }
        let network = &compose()["networks"]["sealed"];
        assert_eq!(network["internal"].as_bool(), Some(true));
        for mode in ["gateway_mode_ipv4", "gateway_mode_ipv6"] {
            let gateway = &network["driver_opts"][format!("com.docker.network.bridge.{mode}").as_str()];
            assert_eq!(gateway.as_str(), Some("isolated"), "{mode}");
        }
        let inside = |(_, service): &(String, Yaml)| words(&service["networks"]).contains(&"sealed");
        let inside: Vec<_> = services().into_iter().filter(inside).map(|(name, _)| name).collect();
        assert_eq!(inside, ["sealed-server", "sealed-check", "sealed-agent"]);
        let server = service("sealed-server");
        assert_eq!(words(&server["networks"]), ["sealed"]);
        assert!(words(&server["command"]).contains(&"127.0.0.1:8080"), "only the gRPC server is reachable");
    }

    #[test]
    fn agents_are_kept_from_the_truth() {
        let agents: Vec<_> = services().into_iter().filter(|(_, service)| is_agent(service)).collect();
        assert_eq!(agents.len(), 3, "{agents:?}");
        for (name, agent) in agents {
            let volumes = words(&agent["volumes"]);
            assert!(volumes.is_empty() || volumes == ["trial-token:/token:ro"], "{name}: {volumes:?}");
        }
    }

    #[test]
    fn plain_text_is_for_this_machine() {
        for (name, service) in services() {
            let secure = !service["environment"]["AVLN_TLS_CERT"].is_badvalue();
            for port in words(&service["ports"]) {
                assert!(secure || port.starts_with("127.0.0.1:${"), "{name}: {port}");
            }
        }
        let challenge = service("challenge-server");
        assert_eq!(words(&challenge["ports"]).len(), 2);
        assert!(challenge["environment"]["AVLN_ALLOW_PLAIN_TEXT"].is_badvalue());
    }

    #[test]
    fn secrets_come_from_files() {
        let known = compose();
        for (name, service) in services() {
            let secrets = words(&service["secrets"]);
            assert!(secrets.iter().all(|secret| !known["secrets"][*secret]["file"].is_badvalue()), "{name}");
            for (variable, value) in entries(&service["environment"]) {
                let value = value.as_str().expect("a text");
                if let Some(secret) = value.strip_prefix("/run/secrets/") {
                    assert!(secrets.contains(&secret), "{name}: {variable}");
                }
                let is_token = variable == "AVLN_TOKEN";
                assert!(!is_token || value == "${AVLN_TOKEN:-}", "{name}: a token in the file");
            }
            for volume in words(&service["volumes"]) {
                let source = volume.split(':').next().unwrap_or_default();
                assert!(
                    source.starts_with("./") || !known["volumes"][source].is_badvalue(),
                    "{name}: {volume}"
                );
            }
        }
    }

    #[test]
    fn images_run_as_unprivileged_user() {
        for image in ["docker/server.Dockerfile", "docker/agents.Dockerfile"] {
            let file = text(image);
            assert!(file.contains("    docker/build.sh /built\n"), "{image}");
            assert!(!file.contains("cargo build"), "{image}");
            let user = file.lines().rev().find_map(|line| line.strip_prefix("USER "));
            assert_eq!(user, Some("10001:10001"), "{image}");
            // Fixed modes: a clone may have been made under a umask that keeps files from other users.
            assert!(!file.contains("COPY docker/"), "{image}: a script without --chmod");
            let copied = file.lines().filter_map(|line| line.strip_prefix("COPY --chmod=755 docker/"));
            let copied: Vec<_> =
                copied.flat_map(str::split_whitespace).filter(|word| !word.starts_with('/')).collect();
            assert!(!copied.is_empty(), "{image}");
            for script in copied {
                let script = root().join("docker").join(script.trim_start_matches("docker/"));
                assert!(script.is_file(), "{image}: {}", script.display());
            }
        }
        let compose = compose();
        for (name, service) in entries(&compose["services"]) {
            if let Some(file) = service["build"]["dockerfile"].as_str() {
                assert!(root().join(file).is_file(), "{name}: {file}");
            }
        }
    }

    #[test]
    fn every_command_has_manual_and_completions() {
        let folder = tempfile::TempDir::new().expect("a folder for temporary files");
        let program = env!("CARGO_BIN_EXE_avln_under_test");
        let output = Command::new(program).arg("manual").arg(folder.path()).output().expect("it starts");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        for line in text("docs/CLI.md").lines().filter_map(|line| line.strip_prefix("## avln")) {
            let page = folder.path().join("man1").join(format!("avln{}.1", line.replace(' ', "-")));
            assert!(page.is_file(), "{}", page.display());
        }
        for file in ["avln.bash", "_avln", "avln.fish"] {
            let completions = std::fs::read_to_string(folder.path().join("completions").join(file));
            assert!(completions.is_ok_and(|text| text.contains("pag-nav")), "{file}");
        }
    }

    /// Docker Compose 2, the plugin; the program `docker-compose` 1 cannot read the file.
    fn installed_compose() -> Option<Command> {
        let compose = || {
            let mut docker = docker()?;
            docker.arg("compose");
            Some(docker)
        };
        let version = compose()?.arg("version").output().ok()?;
        version.status.success().then(compose).flatten()
    }

    fn services_of_profile(mut compose: Command, profile: &str) -> Output {
        compose.arg("--file").arg(root().join("docker/compose.yaml"));
        compose.args(["--profile", profile, "config", "--services"]);
        compose.output().expect("Compose starts")
    }

    #[test]
    fn compose_reads_each_profile() {
        for profile in PROFILES {
            let (test, remedy) = ("compose_reads_each_profile", "install Docker with Compose 2");
            let Some(compose) = installed_compose() else {
                return if docker().is_none() { excluded(test, remedy) } else { skipped(test, remedy) };
            };
            let output = services_of_profile(compose, profile);
            let names = String::from_utf8_lossy(&output.stdout).into_owned();
            assert!(output.status.success(), "{profile}: {}", String::from_utf8_lossy(&output.stderr));
            let of_profile = names.lines().filter(|name| name.starts_with(profile)).count();
            assert!(of_profile > 1, "{profile}: {names}");
        }
    }
}

/// Published files: every job that uploads attests its files, and a release key signs the digests.
mod releases {
    use avln_tests::machine::{skipped, text};
    use std::{collections::BTreeMap, fs, process::Command};
    use yaml_rust2::{Yaml, YamlLoader};

    const ATTEST: &str = "actions/attest-build-provenance@";

    /// Jobs of the release workflow.
    fn jobs() -> BTreeMap<String, Yaml> {
        let documents = YamlLoader::load_from_str(&text(".github/workflows/release.yml")).expect("YAML");
        let jobs = documents[0]["jobs"].as_hash().expect("jobs").iter();
        jobs.map(|(name, job)| (name.as_str().expect("a name").to_owned(), job.clone())).collect()
    }

    /// Actions and commands of a job's steps, in order.
    fn steps(job: &Yaml) -> Vec<(String, Yaml)> {
        let action = |step: &Yaml| step["uses"].as_str().or(step["run"].as_str()).expect("a step").to_owned();
        job["steps"].as_vec().expect("steps").iter().map(|step| (action(step), step.clone())).collect()
    }

    /// True if a step hands files or images to others.
    fn uploads(action: &str) -> bool {
        ["actions/upload-artifact@", "docker/build-push-action@", "gh release create"]
            .iter()
            .any(|word| action.contains(word))
    }

    #[test]
    fn uploading_jobs_attest_their_files() {
        let mut uploading = Vec::new();
        for (name, job) in jobs() {
            let steps = steps(&job);
            if !steps.iter().any(|(action, _)| uploads(action)) {
                continue;
            }
            let attests = steps.iter().any(|(action, _)| action.starts_with(ATTEST));
            assert!(attests, "job {name} uploads without attestation");
            for permission in ["id-token", "attestations"] {
                let granted = job["permissions"][permission].as_str();
                assert_eq!(granted, Some("write"), "job {name}: {permission}");
            }
            uploading.push(name);
        }
        assert_eq!(uploading, ["images", "linux", "macos", "publish", "python"]);
    }

    #[test]
    fn attestations_cover_all_published_files() {
        let jobs = jobs();
        let subject = |job: &str| {
            let steps = steps(&jobs[job]);
            let attest = steps.iter().find(|(action, _)| action.starts_with(ATTEST)).expect("a step");
            attest.1["with"]["subject-path"].as_str().expect("files").to_owned()
        };
        for job in ["linux", "macos", "python"] {
            assert_eq!(subject(job), "dist/*", "{job}");
        }
        let published = subject("publish");
        assert_eq!(
            published.split_whitespace().collect::<Vec<_>>(),
            ["release/*.json", "release/SHA256SUMS"]
        );
    }

    #[test]
    fn release_key_signature_can_be_verified() {
        let script = text("packaging/dist.sh");
        let line = script.lines().find(|line| line.contains("pkeyutl -sign")).expect("a signature");
        let folder = tempfile::TempDir::new().expect("a folder for temporary files");
        fs::create_dir(folder.path().join("dist")).expect("a folder");
        fs::write(folder.path().join("dist/SHA256SUMS"), "00  a.tar.gz\n").expect("a file");
        let page = text("docs/deploying.md");
        let verify = page.lines().find(|line| line.contains("pkeyutl -verify")).expect("its check");
        let verify = verify.trim_start_matches("$ ");
        let shell = |script: &str| {
            let mut shell = Command::new("sh");
            shell.args(["-euc", script]).current_dir(folder.path()).env("AVLN_RELEASE_KEY", "release.pem");
            shell.output().expect("a shell")
        };
        let made = shell(&format!(
            "openssl genpkey -algorithm ED25519 -out release.pem
             openssl pkey -in release.pem -pubout -out dist/release-key.pem
             {line}
             cd dist && {verify}"
        ));
        if made.status.code() == Some(127) {
            return skipped("release_key_signature_can_be_verified", "install openssl");
        }
        assert!(made.status.success(), "{made:?}");
        let changed = shell(&format!("cd dist && echo more >>SHA256SUMS && {verify}"));
        assert!(!changed.status.success(), "{changed:?}");
    }
}
