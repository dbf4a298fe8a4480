//! Split files encrypted with a passphrase.
//!
//! A sealed file replaces the plain file: [`MAGIC`], 16 bytes salt, 24 bytes nonce, and the text under
//! XChaCha20-Poly1305, bound to the file's name and folder. The key is derived by Argon2id from passphrase
//! and salt; all files sealed together share it. Plain text exists only in memory.

use crate::{Failure, lock};
use argon2::{Algorithm, Argon2, Params, Version};
use chacha20poly1305::{
    Key, KeyInit, XChaCha20Poly1305, XNonce,
    aead::{Aead, Payload},
};
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::{Mutex, OnceLock},
};

const MAGIC: &[u8] = b"avln sealed 1\n";
const SALT_BYTES: usize = 16;
const NONCE_BYTES: usize = 24;
/// Argon2id memory, passes and lanes: above the RFC 9106 values for small machines.
const MEMORY_KIB: u32 = 64 * 1024;
const PASSES: u32 = 3;
const LANES: u32 = 4;
/// Fewest letters and fewest different letters in a passphrase.
const LEAST_LETTERS: usize = 16;
const LEAST_DIFFERENT: usize = 8;
const COMMON_WORDS: &str =
    "password passphrase changeme secret letmein qwerty admin default example 12345 abcdef test";

const KEY_FILE: &str = "AVLN_SEAL_KEY_FILE";
const KEY: &str = "AVLN_SEAL_KEY";

/// A passphrase that is hard to guess.
pub struct Passphrase(String);

impl Passphrase {
    /// Trims a passphrase; rejects a short or repetitive one, or one that is mostly common words.
    pub fn new(words: &str) -> Result<Self, Failure> {
        let words = words.trim();
        let weak = |why: String| {
            Err(Failure::data(format!("the passphrase is too weak: {why}"))
                .hinted("make one with: head -c 24 /dev/urandom | base64"))
        };
        let mut different: Vec<char> = words.chars().collect();
        let count = different.len();
        different.sort_unstable();
        different.dedup();
        if count < LEAST_LETTERS || different.len() < LEAST_DIFFERENT {
            let found = format!("{count} letters, {} of them different", different.len());
            return weak(format!(
                "{found}; use at least {LEAST_LETTERS}, with {LEAST_DIFFERENT} different ones"
            ));
        }
        if is_repeated(words) {
            return weak("it repeats a shorter text".to_owned());
        }
        let mut rest = words.to_lowercase();
        for word in COMMON_WORDS.split(' ') {
            rest = rest.replace(word, "");
        }
        if rest.chars().count() < LEAST_LETTERS / 2 {
            return weak("it consists mostly of common words".to_owned());
        }
        Ok(Self(words.to_owned()))
    }

    /// Reads a passphrase file.
    pub fn of_file(path: &Path) -> Result<Self, Failure> {
        const LONGEST_BYTES: usize = 4096;
        let text = std::fs::read_to_string(path).map_err(|error| Failure::file("read", path, error))?;
        if text.len() > LONGEST_BYTES {
            let message = format!("{} has more than {LONGEST_BYTES} bytes", path.display());
            return Err(Failure::data(message).hinted("name a file with a passphrase only"));
        }
        Self::new(&text)
    }

    /// Reads the passphrase from `AVLN_SEAL_KEY_FILE` or `AVLN_SEAL_KEY`; `None` without either.
    pub fn of_environment() -> Result<Option<Self>, Failure> {
        if let Some(path) = std::env::var_os(KEY_FILE) {
            return Self::of_file(&PathBuf::from(path)).map(Some);
        }
        std::env::var(KEY).ok().map(|words| Self::new(&words)).transpose()
    }

    fn key(&self, salt: &[u8]) -> Result<Key, Failure> {
        let failed = |error: argon2::Error| Failure::internal(error);
        let params = Params::new(MEMORY_KIB, PASSES, LANES, Some(32)).map_err(failed)?;
        let mut key = [0; 32];
        let argon = Argon2::new(Algorithm::Argon2id, Version::V0x13, params);
        argon.hash_password_into(self.0.as_bytes(), salt, &mut key).map_err(failed)?;
        Ok(Key::from(key))
    }
}

fn is_repeated(words: &str) -> bool {
    let letters: Vec<char> = words.chars().collect();
    (1..=letters.len() / 2).any(|period| letters.iter().zip(&letters[period..]).all(|(a, b)| a == b))
}

pub(super) struct Keyring {
    passphrase: Option<Passphrase>,
    keys: Mutex<BTreeMap<Vec<u8>, Key>>,
}

impl Keyring {
    pub(super) fn new(passphrase: Option<Passphrase>) -> Self {
        Self { passphrase, keys: Mutex::default() }
    }

