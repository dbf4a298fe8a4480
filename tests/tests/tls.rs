//! The gRPC and web servers over TLS, with certificates issued by the tests.

use avln_arena::servers::Security;
use avln_client::{Action, Client, ConnectOptions, Error, Observation, Packing, RunOptions, Sensors};
use avln_tests::{
    PHASE, Server, TestServer, TestSetup, http,
    machine::{skipped, text, typed},
    set_up,
};
use rcgen::{BasicConstraints, CertificateParams, IsCa, Issuer, KeyPair};
use std::path::PathBuf;
use tempfile::TempDir;

/// An authority, and a certificate for this machine that comes from it.
struct Authority {
    folder: TempDir,
}

impl Authority {
    fn new() -> Self {
        let folder = TempDir::new().unwrap();
        let (own_key, key) = (KeyPair::generate().unwrap(), KeyPair::generate().unwrap());
        let mut params = CertificateParams::new(Vec::new()).unwrap();
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        let own = params.self_signed(&own_key).unwrap();
        let names = ["localhost".to_owned(), "127.0.0.1".to_owned()];
        let own_key_pem = own_key.serialize_pem();
        let issuer = Issuer::new(params, own_key);
        let issued = CertificateParams::new(names).unwrap().signed_by(&key, &issuer).unwrap();
        for (name, text) in [
            ("ca.pem", own.pem()),
            ("ca-key.pem", own_key_pem),
            ("cert.pem", issued.pem()),
            ("key.pem", key.serialize_pem()),
        ] {
            std::fs::write(folder.path().join(name), text).unwrap();
        }
        Self { folder }
    }

    fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn security(&self) -> Security {
        Security { tls_cert: Some(self.file("cert.pem")), tls_key: Some(self.file("key.pem")) }
    }

    fn link(&self, packing: Packing) -> ConnectOptions {
        ConnectOptions { ca: Some(self.file("ca.pem")), packing: Some(packing), ..ConnectOptions::default() }
    }
}

/// Observations of the first steps.
async fn look(server: &TestServer, link: &ConnectOptions) -> Vec<Observation> {
    let client = Client::connect_with(server.agents_url(), &server.token, link).await.unwrap();
    let run = client.start_run(RunOptions::new(PHASE, "looker")).await.unwrap();
    let mut play = client.play(&run, Sensors::square(64)).await.unwrap();
    let mut episode = play.next_episode().await.unwrap().unwrap();
    let mut seen = vec![episode.observation().clone()];
    for action in [Action::TurnLeft, Action::MoveForward, Action::Stop] {
        seen.push(episode.step(action).await.unwrap().clone());
    }
    play.finish().await.unwrap();
    seen
}

