use crate::Protocol;
use std::{
    path::{Path, PathBuf},
    sync::Arc,
};
use tokio_rustls::{
    TlsAcceptor,
    rustls::{
        CertificateError, Error as RustlsError, RootCertStore, ServerConfig,
        client::{WebPkiServerVerifier, danger::ServerCertVerifier},
        crypto::{CryptoProvider, ring},
        pki_types::{CertificateDer, PrivateKeyDer, ServerName, UnixTime, pem, pem::PemObject},
    },
};

/// Why a server cannot identify itself.
#[derive(Debug, thiserror::Error)]
pub enum TlsError {
    /// A file cannot be read as PEM.
    #[error("{what} {}: {problem}; give a PEM file", path.display())]
    File {
        /// What should be in it.
        what: &'static str,
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: String,
    },
    /// The key is not the certificate's.
    #[error("the key in {} is not that of the certificate in {}; give the two that were issued together", key.display(), certificate.display())]
    WrongPair {
        /// File of the certificate.
        certificate: PathBuf,
        /// File of the key.
        key: PathBuf,
    },
    /// The certificate is of no use to a server.
    #[error("the certificate in {}: {problem}; have another issued", certificate.display())]
    Certificate {
        /// Its file.
        certificate: PathBuf,
        /// What is wrong with it.
        problem: String,
    },
}

/// By what a server is known: its certificate and the key to it.
#[derive(Clone)]
pub struct Identity {
    config: ServerConfig,
    warning: Option<String>,
}

impl Identity {
    /// Reads a chain of certificates, the server's own first, and its key, both PEM.
    ///
    /// # Errors
    /// When a file cannot be read or holds no such thing, or the two do not belong together.
    pub fn read(certificate: &Path, key: &Path) -> Result<Self, TlsError> {
        let chain = read_chain(certificate)?;
        let secret = PrivateKeyDer::from_pem_file(key).map_err(|error| not_pem("key", key, &error))?;
        let warning = out_of_date(&chain)
            .map(|problem| format!("the certificate in {} {problem}", certificate.display()));
        let config = ServerConfig::builder_with_provider(provider())
            .with_safe_default_protocol_versions()
            .and_then(|builder| builder.with_no_client_auth().with_single_cert(chain, secret))
            .map_err(|error| unusable(certificate, key, &error))?;
        Ok(Self { config, warning })
    }

    /// What clients will complain of, although the server can start.
    pub fn warning(&self) -> Option<&str> {
        self.warning.as_deref()
    }

    pub(crate) fn acceptor(&self, protocol: Protocol) -> TlsAcceptor {
        let mut config = self.config.clone();
        config.alpn_protocols = vec![protocol.name().to_vec()];
        TlsAcceptor::from(Arc::new(config))
    }
}

impl std::fmt::Debug for Identity {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Identity").field("warning", &self.warning).finish_non_exhaustive()
    }
}

fn provider() -> Arc<CryptoProvider> {
    Arc::new(ring::default_provider())
}

fn read_chain(path: &Path) -> Result<Vec<CertificateDer<'static>>, TlsError> {
    let what = "certificate";
    let certificates = CertificateDer::pem_file_iter(path).map_err(|error| not_pem(what, path, &error))?;
    let chain: Result<Vec<_>, _> = certificates.collect();
    let chain = chain.map_err(|error| not_pem(what, path, &error))?;
    if chain.is_empty() {
        return Err(not_pem(what, path, &pem::Error::NoItemsFound));
    }
    Ok(chain)
}

fn not_pem(what: &'static str, path: &Path, error: &pem::Error) -> TlsError {
    let problem = match error {
        pem::Error::NoItemsFound => format!("it holds no {what}"),
        pem::Error::Io(error) => format!("it cannot be read: {error}"),
        other => format!("it is damaged: {other}"),
    };
    TlsError::File { what, path: path.to_owned(), problem }
}

fn unusable(certificate: &Path, key: &Path, error: &RustlsError) -> TlsError {
    let certificate = certificate.to_owned();
    match error {
        RustlsError::InconsistentKeys(_) => TlsError::WrongPair { certificate, key: key.to_owned() },
        RustlsError::InvalidCertificate(_) => {
            TlsError::Certificate { certificate, problem: error.to_string() }
        }
        other => TlsError::File { what: "key", path: key.to_owned(), problem: other.to_string() },
    }
}

/// Whether clients will find the certificate too old or too young. Only the dates are looked at: who issued it is for
/// clients to judge.
fn out_of_date(chain: &[CertificateDer<'static>]) -> Option<&'static str> {
    let own = chain.first()?;
    let mut roots = RootCertStore::empty();
    roots.add_parsable_certificates(chain.iter().cloned());
    let verifier = WebPkiServerVerifier::builder_with_provider(Arc::new(roots), provider()).build().ok()?;
    let name = ServerName::try_from("localhost").ok()?;
    match verifier.verify_server_cert(own, &chain[1..], &name, &[], UnixTime::now()) {
        Err(RustlsError::InvalidCertificate(
            CertificateError::Expired | CertificateError::ExpiredContext { .. },
        )) => Some("has expired; agents will refuse it"),
        Err(RustlsError::InvalidCertificate(
            CertificateError::NotValidYet | CertificateError::NotValidYetContext { .. },
        )) => Some("is not valid yet; agents will refuse it"),
        _ => None,
    }
}
