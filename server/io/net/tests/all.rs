//! Errors of certificates, answers to plain text, and the accept loop.

use avln_net::{AcceptLimits, AcceptLoop, HandshakeError, Identity, Listener, Protocol};
use rcgen::{CertificateParams, KeyPair, date_time_ymd};
use std::{path::PathBuf, time::Duration};
use tempfile::TempDir;
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::{TcpListener, TcpStream},
};

/// Certificate and key for localhost.
struct Issued {
    folder: TempDir,
    certificate: PathBuf,
    key: PathBuf,
}

fn issue(change: impl FnOnce(&mut CertificateParams)) -> Issued {
    let mut params = CertificateParams::new(["localhost".to_owned()]).unwrap();
    change(&mut params);
    let key_pair = KeyPair::generate().unwrap();
    let folder = TempDir::new().unwrap();
    let [certificate, key] = ["cert.pem", "key.pem"].map(|name| folder.path().join(name));
    std::fs::write(&certificate, params.self_signed(&key_pair).unwrap().pem()).unwrap();
    std::fs::write(&key, key_pair.serialize_pem()).unwrap();
    Issued { folder, certificate, key }
}

fn problem(certificate: &std::path::Path, key: &std::path::Path) -> String {
    Identity::read(certificate, key).unwrap_err().to_string()
}

#[test]
fn good_files_give_no_warning() {
    let issued = issue(|_| {});
    assert_eq!(Identity::read(&issued.certificate, &issued.key).unwrap().warning(), None);
}

#[test]
fn bad_files_are_named_with_their_problem() {
    let (issued, other) = (issue(|_| {}), issue(|_| {}));
    let missing = issued.folder.path().join("nothing.pem");
    let text = problem(&missing, &issued.key);
    assert!(text.contains("nothing.pem") && text.contains("cannot be read"), "{text}");
    let text = problem(&issued.certificate, &issued.certificate);
    assert!(text.contains("cert.pem") && text.contains("no key"), "{text}");
    let text = problem(&issued.key, &issued.key);
    assert!(text.contains("key.pem") && text.contains("no certificate"), "{text}");
    let text = problem(&issued.certificate, &other.key);
    assert!(text.contains("is not that of the certificate") && text.contains("key.pem"), "{text}");
    let damaged = issued.folder.path().join("damaged.pem");
    std::fs::write(&damaged, "-----BEGIN CERTIFICATE-----\n!!!\n-----END CERTIFICATE-----\n").unwrap();
    let text = problem(&damaged, &issued.key);
    assert!(text.contains("damaged.pem"), "{text}");
}

#[test]
fn expired_and_future_certificates_warn() {
    let old = issue(|params| params.not_after = date_time_ymd(2001, 1, 1));
    let warning = Identity::read(&old.certificate, &old.key).unwrap();
    assert!(warning.warning().unwrap().contains("has expired"), "{warning:?}");
    let young = issue(|params| params.not_before = date_time_ymd(4001, 1, 1));
    let warning = Identity::read(&young.certificate, &young.key).unwrap();
    assert!(warning.warning().unwrap().contains("not valid yet"), "{warning:?}");
}

/// Connects, sends `bytes`, and returns the answer and the server's error.
async fn answer_to(protocol: Protocol, bytes: &[u8]) -> (Vec<u8>, HandshakeError) {
    let issued = issue(|_| {});
    let identity = Identity::read(&issued.certificate, &issued.key).unwrap();
    let tcp = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = tcp.local_addr().unwrap();
    let listener = Listener::new(tcp, Some(&identity), protocol);
    let mut client = TcpStream::connect(address).await.unwrap();
    client.write_all(bytes).await.unwrap();
    let (stream, _) = listener.accept().await.unwrap();
    let handshaker = listener.handshaker();
    let shaken = tokio::spawn(async move { handshaker.handshake(stream, Duration::from_millis(300)).await });
    let mut answer = Vec::new();
    let _ = client.read_to_end(&mut answer).await;
    drop(client);
    (answer, shaken.await.unwrap().unwrap_err())
}

#[tokio::test]
async fn plain_text_is_answered_in_its_protocol() {
    let (answer, refused) = answer_to(Protocol::Http1, &[b'G'; 9000]).await;
    let answer = String::from_utf8(answer).unwrap();
    assert!(answer.starts_with("HTTP/1.1 400 ") && answer.contains("https://"), "{answer}");
    assert!(matches!(refused, HandshakeError::PlainText), "{refused}");
    let (answer, _) = answer_to(Protocol::Http2, b"P").await;
    assert!(answer.starts_with(&[0, 0, 0, 4]) && answer.ends_with(b"in the address"), "{answer:?}");
    let length = usize::from(answer[11]);
    assert_eq!(answer.len(), 9 + 9 + length, "the length field of GOAWAY");
}

#[tokio::test]
async fn silent_and_nonsense_clients_are_dropped() {
    let (_, refused) = answer_to(Protocol::Http2, b"").await;
    assert!(matches!(refused, HandshakeError::Silent(_)), "{refused}");
    let (_, refused) = answer_to(Protocol::Http2, &[0x16, 3, 1, 0, 2, 9, 9]).await;
    assert!(matches!(refused, HandshakeError::Handshake(_) | HandshakeError::Silent(_)), "{refused}");
}

fn limits(waits_when_full: bool) -> AcceptLimits {
    AcceptLimits {
        max_connections: 1,
        max_connections_per_address: 1,
        shares_by_address: true,
        waits_when_full,
        handshake: Duration::from_secs(5),
        failure_pause: Duration::from_millis(1),
        max_failures: None,
    }
}

/// Runs a loop that sends a byte per connection and closes after the client.
async fn serve(limits: AcceptLimits) -> std::net::SocketAddr {
    let tcp = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = tcp.local_addr().unwrap();
    tokio::spawn(async move {
        let mut accept = AcceptLoop::new(tcp, limits);
        accept
            .run(|mut connection| async move {
                connection.stream.write_all(b"x").await.unwrap();
                let _ = connection.stream.read_to_end(&mut Vec::new()).await;
            })
            .await
    });
    address
}

#[tokio::test]
async fn a_full_loop_refuses_or_waits() {
    for waits in [false, true] {
        let address = serve(limits(waits)).await;
        let mut first = TcpStream::connect(address).await.unwrap();
        assert_eq!(first.read_u8().await.unwrap(), b'x');
        let mut second = TcpStream::connect(address).await.unwrap();
        if waits {
            drop(first);
            assert_eq!(second.read_u8().await.unwrap(), b'x', "it waited for the first to close");
        } else {
            assert_eq!(second.read(&mut [0]).await.unwrap(), 0, "it is closed at once");
        }
    }
}

#[tokio::test]
async fn closing_waits_for_connections_after_a_signal() {
    let tcp = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = tcp.local_addr().unwrap();
    let mut accept = AcceptLoop::new(tcp, limits(true));
    let mut client = TcpStream::connect(address).await.unwrap();
    tokio::select! {
        error = accept.run(|mut connection| async move {
            connection.stream.write_all(b"x").await.unwrap();
            connection.closing.wait().await;
            connection.stream.write_all(b"y").await.unwrap();
        }) => panic!("{error}"),
        byte = client.read_u8() => assert_eq!(byte.unwrap(), b'x'),
    }
    accept.stop_listening().close().await;
    assert_eq!(client.read_u8().await.unwrap(), b'y', "the connection ended in its own time");
}
