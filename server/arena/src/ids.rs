//! Random ids, tokens and secrets.

use crate::Failure;
use avln_dataset::SplitSecret;

/// Returns 128 random bits in hexadecimal.
pub fn random_hex() -> Result<String, getrandom::Error> {
    let mut bytes = [0_u8; 16];
    getrandom::fill(&mut bytes)?;
    Ok(hex::encode(bytes))
}

/// Returns a new secret for a split.
pub fn random_secret() -> Result<SplitSecret, Failure> {
    let mut bytes = [0_u8; 32];
    getrandom::fill(&mut bytes).map_err(Failure::internal)?;
    Ok(SplitSecret::new(bytes))
}

/// Returns a new token with a prefix by kind: `avln_account_…`, `avln_run_…`.
pub fn new_token(kind: &str) -> Result<String, getrandom::Error> {
    Ok(format!("avln_{kind}_{}{}", random_hex()?, random_hex()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_are_long_and_unique() {
        let (a, b) = (new_token("run").unwrap(), new_token("run").unwrap());
        assert_ne!(a, b);
        assert_eq!(a.len(), "avln_run_".len() + 64);
    }
}
