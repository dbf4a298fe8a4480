//! The server's signature under the logs of runs that are over.

use ring::signature::{ED25519, Ed25519KeyPair, KeyPair, UnparsedPublicKey};
use std::{
    io::{self, Write},
    path::Path,
};
use tempfile::NamedTempFile;

/// Bytes of the secret from which the key is made.
const SEED_BYTES: usize = 32;

/// The server's Ed25519 key (RFC 8032).
pub struct SigningKey(Ed25519KeyPair);

impl SigningKey {
    /// The key in the file `path`, created if missing, readable by the owner only.
    ///
    /// # Errors
    /// If the file cannot be read or created, or does not contain exactly 32 bytes.
    pub fn at(path: &Path) -> io::Result<Self> {
        match std::fs::read(path) {
            Ok(seed) => Self::from_seed(&seed),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Self::make(path),
            Err(error) => Err(error),
        }
    }

    /// Creates a key atomically. If another program creates a key at the same time, the first one wins.
    fn make(path: &Path) -> io::Result<Self> {
        let mut seed = [0; SEED_BYTES];
        getrandom::fill(&mut seed).map_err(io::Error::other)?;
        let folder = path.parent().unwrap_or(Path::new("."));
        // Temporary files are readable by their owner only.
        let mut file = NamedTempFile::new_in(folder)?;
        file.write_all(&seed)?;
        file.as_file().sync_all()?;
        match file.persist_noclobber(path) {
            Ok(_) => Self::from_seed(&seed),
            Err(refused) if refused.error.kind() == io::ErrorKind::AlreadyExists => Self::at(path),
            Err(refused) => Err(refused.error),
        }
    }

    fn from_seed(seed: &[u8]) -> io::Result<Self> {
        let pair = Ed25519KeyPair::from_seed_unchecked(seed);
        let damaged = |_| io::Error::new(io::ErrorKind::InvalidData, "a signing key has 32 bytes");
        pair.map(Self).map_err(damaged)
    }

    /// The public half, hexadecimal.
    pub fn public(&self) -> String {
        hex(self.0.public_key().as_ref())
    }

    /// A signature over `head`, the digits of a log's last line, hexadecimal.
    pub fn sign(&self, head: &str) -> String {
        hex(self.0.sign(head.as_bytes()).as_ref())
    }
}

impl std::fmt::Debug for SigningKey {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("SigningKey").field(&self.public()).finish()
    }
}

/// Returns true if `signature` of `public` over `head` is valid; key and signature are hexadecimal.
pub fn is_signed(public: &str, head: &str, signature: &str) -> bool {
    let (Some(public), Some(signature)) = (bytes(public), bytes(signature)) else { return false };
    UnparsedPublicKey::new(&ED25519, public).verify(head.as_bytes(), &signature).is_ok()
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn bytes(hex: &str) -> Option<Vec<u8>> {
    let pairs = hex.as_bytes().chunks(2);
    pairs.map(|pair| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_kept_and_signs_the_same_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("signing.key");
        let (made, found) = (SigningKey::at(&path).unwrap(), SigningKey::at(&path).unwrap());
        let signature = made.sign("abc");
        assert_eq!(signature, found.sign("abc"));
        assert!(is_signed(&made.public(), "abc", &signature));
        assert!(!is_signed(&made.public(), "abd", &signature));
        assert!(!is_signed(&signature, "abc", &made.public()));
        assert!(!is_signed("é", "abc", "x"));
        std::fs::write(&path, b"short").unwrap();
        assert!(SigningKey::at(&path).unwrap_err().to_string().contains("32 bytes"));
    }

    #[test]
    fn programs_that_make_it_at_the_same_time_have_the_same() {
        for _ in 0..50 {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("signing.key");
            let key = || SigningKey::at(&path).unwrap().public();
            let keys = std::thread::scope(|scope| {
                let made = [(); 4].map(|()| scope.spawn(key));
                made.map(|made| made.join().unwrap())
            });
            assert!(keys.iter().all(|key| *key == keys[0]), "{keys:?}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn nobody_else_can_read_it() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("signing.key");
        SigningKey::at(&path).unwrap();
        assert_eq!(std::fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
    }
}