#[tokio::test(flavor = "multi_thread")]
async fn tls_episodes_are_equal_in_every_packing() {
    let (authority, stranger) = (Authority::new(), Authority::new());
    let server = TestServer::open_with_tls(&TestSetup::default(), &authority.security()).await;
    let raw = look(&server, &authority.link(Packing::Raw)).await;
    let packed = look(&server, &authority.link(Packing::Lossless)).await;
    assert!(raw.len() == 4 && raw[0].rgb != raw[1].rgb, "the pictures show something");
    assert_eq!(raw, packed);

    let refused =
        Client::connect_with(server.agents_url(), "", &stranger.link(Packing::Raw)).await.unwrap_err();
    let text = refused.to_string();
    assert!(
        matches!(refused, Error::Tls { .. }) && text.contains("--ca") && text.contains("authority"),
        "{text}"
    );

    let plain = format!("http://{}", server.servers.grpc);
    let text = Client::connect(plain, "").await.unwrap_err().to_string();
    assert!(text.contains("https://"), "{text}");

    let page = http::get(server.servers.web, "/").await;
    assert!(page.status == 400 && page.body.contains("https://"), "{page:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn tls_and_plain_text_are_distinguished() {
    let authority = Authority::new();
    let server = TestServer::open(&TestSetup::default()).await;
    let secure = format!("https://{}", server.servers.grpc);
    let refused = Client::connect_with(secure, "", &authority.link(Packing::Raw)).await.unwrap_err();
    let text = refused.to_string();
    assert!(matches!(refused, Error::Tls { .. }) && text.contains("use http://"), "{text}");
}

#[tokio::test(flavor = "multi_thread")]
async fn tls_pages_forbid_later_plain_text() {
    let authority = Authority::new();
    let server = TestServer::open_with_tls(&TestSetup::default(), &authority.security()).await;
    let mut curl = std::process::Command::new("curl");
    // Other tests check the certificate.
    curl.args(["--silent", "--show-error", "--head", "--insecure", "--noproxy", "*"]);
    curl.arg(format!("https://{}/", server.servers.web));
    let Ok(output) = tokio::task::spawn_blocking(move || curl.output()).await.unwrap() else {
        return skipped("tls_pages_forbid_later_plain_text", "install curl");
    };
    let head = String::from_utf8_lossy(&output.stdout).to_lowercase();
    assert!(head.contains("strict-transport-security: max-age=31536000\r\n"), "{output:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn doctor_checks_tls_server() {
    let authority = Authority::new();
    let server =
        TestServer::open_with_tls(&TestSetup { missions: 12, ..TestSetup::default() }, &authority.security())
            .await;
    let mut kit = std::process::Command::new(env!("CARGO_BIN_EXE_avln_under_test"));
    kit.args([
        "lab",
        "conformance",
        "--server",
        &server.agents_url(),
        "--token",
        &server.token,
        "--phase",
        PHASE,
    ]);
    kit.arg("--ca").arg(authority.file("ca.pem"));
    let output = tokio::task::spawn_blocking(move || kit.output().expect("the program runs")).await.unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && text.contains("none broken"), "{output:?}");
}

/// `openssl req -x509` makes such a certificate by default.
#[tokio::test(flavor = "multi_thread")]
async fn authority_certificate_is_reported_by_both_sides() {
    let authority = Authority::new();
    let folder = TempDir::new().unwrap();
    set_up(folder.path(), &TestSetup::default()).await;
    let (certificate, key) = (authority.file("ca.pem"), authority.file("ca-key.pem"));
    let options = ["--tls-cert", certificate.to_str().unwrap(), "--tls-key", key.to_str().unwrap()];
    let server = Server::start_with(env!("CARGO_BIN_EXE_avln_under_test"), folder.path(), &options);
    let log = std::fs::read_to_string(folder.path().join("server.log")).unwrap();
    let warning = log.lines().find(|line| line.starts_with("warning: the certificate in "));
    let words = ["is that of an authority", "docs/deploying.md, section Certificates"];
    assert!(warning.is_some_and(|line| words.iter().all(|word| line.contains(word))), "{log}");

    let url = format!("https://{}", server.grpc);
    let refused = Client::connect_with(url, "", &authority.link(Packing::Raw)).await.unwrap_err();
    let text = refused.to_string();
    assert!(
        matches!(refused, Error::Tls { .. }) && text.contains("the server uses an authority's certificate"),
        "{text}"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn documented_certificate_is_accepted() {
    let page = text("docs/deploying.md");
    let command = typed(&page).into_iter().find(|line| line.starts_with("openssl req")).expect("a command");
    let folder = TempDir::new().unwrap();
    let mut shell = std::process::Command::new("bash");
    shell.args(["-c", &command]).current_dir(folder.path());
    match shell.output() {
        Ok(output) if output.status.success() => {}
        Ok(output) if output.status.code() != Some(127) => panic!("{output:?}"),
        _ => return skipped("documented_certificate_is_accepted", "install bash and openssl"),
    }
    let file = |name| Some(folder.path().join(name));
    let security = Security { tls_cert: file("tls-cert.pem"), tls_key: file("tls-key.pem") };
    let server = TestServer::open_with_tls(&TestSetup::default(), &security).await;
    let options = ConnectOptions { ca: file("tls-cert.pem"), ..ConnectOptions::default() };
    assert_eq!(look(&server, &options).await.len(), 4);
}
