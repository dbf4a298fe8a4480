use super::{
    Clip,
    made::{self, CLIPS_PER_FAMILY},
};
use std::sync::Arc;

/// A share of the synthesised clips. The shares for training, validation and test are disjoint, and every
/// family has clips in all three.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClipPool {
    /// All 100.
    All,
    /// 70 clips.
    Train,
    /// 15 further clips.
    Validation,
    /// The remaining 15.
    Test,
}

/// A set of clips to draw from.
#[derive(Clone, Debug)]
pub struct Bank(Content);

#[derive(Clone, Debug)]
enum Content {
    /// Indices of synthesised clips.
    Made(Arc<[usize]>),
    Own(Arc<[Clip]>),
}

impl Bank {
    /// Returns the clips of `pool`: 6 s long, in ten families. A clip is synthesised on first use and cached.
    pub fn of(pool: ClipPool) -> Self {
        Self(Content::Made((0..made::COUNT).filter(|&index| pool.holds(index)).collect()))
    }

    /// A bank of `clips`, in their order.
    pub fn own(clips: Vec<Clip>) -> Self {
        Self(Content::Own(clips.into()))
    }

    /// Number of clips.
    pub fn len(&self) -> usize {
        match &self.0 {
            Content::Made(indices) => indices.len(),
            Content::Own(clips) => clips.len(),
        }
    }

    /// Returns true if the bank is empty.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the clip at `index`; `None` if out of range.
    pub fn clip(&self, index: usize) -> Option<Clip> {
        match &self.0 {
            Content::Made(indices) => indices.get(index).map(|&index| made::clip(index).clone()),
            Content::Own(clips) => clips.get(index).cloned(),
        }
    }

    /// Names of all clips, in order, without synthesis.
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
    /// Returns true if the pool contains the synthesised clip at `index`. Of ten clips per family, seven are
    /// for training; validation and test share the other three, with the larger part in turn.
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
