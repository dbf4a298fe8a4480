/// A seeded generator of repeatable random numbers (xoshiro256++, seeded by SplitMix64).
///
/// The stream of a seed never changes: scores and data sets depend on it.
/// Sources: Blackman and Vigna, "Scrambled linear pseudorandom number generators" (2021).
#[derive(Clone, Debug)]
pub struct Rng {
    state: [u64; 4],
}

impl Rng {
    /// The generator of `seed`.
    pub fn new(seed: u64) -> Self {
        let mut counter = seed;
        Self { state: std::array::from_fn(|_| split_mix(&mut counter)) }
    }

    /// An independent generator for the part of the work called `label`; the parent is not advanced.
    pub fn fork(&self, label: &str) -> Self {
        // FNV-1a over the label, mixed with the parent's state.
        let hash = label.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
        });
        Self::new(self.state[0].rotate_left(17) ^ self.state[2] ^ hash)
    }

    /// Returns the 64 random bits at `index` in the stream of `key` (SplitMix64), independent of all other
    /// draws.
    pub fn word(key: u64, index: u64) -> u64 {
        split_mix(&mut key.wrapping_add(index.wrapping_mul(GAMMA)))
    }

    /// 64 random bits.
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

    /// A number in [0, 1), uniform.
    pub fn unit(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 * (1.0 / (1_u64 << 53) as f64)
    }

    /// A number in [`low`, `high`), uniform.
    pub fn range(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit() as f32
    }

    /// An index below `count`, uniform.
    ///
    /// # Panics
    /// When `count` is 0.
    pub fn below(&mut self, count: usize) -> usize {
        assert!(count > 0, "cannot draw an index below 0");
        ((u128::from(self.next_u64()) * count as u128) >> 64) as usize
    }

    /// Returns true with probability `probability`.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    /// Returns a random element of `items`; `None` if empty.
    pub fn choose<'a, T>(&mut self, items: &'a [T]) -> Option<&'a T> {
        if items.is_empty() { None } else { Some(&items[self.below(items.len())]) }
    }

    /// Puts `items` into a random order (Fisher-Yates).
    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for last in (1..items.len()).rev() {
            items.swap(last, self.below(last + 1));
        }
    }
}

/// Increment of the SplitMix64 counter.
const GAMMA: u64 = 0x9e37_79b9_7f4a_7c15;

fn split_mix(counter: &mut u64) -> u64 {
    *counter = counter.wrapping_add(GAMMA);
    let mut z = *counter;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stream_of_a_seed_is_fixed() {
        // SplitMix64 of 0 begins with this word in the authors' reference implementation.
        assert_eq!(split_mix(&mut 0), 0xe220_a839_7b1d_cdaf);
        let (mut a, mut b) = (Rng::new(7), Rng::new(7));
        assert!((0..100).all(|_| a.next_u64() == b.next_u64()));
    }

    #[test]
    fn words_are_the_stream_of_their_key_in_any_order() {
        let mut counter = 77;
        let stream: Vec<u64> = (0..50).map(|_| split_mix(&mut counter)).collect();
        assert!((0..50).rev().all(|index| Rng::word(77, index) == stream[index as usize]));
    }

    #[test]
    fn forks_differ_by_label_and_leave_the_parent_alone() {
        let parent = Rng::new(1);
        assert_ne!(parent.fork("a").next_u64(), parent.fork("b").next_u64());
        assert_eq!(parent.fork("a").next_u64(), parent.fork("a").next_u64());
    }

    #[test]
    fn draws_stay_inside_their_bounds() {
        let mut rng = Rng::new(3);
        let mut seen = [0; 5];
        for _ in 0..1000 {
            seen[rng.below(5)] += 1;
            assert!((0.0..1.0).contains(&rng.unit()));
        }
        assert!(seen.iter().all(|&count| count > 120), "{seen:?}");
    }
}
