//! Seeds of splits: numbers for practice, secrets for hidden splits.

use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error as _};
use std::fmt;

/// Origin of all random draws for a split.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Seed {
    /// A number, for practice: anyone can make the same split.
    Number(u64),
    /// A secret, for hidden phases.
    Secret(SplitSecret),
}

/// 256 random bits, the key of all draws for a hidden split.
#[derive(Clone, PartialEq, Eq)]
pub struct SplitSecret([u8; 32]);

impl SplitSecret {
    /// Returns the secret with these random bits.
    pub fn new(random: [u8; 32]) -> Self {
        Self(random)
    }

    /// Returns 64 bits for a label, by keyed BLAKE3: labels are independent, and no result reveals the secret.
    pub fn word(&self, label: &[&str]) -> u64 {
        let mut hasher = blake3::Hasher::new_keyed(&self.0);
        for part in label {
            // Lengths keep ("ab", "c") and ("a", "bc") apart.
            hasher.update(&(part.len() as u64).to_le_bytes()).update(part.as_bytes());
        }
        let [a, b, c, d, e, f, g, h, ..] = *hasher.finalize().as_bytes();
        u64::from_le_bytes([a, b, c, d, e, f, g, h])
    }
}

impl fmt::Debug for SplitSecret {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Secrets must not reach logs.
        formatter.write_str("SplitSecret")
    }
}

impl Serialize for SplitSecret {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&blake3::Hash::from_bytes(self.0).to_hex())
    }
}

impl<'de> Deserialize<'de> for SplitSecret {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let hash = blake3::Hash::from_hex(String::deserialize(deserializer)?);
        let hash = hash.map_err(|_| D::Error::custom("a secret has 64 hexadecimal digits"))?;
        Ok(Self(*hash.as_bytes()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn secrets_are_written_as_hexadecimal_digits() {
        let secret = SplitSecret::new([0xa7; 32]);
        let json = serde_json::to_string(&secret).expect("JSON");
        assert_eq!(json, format!("\"{}\"", "a7".repeat(32)));
        assert_eq!(serde_json::from_str::<SplitSecret>(&json).expect("a secret"), secret);
        for wrong in ["\"a7\"", "7", "null"] {
            assert!(serde_json::from_str::<SplitSecret>(wrong).is_err(), "{wrong}");
        }
        assert_eq!(format!("{secret:?}"), "SplitSecret");
    }

    #[test]
    fn labels_and_secrets_separate_all_draws() {
        let [one, two] = [1, 2].map(|byte| SplitSecret::new([byte; 32]));
        let words =
            [one.word(&["ab", "c"]), one.word(&["a", "bc"]), one.word(&["abc"]), two.word(&["ab", "c"])];
        for (index, word) in words.iter().enumerate() {
            assert!(!words[index + 1..].contains(word), "{index}");
        }
    }
}
