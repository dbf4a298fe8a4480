//! Wide vector instructions and memory-mapped files: all `unsafe` code of servers and agents.
//!
//! The `README.md` of this crate contains the soundness arguments.
//!
//! This crate never contains knowledge about scenes or images.
//!
//! ```
//! use avln_simd::{Width, Work, run_at};
//!
//! struct Sum<'a>(&'a [f32]);
//!
//! impl Work for Sum<'_> {
//!     type Output = f32;
//!
//!     #[inline(always)]
//!     fn run(self) -> f32 {
//!         self.0.iter().sum()
//!     }
//! }
//!
//! assert_eq!(run_at(Width::Sixteen, Sum(&[1.0, 2.0, 3.5])), 6.5);
//! ```

use memmap2::Mmap;
use std::fs::File;
use std::io;
use std::path::Path;

/// A memory-mapped file, loaded on first access and shared between processes.
pub struct Mapped(Mmap);

impl Mapped {
    /// Maps the file at `path`, which must not be modified any more; it may be unlinked.
    ///
    /// # Errors
    /// If the file cannot be opened or mapped, for example an empty file.
    pub fn open(path: &Path) -> io::Result<Self> {
        let file = File::open(path)?;
        // SAFETY: callers guarantee that the content does not change while it is borrowed; see README.md.
        unsafe { Mmap::map(&file) }.map(Self)
    }
}

impl AsRef<[u8]> for Mapped {
    fn as_ref(&self) -> &[u8] {
        &self.0
    }
}

/// Lane count of vector instructions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Width {
    /// Baseline of the build target.
    Portable,
    /// Eight floats (AVX2, x86-64-v3), if the processor supports them.
    Eight,
    /// Sixteen floats and twice the registers (AVX-512, x86-64-v4), if the processor supports them.
    Sixteen,
}

/// A computation. All speed-critical functions, including this method, must be `#[inline(always)]`: code that
/// is called instead of inlined is not compiled for the wider instructions.
pub trait Work {
    /// Result type.
    type Output;
    /// Computes the result.
    fn run(self) -> Self::Output;
}

/// Runs `work` with vector instructions of at most `width`. All widths return equal bits.
#[inline]
pub fn run_at<W: Work>(width: Width, work: W) -> W::Output {
    #[cfg(target_arch = "x86_64")]
    {
        if width == Width::Sixteen && has_sixteen() {
            // SAFETY: the processor supports all instructions that the function is compiled for.
            return unsafe { run_sixteen(work) };
        }
        if width >= Width::Eight && has_eight() {
            // SAFETY: as above.
            return unsafe { run_eight(work) };
        }
    }
    let _ = width;
    work.run()
}

#[cfg(target_arch = "x86_64")]
fn has_eight() -> bool {
    // No cache here: the standard library detects the processor's features once.
    is_x86_feature_detected!("avx2")
        && is_x86_feature_detected!("bmi1")
        && is_x86_feature_detected!("bmi2")
        && is_x86_feature_detected!("lzcnt")
        && is_x86_feature_detected!("popcnt")
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn run_eight<W: Work>(work: W) -> W::Output {
    work.run()
}

#[cfg(target_arch = "x86_64")]
fn has_sixteen() -> bool {
    has_eight()
        && is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512bw")
        && is_x86_feature_detected!("avx512cd")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512vl")
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt,avx512f,avx512bw,avx512cd,avx512dq,avx512vl")]
fn run_sixteen<W: Work>(work: W) -> W::Output {
    work.run()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mapped_file_is_readable_after_unlink() {
        let folder = tempfile::tempdir().expect("a folder for temporary files");
        let path = folder.path().join("file");
        std::fs::write(&path, b"some bytes").expect("a file");
        let mapped = Mapped::open(&path).expect("a mapping");
        std::fs::remove_file(&path).expect("the file is there");
        assert_eq!(mapped.as_ref(), b"some bytes");
        assert!(Mapped::open(&path).is_err(), "it is gone");
    }

    struct Sum([f32; 64]);

    impl Work for Sum {
        type Output = f32;

        #[inline(always)]
        fn run(self) -> f32 {
            self.0.iter().map(|value| value * 1.1 + 0.3).sum()
        }
    }

    #[test]
    fn results_are_equal_at_every_width() {
        let values = std::array::from_fn(|i| (i as f32).sqrt());
        let portable = run_at(Width::Portable, Sum(values));
        for wide in [Width::Eight, Width::Sixteen] {
            assert_eq!(run_at(wide, Sum(values)).to_bits(), portable.to_bits(), "{wide:?}");
        }
    }
}
