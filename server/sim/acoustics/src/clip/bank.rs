use super::{
    Clip,
    made::{self, CLIPS_PER_FAMILY},
};
use std::sync::Arc;

/// A share of the clips that are made by rule. Shares of training, validation and test have no clip in common, and each
/// family has clips in all three.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClipPool {
    /// All 100.
    All,
    /// 70 of them.
    Train,
    /// 15 others.
    Validation,
    /// The last 15.
    Test,
}

/// What clips are drawn from.
#[derive(Clone, Debug)]
pub struct Bank(Content);

#[derive(Clone, Debug)]
enum Content {
    /// Indices of clips that are made.
    Made(Arc<[usize]>),
    Own(Arc<[Clip]>),
}

impl Bank {
    /// The clips of `pool`: 6 s each, in ten families. A clip is made when it is first asked for, and kept.
    pub fn of(pool: ClipPool) -> Self {
        Self(Content::Made((0..made::COUNT).filter(|&index| pool.holds(index)).collect()))
    }

    /// A bank of `clips`, in their order.
    pub fn own(clips: Vec<Clip>) -> Self {
        Self(Content::Own(clips.into()))
    }

    /// How many clips it holds.
    pub fn len(&self) -> usize {
        match &self.0 {
            Content::Made(indices) => indices.len(),
            Content::Own(clips) => clips.len(),
        }
    }

    /// Whether it holds none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The clip at `index`; `None` when there is none.
    pub fn clip(&self, index: usize) -> Option<Clip> {
        match &self.0 {
            Content::Made(indices) => indices.get(index).map(|&index| made::clip(index).clone()),
            Content::Own(clips) => clips.get(index).cloned(),
        }
    }

    /// The names of all clips, in order; none is made for it.
    pub fn names(&self) -> Vec<String> {
        match &self.0 {
            Content::Made(indices) => indices.iter().map(|&index| made::name(index)).collect(),
            Content::Own(clips) => clips.iter().map(|clip| clip.name.clone()).collect(),
        }
    }

    /// All clips, in order.
    pub fn clips(&self) -> impl Iterator<Item = Clip> {
        (0..self.len()).filter_map(|index| self.clip(index))
    }
}

impl Default for Bank {
    /// [`ClipPool::All`].
    fn default() -> Self {
        Self::of(ClipPool::All)
    }
}

impl ClipPool {
    /// Whether the made clip at `index` is in it. Of ten clips of a family, seven are for training; the other three go to
    /// validation and test, the larger part to either in turn.
    fn holds(self, index: usize) -> bool {
        let (family, number) = (index / CLIPS_PER_FAMILY, index % CLIPS_PER_FAMILY);
        let validation_end = 8 + family % 2;
        match self {
            Self::All => true,
            Self::Train => number < 7,
            Self::Validation => (7..validation_end).contains(&number),
            Self::Test => number >= validation_end,
        }
    }
}