    /// Returns the keys for the environment's passphrase, read once.
    fn of_environment() -> Result<&'static Self, Failure> {
        static RING: OnceLock<Keyring> = OnceLock::new();
        if let Some(ring) = RING.get() {
            return Ok(ring);
        }
        let passphrase = Passphrase::of_environment()?;
        Ok(RING.get_or_init(|| Self::new(passphrase)))
    }

    /// Returns the key for a salt, derived once; `None` without a passphrase.
    fn key(&self, salt: &[u8]) -> Result<Option<Key>, Failure> {
        let Some(passphrase) = &self.passphrase else { return Ok(None) };
        let mut keys = lock(&self.keys);
        if let Some(key) = keys.get(salt) {
            return Ok(Some(*key));
        }
        // A derivation takes 64 MiB and noticeable time, so every salt is derived once.
        let key = passphrase.key(salt)?;
        keys.insert(salt.to_vec(), key);
        Ok(Some(key))
    }

    /// Decrypts the file `path`; plain `bytes` are returned unchanged.
    pub(super) fn open(&self, path: &Path, bytes: Vec<u8>) -> Result<Vec<u8>, Failure> {
        let Some(body) = bytes.strip_prefix(MAGIC) else { return Ok(bytes) };
        let refused = |message: &str| {
            Failure::data(format!("{} is sealed: {message}", path.display()))
                .hinted(format!("set {KEY_FILE} to the file with the passphrase, or {KEY} to the passphrase"))
        };
        let parts = body.split_at_checked(SALT_BYTES);
        let parts = parts.and_then(|(salt, body)| Some((salt, body.split_first_chunk::<NONCE_BYTES>()?)));
        let Some((salt, (nonce, body))) = parts else { return Err(refused("it is truncated")) };
        let Some(key) = self.key(salt)? else { return Err(refused("no passphrase is set")) };
        let place = place(path);
        let payload = Payload { msg: body, aad: place.as_bytes() };
        let plain = XChaCha20Poly1305::new(&key).decrypt(&XNonce::from(*nonce), payload);
        plain.map_err(|_| refused("wrong passphrase, or a changed file"))
    }

    pub(super) fn seal(&self, salt: &Salt, path: &Path, plain: &[u8]) -> Result<Vec<u8>, Failure> {
        let key = self.key(&salt.0)?;
        let key = key.ok_or_else(|| Failure::data("a passphrase is needed for sealing"))?;
        let mut nonce = [0; NONCE_BYTES];
        fill(&mut nonce)?;
        let place = place(path);
        // Folder and name are authenticated too, so that sealed files cannot be exchanged.
        let payload = Payload { msg: plain, aad: place.as_bytes() };
        let sealed = XChaCha20Poly1305::new(&key).encrypt(&XNonce::from(nonce), payload);
        let sealed = sealed.map_err(Failure::internal)?;
        Ok([MAGIC, &salt.0, &nonce, &sealed].concat())
    }
}

/// A salt for files sealed together.
pub(super) struct Salt([u8; SALT_BYTES]);

impl Salt {
    pub(super) fn random() -> Result<Self, Failure> {
        let mut salt = [0; SALT_BYTES];
        fill(&mut salt)?;
        Ok(Self(salt))
    }
}

fn fill(bytes: &mut [u8]) -> Result<(), Failure> {
    getrandom::fill(bytes).map_err(Failure::internal)
}

/// Returns a file's context: folder and name.
fn place(path: &Path) -> String {
    let name = |path: Option<&Path>| {
        path.and_then(Path::file_name).map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
    };
    format!("{}/{}", name(path.parent()), name(Some(path)))
}

pub(super) fn is_sealed(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// Decrypts the file `path` with the environment's passphrase; plain `bytes` are returned unchanged.
pub(super) fn opened(path: &Path, bytes: Vec<u8>) -> Result<Vec<u8>, Failure> {
    if is_sealed(&bytes) { Keyring::of_environment()?.open(path, bytes) } else { Ok(bytes) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weak_passphrases_are_refused_with_a_reason() {
        let cases = [
            ("short", "letters"),
            ("aaaaaaaabbbbbbbb", "different"),
            ("correct7horse8correct7horse8", "repeats"),
            ("password12345678", "common words"),
            ("ChangeMe-Secret-Admin", "common words"),
        ];
        for (words, why) in cases {
            let refused = Passphrase::new(words).err().expect(words).to_string();
            assert!(refused.contains(why) && !refused.contains(words), "{words}: {refused}");
        }
        assert!(Passphrase::new(" V3ry-l0ng.and/unlike+others \n").is_ok());
    }

    fn ring(words: &str) -> Keyring {
        Keyring::new(Some(Passphrase::new(words).expect("a good one")))
    }

    #[test]
    fn sealed_files_need_their_passphrase_and_path() {
        let own = ring("V3ry-l0ng.and/unlike+others");
        let (salt, path) = (Salt::random().expect("a salt"), Path::new("val/sealed/house.jsonl"));
        let seal = || own.seal(&salt, path, b"target 17").expect("sealed");
        let (first, second) = (seal(), seal());
        assert!(is_sealed(&first) && first != second, "no nonce comes twice");
        assert!(!first.windows(6).any(|window| window == b"target"));
        let plain = own.open(path, first.clone()).expect("the same passphrase and place");
        assert_eq!(plain, b"target 17");
        let refused = |ring: &Keyring, path: &str, bytes: Vec<u8>| {
            ring.open(Path::new(path), bytes).expect_err("refused").to_string()
        };
        let elsewhere = refused(&own, "val/missions/house.jsonl", first.clone());
        assert!(elsewhere.contains("changed"), "{elsewhere}");
        let other = refused(&ring("An0ther-long.and/good+one"), "val/sealed/house.jsonl", first.clone());
        assert!(other.contains("wrong passphrase"), "{other}");
        let none = refused(&Keyring::new(None), "val/sealed/house.jsonl", first.clone());
        assert!(none.contains("no passphrase") && none.contains(KEY_FILE), "{none}");
        for length in MAGIC.len()..first.len() {
            refused(&own, "val/sealed/house.jsonl", first[..length].to_vec());
        }
        let mut changed = first;
        *changed.last_mut().expect("bytes") ^= 1;
        refused(&own, "val/sealed/house.jsonl", changed);
        assert_eq!(own.open(path, b"plain".to_vec()).expect("not sealed"), b"plain");
    }
}
