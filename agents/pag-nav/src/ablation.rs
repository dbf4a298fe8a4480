/// Parts of [`PagNav`](crate::PagNav) that can be taken away, to see what they are worth. Nothing is, by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Ablation {
    /// It hears nothing: it searches by frontiers, grounds goals by sight alone, and takes every Submit for right where the
    /// rules tell no outcome.
    pub no_audio: bool,
    /// Rooms and things around a place say nothing of what is there.
    pub no_priors: bool,
    /// Things are forgotten when they leave the picture; one look is all that verification can ask for.
    pub no_memory: bool,
    /// A candidate needs no verification: it is submitted as soon as it is near and faced.
    pub no_gate: bool,
}
