/// Pairs each path with its text.
macro_rules! texts {
    ($($path:literal,)*) => { [$(($path, include_str!(concat!("../../../../../../", $path)))),*] };
}

/// Paths of the documents in the repository, those that participants need first, and their Markdown.
pub(super) const PATHS: [(&str, &str); 34] = texts![
    "docs/results.md",
    "docs/scoring.md",
    "docs/GLOSSARY.md",
    "docs/python.md",
    "proto/PROTOCOL.md",
    "docs/VERIFYING.md",
    "docs/CLI.md",
    "docs/DATASET.md",
    "docs/SCENES.md",
    "docs/HABITAT.md",
    "docs/acoustics.md",
    "docs/checking-sound.md",
    "docs/perception.md",
    "docs/models.md",
    "docs/traces.md",
    "docs/ORGANISING.md",
    "docs/OPERATING.md",
    "docs/performance.md",
    "docs/ARCHITECTURE.md",
    "docs/decisions/0001-stop-with-goals-left.md",
    "docs/decisions/0002-both-orders-from-one-episode.md",
    "docs/decisions/0003-rays-on-parrys-tree.md",
    "docs/decisions/0004-own-voxel-regions.md",
    "docs/decisions/0005-agents-as-processes-of-the-same-binary.md",
    "docs/decisions/0006-houses-are-arms-of-rooms.md",
    "docs/decisions/0007-noise-is-drawn-by-pixel.md",
    "docs/decisions/0008-light-is-baked.md",
    "docs/decisions/0009-one-crate-is-unsafe.md",
    "docs/decisions/0010-clips-tell-nothing.md",
    "docs/decisions/0011-runs-are-written-down.md",
    "docs/decisions/0012-time-that-is-nobodys.md",
    "docs/decisions/0013-backups-cut-logs.md",
    "docs/decisions/0014-traces-are-lines.md",
    "docs/decisions/0015-models-run-by-a-library-of-the-user.md",
];
