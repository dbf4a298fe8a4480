//! Certificates and keys, reloaded when the files change.

use parking_lot::Mutex;
use std::{
    fs,
    path::{Path, PathBuf},
    sync::Arc,
    time::{Duration, Instant, SystemTime},
};
use tokio_rustls::{
    TlsAcceptor,
    rustls::{
        CertificateError, Error as RustlsError, RootCertStore, ServerConfig,
        client::{WebPkiServerVerifier, danger::ServerCertVerifier},
        crypto::{CryptoProvider, ring},
        pki_types::{CertificateDer, PrivateKeyDer, ServerName, UnixTime, pem, pem::PemObject},
        server::{ClientHello, ResolvesServerCert},
        sign::CertifiedKey,
    },
};

/// Shortest time between two looks at the files.
const CHECK_INTERVAL: Duration = Duration::from_secs(1);

/// Certificate or key error.
#[expect(missing_docs, reason = "the messages explain the fields")]
#[derive(Debug, thiserror::Error)]
pub enum TlsError {
    /// A file cannot be read as PEM.
    #[error("{what} {}: {problem}; give a PEM file", path.display())]
    File { what: &'static str, path: PathBuf, problem: String },
    /// Certificate and key do not match.
    #[error("the key in {} is not that of the certificate in {}; give the two that were issued together", key.display(), certificate.display())]
    WrongPair { certificate: PathBuf, key: PathBuf },
    /// The certificate is unsuitable for a server.
    #[error("the certificate in {}: {problem}; have another issued", certificate.display())]
    Certificate { certificate: PathBuf, problem: String },
}

/// TLS identity: certificate and key.
#[derive(Clone)]
pub struct Identity {
    config: ServerConfig,
    warning: Option<String>,
}

impl Identity {
    /// Reads a certificate chain, the server's own certificate first, and the key, both PEM. Later file changes apply to new
    /// connections.
    ///
    /// # Errors
    /// If a file cannot be read or has other content, or certificate and key do not match.
    pub fn read(certificate: &Path, key: &Path) -> Result<Self, TlsError> {
        let files = ReloadingFiles::read(certificate, key)?;
        let warning = client_problem(&files.loaded.lock().certified.cert)
            .map(|problem| format!("the certificate in {} {problem}", certificate.display()));
        let config = ServerConfig::builder_with_provider(provider())
            .with_safe_default_protocol_versions()
            .map_err(|error| unusable(certificate, key, &error))?
            .with_no_client_auth()
            .with_cert_resolver(Arc::new(files));
        Ok(Self { config, warning })
    }

    /// Returns a problem that clients will complain about, although the server can start.
    pub fn warning(&self) -> Option<&str> {
        self.warning.as_deref()
    }

    pub(crate) fn acceptor(&self, protocol_name: &[u8]) -> TlsAcceptor {
        let mut config = self.config.clone();
        config.alpn_protocols = vec![protocol_name.to_vec()];
        TlsAcceptor::from(Arc::new(config))
    }
}

impl std::fmt::Debug for Identity {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Identity").field("warning", &self.warning).finish_non_exhaustive()
    }
}

/// A certificate and a key, reloaded when the files change.
#[derive(Debug)]
struct ReloadingFiles {
    certificate: PathBuf,
    key: PathBuf,
    loaded: Mutex<LoadedPair>,
}

#[derive(Debug)]
struct LoadedPair {
    certified: Arc<CertifiedKey>,
    versions: [Option<FileVersion>; 2],
    checked: Instant,
}

/// A file's modification time and length.
type FileVersion = (SystemTime, u64);

impl ReloadingFiles {
    fn read(certificate: &Path, key: &Path) -> Result<Self, TlsError> {
        // Before the files are read: a change in between is noticed at the first look.
        let versions = file_versions(certificate, key);
        let certified = Arc::new(read_pair(certificate, key)?);
        let loaded = Mutex::new(LoadedPair { certified, versions, checked: Instant::now() });
        Ok(Self { certificate: certificate.to_owned(), key: key.to_owned(), loaded })
    }

    /// Reloads the files if they have changed.
    fn refresh(&self, loaded: &mut LoadedPair) {
        let versions = file_versions(&self.certificate, &self.key);
        if versions == loaded.versions {
            return;
        }
        // Recorded also after a failure, so that a bad file is reported once and not for every connection. Programs write one
        // file after the other: the pair that does not match yet fails, and the second file's change leads here once more.
        loaded.versions = versions;
        match read_pair(&self.certificate, &self.key) {
            Ok(certified) => {
                if let Some(problem) = client_problem(&certified.cert) {
                    tracing::warn!(certificate = %self.certificate.display(), problem, "new certificate");
                }
                tracing::info!(certificate = %self.certificate.display(), "the certificate was reloaded");
                loaded.certified = Arc::new(certified);
            }
            Err(error) => tracing::warn!(%error, "the changed certificate is not used"),
        }
    }
}

