//! A disk that can be full.

use std::{path::Path, process::Command};

/// A small file system, unmounted on drop.
pub struct Disk<'a>(&'a Path);

impl<'a> Disk<'a> {
    /// Mounts a file system with `size` in the syntax of `mount`; `None` without the privilege.
    pub fn mount(at: &'a Path, size: &str) -> Option<Self> {
        let mut mount = Command::new("mount");
        mount.args(["-t", "tmpfs", "-o", &format!("size={size}"), "tmpfs"]).arg(at);
        let mounted = mount.output().is_ok_and(|output| output.status.success());
        if !mounted {
            eprintln!("skipped: no small disk could be mounted; run as root, with mount from util-linux");
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
