use std::cmp::Ordering;

/// A queue entry of a search (corner or polygon), ordered by cost, then by index.
#[derive(PartialEq)]
pub(crate) struct QueueEntry {
    pub(crate) metres: f64,
    pub(crate) number: u32,
}

impl Eq for QueueEntry {}

impl PartialOrd for QueueEntry {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for QueueEntry {
    fn cmp(&self, other: &Self) -> Ordering {
        self.metres.total_cmp(&other.metres).then(self.number.cmp(&other.number))
    }
}
