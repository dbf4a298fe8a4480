//! Tokens and handles from the system's random source.

/// 128 random bits in hexadecimal.
///
/// # Errors
/// When the system has no randomness to give.
pub fn random_hex() -> Result<String, getrandom::Error> {
    let mut bytes = [0_u8; 16];
    getrandom::fill(&mut bytes)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// A new token with a prefix for its kind: `avln_account_…`, `avln_run_…`.
///
/// # Errors
/// Without a random source.
pub fn new_token(kind: &str) -> Result<String, getrandom::Error> {
    Ok(format!("avln_{kind}_{}{}", random_hex()?, random_hex()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_are_long_and_never_the_same() {
        let (a, b) = (new_token("run").unwrap(), new_token("run").unwrap());
        assert_ne!(a, b);
        assert_eq!(a.len(), "avln_run_".len() + 64);
    }
}
