//! What must not be guessed: tokens and handles, drawn from the system's randomness.

/// 128 random bits in hexadecimal.
///
/// # Errors
/// When the system has no randomness to give.
pub fn random_hex() -> Result<String, getrandom::Error> {
    let mut bytes = [0_u8; 16];
    getrandom::fill(&mut bytes)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// A new secret whose first letters say what it opens: `avln_account_…`, `avln_run_…`.
///
/// # Errors
/// When the system has no randomness to give.
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
