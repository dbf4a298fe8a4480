//! Instances to cues to missions to splits.
