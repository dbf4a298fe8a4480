//! Seeded random numbers.

/// A seeded random generator (xoshiro256++, seeded by SplitMix64).
///
/// A seed's stream never changes: scores and data sets depend on it. Sources: Blackman and Vigna, "Scrambled
/// linear pseudorandom number generators" (2021).
#[derive(Clone, Debug)]
pub struct Rng {
    state: [u64; 4],
}

impl Rng {
    /// Returns the generator for `seed`.
    pub fn new(seed: u64) -> Self {
        let mut words = SplitMix64::new(seed);
        Self { state: std::array::from_fn(|_| words.next_u64()) }
    }

    /// Returns an independent generator for the subtask `label`; the parent is not advanced.
    pub fn fork(&self, label: &str) -> Self {
        // FNV-1a over the label, mixed with the parent's state. Subtasks stay reproducible when others draw
        // more or fewer numbers.
        let hash = label.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
        });
        Self::new(self.state[0].rotate_left(17) ^ self.state[2] ^ hash)
    }

    /// Returns word `index` in the SplitMix64 stream for `key`, independent of other draws.
    pub fn word(key: u64, index: u64) -> u64 {
        SplitMix64::new(key.wrapping_add(index.wrapping_mul(SplitMix64::GAMMA))).next_u64()
    }

    /// Returns 64 random bits.
    pub fn next_u64(&mut self) -> u64 {
        let s = &mut self.state;
        let out = s[0].wrapping_add(s[3]).rotate_left(23).wrapping_add(s[0]);
        let t = s[1] << 17;
        s[2] ^= s[0];
        s[3] ^= s[1];
        s[1] ^= s[2];
        s[0] ^= s[3];
        s[2] ^= t;
        s[3] = s[3].rotate_left(45);
        out
    }

    /// Returns a uniform number in [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 * (1.0 / (1_u64 << 53) as f64)
    }

    /// Returns a uniform number in [`low`, `high`).
    pub fn range(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit() as f32
    }

    /// Returns a uniform index below `count`.
    ///
    /// # Panics
    /// If `count` is 0.
    pub fn below(&mut self, count: usize) -> usize {
        assert!(count > 0, "cannot draw an index below 0");
        ((u128::from(self.next_u64()) * count as u128) >> 64) as usize
    }

    /// Returns true with probability `probability`.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    /// Returns a random item; `None` if empty.
    pub fn choose<'a, T>(&mut self, items: &'a [T]) -> Option<&'a T> {
        if items.is_empty() { None } else { Some(&items[self.below(items.len())]) }
    }

    /// Shuffles `items` (Fisher-Yates).
    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for last in (1..items.len()).rev() {
            items.swap(last, self.below(last + 1));
        }
    }
}

/// SplitMix64 (Steele, Lea and Flood 2014), for seeds and for the resamples behind score intervals.
#[derive(Clone, Debug)]
pub struct SplitMix64(u64);

impl SplitMix64 {
    const GAMMA: u64 = 0x9e37_79b9_7f4a_7c15;

    /// Returns the generator for `seed`.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Returns 64 random bits.
    pub fn next_u64(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(Self::GAMMA);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Returns an index below `count`; 0 if `count` is 0.
    pub fn below(&mut self, count: usize) -> usize {
        ((u128::from(self.next_u64()) * count as u128) >> 64) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seed_streams_are_fixed() {
        // The first words of the authors' reference implementation.
        let mut words = SplitMix64::new(0);
        assert_eq!([words.next_u64(), words.next_u64()], [0xe220_a839_7b1d_cdaf, 0x6e78_9e6a_a1b9_65f4]);
        let (mut a, mut b) = (Rng::new(7), Rng::new(7));
        assert!((0..100).all(|_| a.next_u64() == b.next_u64()));
    }

    #[test]
    fn key_stream_is_independent_of_order() {
        let mut words = SplitMix64::new(77);
        let stream: Vec<u64> = (0..50).map(|_| words.next_u64()).collect();
        assert!((0..50).rev().all(|index| Rng::word(77, index) == stream[index as usize]));
    }

    #[test]
    fn forks_differ_by_label_without_advancing_the_parent() {
        let parent = Rng::new(1);
        assert_ne!(parent.fork("a").next_u64(), parent.fork("b").next_u64());
        assert_eq!(parent.fork("a").next_u64(), parent.fork("a").next_u64());
    }

    #[test]
    fn draws_stay_in_bounds() {
        let mut rng = Rng::new(3);
        let mut seen = [0; 5];
        for _ in 0..1000 {
            seen[rng.below(5)] += 1;
            assert!((0.0..1.0).contains(&rng.unit()));
        }
        assert!(seen.iter().all(|&count| count > 120), "{seen:?}");
    }
}
