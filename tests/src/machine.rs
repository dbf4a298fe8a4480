//! The machine under the tests: files of the repository, optional programs, and a small disk.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::{env, fs};

/// Root folder.
pub fn root() -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("this crate lies in the repository");
    root.to_owned()
}

/// Files below `folder` with the given ending, without hidden folders, build outputs and installed packages.
pub fn files(folder: &Path, ending: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    collect(folder, ending, &mut found);
    found.sort();
    found
}

fn collect(folder: &Path, ending: &str, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a readable folder") {
        let path = entry.expect("a readable entry").path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let skipped = name.starts_with('.') || ["target", "node_modules"].contains(&name.as_str());
        if path.is_dir() && !skipped {
            collect(&path, ending, found);
        } else if path.is_file() && name.ends_with(ending) {
            found.push(path);
        }
    }
}

/// File text, by repository path.
pub fn text(path: impl AsRef<Path>) -> String {
    let path = root().join(path);
    fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// A path as messages show it.
pub fn shown(path: &Path) -> String {
    path.strip_prefix(root()).unwrap_or(path).display().to_string()
}

/// Commands in a document: lines after `$` in `console` blocks.
pub fn typed(document: &str) -> Vec<String> {
    let blocks = document.split("```").skip(1).step_by(2);
    let consoles = blocks.filter_map(|block| block.strip_prefix("console\n"));
    let lines = consoles.map(|code| code.replace("\\\n", " "));
    lines.flat_map(|code| code.lines().filter_map(in_console).collect::<Vec<_>>()).collect()
}

fn in_console(line: &str) -> Option<String> {
    line.strip_prefix("$ ").map(str::to_owned)
}

/// `never` turns skipped tests into failures, as in `.ci/run`.
const SKIP: &str = "AVLN_SKIP";

/// The `docker` program; `None` if `AVLN_DOCKER` is `none`, which skips the container tests on machines without an engine.
pub fn docker() -> Option<Command> {
    let program = env::var_os("AVLN_DOCKER").unwrap_or_else(|| "docker".into());
    (program != "none").then(|| Command::new(program))
}

/// Prints the skipped test and the install hint, also for `AVLN_SKIP=never`.
pub fn excluded(part: &str, remedy: &str) {
    // Not `eprintln!`, which the test harness hides.
    let _ = writeln!(std::io::stderr(), "skipped: {part}; {remedy}");
}

/// Prints the skipped test and the install hint.
///
/// # Panics
/// With `AVLN_SKIP=never`.
pub fn skipped(part: &str, remedy: &str) {
    let line = format!("skipped: {part}; {remedy}");
    assert!(env::var_os(SKIP).is_none_or(|skip| skip != "never"), "{SKIP} is never, but {line}");
    excluded(part, remedy);
}

/// Environment variable with the Python interpreter's path; by default `python3`.
const INTERPRETER: &str = "AVLN_PYTHON";

/// A Python command; `None` with the hint `remedy` if a module needed by `what` is missing.
pub fn python(what: &str, modules: &[&str], remedy: &str) -> Option<Command> {
    let python = env::var(INTERPRETER).unwrap_or_else(|_| "python3".to_owned());
    let import = format!("import {}", modules.join(", "));
    let mut probe = Command::new(&python);
    let found = probe.args(["-c", &import]).stderr(Stdio::null()).status();
    if !found.is_ok_and(|status| status.success()) {
        let remedy = format!("`{remedy}` brings them, or set {INTERPRETER} to a Python that has them");
        skipped(&format!("{what}, for {python} lacks one of {modules:?}"), &remedy);
        return None;
    }
    let mut command = Command::new(&python);
    command.env("PYTHONDONTWRITEBYTECODE", "1").stdin(Stdio::null());
    Some(command)
}

/// Runs a command and returns its standard output; panics with all output if it fails.
pub fn succeeds(what: &str, mut command: Command) -> String {
    let output = command.output().expect("the command starts");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{what}: {text}\n{}", String::from_utf8_lossy(&output.stderr));
    text
}

/// The module `avln.sim._native`, which Cargo builds next to the test program.
pub fn native_module() -> PathBuf {
    let folder = env::current_exe().expect("a path").parent().expect("a folder").to_owned();
    folder.join(format!("{}_native{}", env::consts::DLL_PREFIX, env::consts::DLL_SUFFIX))
}

/// A small file system, unmounted on drop.
pub struct Disk<'a>(&'a Path);

impl<'a> Disk<'a> {
    /// Mounts a file system with `size` in the syntax of `mount`; `None` without the privilege.
    pub fn mount(at: &'a Path, size: &str) -> Option<Self> {
        let mut mount = Command::new("mount");
        mount.args(["-t", "tmpfs", "-o", &format!("size={size}"), "tmpfs"]).arg(at);
        let mounted = mount.output().is_ok_and(|output| output.status.success());
        if !mounted {
            // Not a failure in `.ci/run`: containers that are root may not mount either.
            excluded("tests on a small disk", "run as root, with mount from util-linux");
        }
        mounted.then_some(Self(at))
    }

    /// Fills the disk.
    pub fn fill(&self) {
        let filled = std::fs::write(self.0.join("filler"), vec![0; 512 << 20]);
        assert!(filled.is_err(), "the disk is small");
    }

    /// Frees the space.
    pub fn empty(&self) {
        std::fs::remove_file(self.0.join("filler")).expect("the filler");
    }
}

impl Drop for Disk<'_> {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("-l").arg(self.0).status();
    }
}
