//! A split's hidden facts, and their search in recorded bytes.

use std::collections::{BTreeSet, HashMap};

/// Pictures and sound are noise, in which shorter patterns occur by chance.
const LONG_ENOUGH_FOR_NOISE: usize = 8;
/// Largest distance between a place's two coordinates in a message.
const NEAR_BYTES: usize = 16;

/// A fact in an encoding.
#[derive(Debug)]
struct HiddenFact {
    what: String,
    bytes: Vec<u8>,
    /// Bytes that must follow nearby for it to count.
    then: Vec<u8>,
}

/// Hidden facts in all their encodings.
#[derive(Debug, Default)]
pub struct HiddenFacts(Vec<HiddenFact>);

impl HiddenFacts {
    /// Adds a byte string.
    ///
    /// # Panics
    /// With fewer than four bytes, which occur by chance.
    pub fn bytes(&mut self, what: &str, bytes: impl AsRef<[u8]>) {
        let (what, bytes) = (what.to_owned(), bytes.as_ref().to_vec());
        assert!(bytes.len() >= 4, "{what} is long enough not to occur by chance");
        self.0.push(HiddenFact { what, bytes, then: vec![] });
    }

    /// Adds the truncated decimal text of a number, except round numbers and numbers up to 1, which occur by chance.
    pub fn text(&mut self, what: &str, value: f64) {
        let text = format!("{value:.6}");
        let cut = &text[..text.len() - 3];
        let decimals = &text[text.len() - 6..];
        if !decimals.ends_with("0000") && cut.len() >= 5 && value.abs() > 1.0 {
            self.bytes(&format!("{what} as text {cut}"), cut);
        }
    }

    /// Adds a length in metres, as text and in both binary forms.
    pub fn length(&mut self, what: &str, metres: f64) {
        self.text(what, metres);
        self.bytes(&format!("{what} as f64"), metres.to_le_bytes());
        self.bytes(&format!("{what} as f32"), (metres as f32).to_le_bytes());
    }

    /// Adds a share between 0 and 1, as text, as a rounded percentage and in binary form, except round shares.
    pub fn share(&mut self, what: &str, share: f64) {
        if (share * 1000.0).fract().abs() > 1e-6 {
            self.bytes(&format!("{what} as text"), share.to_string());
            self.bytes(&format!("{what} as a percentage"), format!("{:.1} %", share * 100.0));
            self.bytes(&format!("{what} as f64"), share.to_le_bytes());
        }
    }

    /// Adds a seed above 32 bits, as text and in both binary forms.
    pub fn seed(&mut self, what: &str, seed: u64) {
        let mut varint = Vec::new();
        let mut rest = seed;
        while rest > 0 {
            varint.push((rest & 0x7f) as u8 | if rest > 0x7f { 0x80 } else { 0 });
            rest >>= 7;
        }
        if seed > u64::from(u32::MAX) {
            self.bytes(&format!("{what} as text"), seed.to_string());
            self.bytes(&format!("{what} as u64"), seed.to_le_bytes());
            self.bytes(&format!("{what} as varint"), varint);
        }
    }

    /// Adds a floor position, metres: each coordinate as text, both together in binary forms.
    pub fn place(&mut self, what: &str, x: f32, z: f32) {
        self.text(&format!("{what} x"), x.into());
        self.text(&format!("{what} z"), z.into());
        let (single, double) = ([x, z].map(f32::to_le_bytes), [x, z].map(|m| f64::from(m).to_le_bytes()));
        let pair = |bytes: &[u8], then: &[u8], kind| HiddenFact {
            what: format!("{what} as {kind}"),
            bytes: bytes.to_vec(),
            then: then.to_vec(),
        };
        // Round numbers occur by chance in flat pictures.
        let is_round = |m: f32| (m * 64.0).fract() == 0.0;
        if !is_round(x) && !is_round(z) {
            self.0.push(pair(&single[0], &single[1], "f32"));
            self.0.push(pair(&double[0], &double[1], "f64"));
        }
    }

    /// Fact count.
    pub fn count(&self) -> usize {
        self.0.len()
    }

    /// Facts found in `bytes`.
    pub fn found_in(&self, bytes: &[u8]) -> BTreeSet<String> {
        let mut by_start = HashMap::<[u8; 4], Vec<&HiddenFact>>::new();
        for hidden_fact in &self.0 {
            by_start
                .entry(hidden_fact.bytes[..4].try_into().expect("four bytes"))
                .or_default()
                .push(hidden_fact);
        }
        let mut found = BTreeSet::new();
        for (at, start) in bytes.windows(4).enumerate() {
            let Some(facts) = start.first_chunk().and_then(|start| by_start.get(start)) else { continue };
            for hidden_fact in facts.iter().filter(|hidden_fact| hidden_fact.is_at(&bytes[at..])) {
                found.insert(hidden_fact.what.clone());
            }
        }
        found
    }

    /// Facts found in noise, where short patterns occur by chance.
    pub fn found_in_noise(&self, bytes: &[u8]) -> BTreeSet<String> {
        let mut found = self.found_in(bytes);
        let long = |c: &HiddenFact| c.bytes.len() + c.then.len() >= LONG_ENOUGH_FOR_NOISE;
        let long: BTreeSet<_> = self.0.iter().filter(|c| long(c)).map(|c| &c.what).collect();
        found.retain(|what| long.contains(what));
        found
    }
}

impl HiddenFact {
    fn is_at(&self, bytes: &[u8]) -> bool {
        let Some(rest) = bytes.strip_prefix(&self.bytes[..]) else { return false };
        let near = &rest[..rest.len().min(NEAR_BYTES)];
        self.then.is_empty() || near.windows(self.then.len()).any(|window| window == self.then)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_search_knows_every_form_of_a_secret() {
        let mut facts = HiddenFacts::default();
        facts.place("place", 1.234_567, -9.876_543);
        facts.seed("seed", 0x0123_4567_89ab_cdef);
        let near = [&1.234_567_f32.to_le_bytes()[..], &[0x1d], &(-9.876_543_f32).to_le_bytes()].concat();
        assert_eq!(facts.found_in(&near).into_iter().collect::<Vec<_>>(), ["place as f32"]);
        let far = [&1.234_567_f32.to_le_bytes()[..], &[0; 20], &(-9.876_543_f32).to_le_bytes()].concat();
        assert!(facts.found_in(&far).is_empty());
        assert_eq!(
            facts.found_in(b"at -9.87654 m").into_iter().collect::<Vec<_>>(),
            ["place z as text -9.876"]
        );
        assert_eq!(facts.found_in(b"81985529216486895").into_iter().collect::<Vec<_>>(), ["seed as text"]);
        let varint = [0xef, 0x9b, 0xaf, 0xcd, 0xf8, 0xac, 0xd1, 0x91, 0x01];
        assert_eq!(facts.found_in(&varint).into_iter().collect::<Vec<_>>(), ["seed as varint"]);
    }
}
