//! A disk that can be full.

use std::{path::Path, process::Command};

/// A small disk, until it is dropped; `None` where this process may not make one.
pub struct Disk<'a>(&'a Path);

impl<'a> Disk<'a> {
    /// Mounts one of `size`, as `mount` takes it.
    pub fn mount(at: &'a Path, size: &str) -> Option<Self> {
        let mut mount = Command::new("mount");
        mount.args(["-t", "tmpfs", "-o", &format!("size={size}"), "tmpfs"]).arg(at);
        let mounted = mount.output().is_ok_and(|output| output.status.success());
        if !mounted {
            eprintln!("skipped: no small disk could be mounted; run as root, with mount from util-linux");
        }
        mounted.then_some(Self(at))
    }

    /// Leaves no room on it.
    pub fn fill(&self) {
        let filled = std::fs::write(self.0.join("filler"), vec![0; 512 << 20]);
        assert!(filled.is_err(), "the disk is small");
    }

    /// Makes room again.
    pub fn empty(&self) {
        std::fs::remove_file(self.0.join("filler")).expect("the filler");
    }
}

impl Drop for Disk<'_> {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("-l").arg(self.0).status();
    }
}
