//! Challenge files, data folders, and damaged files of every kind.

mod challenge;
mod data_folder;
mod hall;
mod mangled;

/// Memory of this process: exclusive for tests that measure it.
static MEMORY: tokio::sync::RwLock<()> = tokio::sync::RwLock::const_new(());