impl ResolvesServerCert for ReloadingFiles {
    fn resolve(&self, _: ClientHello<'_>) -> Option<Arc<CertifiedKey>> {
        let mut loaded = self.loaded.lock();
        // Blocking calls in an async task, but short and at most once a second.
        if loaded.checked.elapsed() >= CHECK_INTERVAL {
            loaded.checked = Instant::now();
            self.refresh(&mut loaded);
        }
        Some(loaded.certified.clone())
    }
}

fn file_versions(certificate: &Path, key: &Path) -> [Option<FileVersion>; 2] {
    [certificate, key].map(|path| {
        let metadata = fs::metadata(path).ok()?;
        Some((metadata.modified().ok()?, metadata.len()))
    })
}

fn provider() -> Arc<CryptoProvider> {
    Arc::new(ring::default_provider())
}

fn read_pair(certificate: &Path, key: &Path) -> Result<CertifiedKey, TlsError> {
    let chain = read_chain(certificate)?;
    let secret = PrivateKeyDer::from_pem_file(key).map_err(|error| not_pem("key", key, &error))?;
    CertifiedKey::from_der(chain, secret, &provider()).map_err(|error| unusable(certificate, key, &error))
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
        pem::Error::NoItemsFound => format!("the file contains no {what}"),
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

/// Returns a problem of the certificate for which clients refuse it: dates, or an authority's certificate.
fn client_problem(chain: &[CertificateDer<'static>]) -> Option<&'static str> {
    // The chain serves as root too: clients judge the issuer.
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
        // rustls passes this error on as text.
        Err(RustlsError::InvalidCertificate(CertificateError::Other(other)))
            if other.to_string().contains("CaUsedAsEndEntity") =>
        {
            Some(
                "is that of an authority; agents will refuse it: have it issue a certificate for this server; \
                 docs/deploying.md, section Certificates, shows how to make a certificate for tests",
            )
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcgen::{BasicConstraints, CertificateParams, IsCa, KeyPair};

    /// Writes certificate and key with a modification time. Returns the certificate in DER form.
    fn write(folder: &Path, names: &[&str], modified: SystemTime) -> Vec<u8> {
        let params = CertificateParams::new(["localhost".to_owned()]).unwrap();
        let key = KeyPair::generate().unwrap();
        let certificate = params.self_signed(&key).unwrap();
        for (name, text) in [("cert.pem", certificate.pem()), ("key.pem", key.serialize_pem())] {
            if names.contains(&name) {
                fs::write(folder.join(name), text).unwrap();
                let file = fs::File::options().write(true).open(folder.join(name)).unwrap();
                file.set_modified(modified).unwrap();
            }
        }
        certificate.der().to_vec()
    }

    #[test]
    fn certificates_of_authorities_are_reported() {
        let warning = |is_ca: IsCa| {
            let mut params = CertificateParams::new(["localhost".to_owned()]).unwrap();
            params.is_ca = is_ca;
            let certificate = params.self_signed(&KeyPair::generate().unwrap()).unwrap();
            client_problem(&[certificate.der().clone()])
        };
        assert_eq!(warning(IsCa::NoCa), None);
        let found = warning(IsCa::Ca(BasicConstraints::Unconstrained)).expect("a warning");
        assert!(found.contains("is that of an authority"), "{found}");
    }

    #[test]
    fn changed_files_are_reloaded_when_they_match() {
        let folder = tempfile::TempDir::new().unwrap();
        let start = SystemTime::now();
        let later = |seconds| start + Duration::from_secs(seconds);
        let first = write(folder.path(), &["cert.pem", "key.pem"], start);
        let files =
            ReloadingFiles::read(&folder.path().join("cert.pem"), &folder.path().join("key.pem")).unwrap();
        let served = || {
            let mut loaded = files.loaded.lock();
            files.refresh(&mut loaded);
            loaded.certified.cert[0].to_vec()
        };
        assert_eq!(served(), first);
        write(folder.path(), &["cert.pem"], later(1));
        assert_eq!(served(), first, "the key of the new certificate is missing");
        let second = write(folder.path(), &["cert.pem", "key.pem"], later(2));
        assert_eq!(served(), second);
        fs::remove_file(folder.path().join("cert.pem")).unwrap();
        assert_eq!(served(), second, "a missing file changes nothing");
    }
}
