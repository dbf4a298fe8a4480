use std::cmp::Ordering;

/// A queue entry of a search (corner or polygon), ordered by cost, then by index.
#[derive(PartialEq)]
pub(crate) struct Waiting {
    pub(crate) metres: f64,
    pub(crate) number: u32,
}

impl Eq for Waiting {}

impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Waiting {
    fn cmp(&self, other: &Self) -> Ordering {
        self.metres.total_cmp(&other.metres).then(self.number.cmp(&other.number))
    }
}
