//! Random ids, tokens and secrets.

use crate::Failure;
use avln_dataset::SplitSecret;
use std::sync::Arc;

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

/// A run id and a token.
#[derive(Clone, Debug)]
pub struct IssuedRun {
    /// Run id.
    pub run: String,
    /// Token for this run only.
    pub token: String,
}

impl IssuedRun {
    pub(crate) fn random() -> Result<Self, getrandom::Error> {
        Ok(Self { run: format!("run_{}", random_hex()?), token: new_token("run")? })
    }
}

/// Source of run ids: random by default, or a function for simulations.
#[derive(Clone, Default)]
pub(crate) struct RunIds(pub(crate) Option<Arc<dyn Fn() -> String + Send + Sync>>);

impl RunIds {
    /// Returns the next run's id, with a random token.
    pub(crate) fn next(&self) -> Result<IssuedRun, getrandom::Error> {
        let random = IssuedRun::random()?;
        Ok(match &self.0 {
            Some(name) => IssuedRun { run: name(), ..random },
            None => random,
        })
    }
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
