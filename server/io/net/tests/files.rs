//! Certificates that are no use are refused by name, and clients that do not speak TLS are told to.

use avln_net::{Identity, Listener, Protocol, Refused};
use rcgen::{CertificateParams, KeyPair, date_time_ymd};
use std::{path::PathBuf, time::Duration};
use tempfile::TempDir;
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::{TcpListener, TcpStream},
};

/// Files of a certificate for localhost and of its key.
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
fn good_files_are_taken_without_a_word() {
    let issued = issue(|_| {});
    assert_eq!(Identity::read(&issued.certificate, &issued.key).unwrap().warning(), None);
}

#[test]
fn files_that_are_no_use_are_named_with_what_is_wrong() {
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
fn certificates_out_of_their_time_warn() {
    let old = issue(|params| params.not_after = date_time_ymd(2001, 1, 1));
    let warning = Identity::read(&old.certificate, &old.key).unwrap();
    assert!(warning.warning().unwrap().contains("has expired"), "{warning:?}");
    let young = issue(|params| params.not_before = date_time_ymd(4001, 1, 1));
    let warning = Identity::read(&young.certificate, &young.key).unwrap();
    assert!(warning.warning().unwrap().contains("not valid yet"), "{warning:?}");
}

/// What a client that says `words` is answered, and how that looks from inside.
async fn say(protocol: Protocol, words: &[u8]) -> (Vec<u8>, Refused) {
    let issued = issue(|_| {});
    let identity = Identity::read(&issued.certificate, &issued.key).unwrap();
    let tcp = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = tcp.local_addr().unwrap();
    let listener = Listener::new(tcp, Some(&identity), protocol);
    let mut client = TcpStream::connect(address).await.unwrap();
    client.write_all(words).await.unwrap();
    let (stream, _) = listener.accept().await.unwrap();
    let greeter = listener.greeter();
    let greeted = tokio::spawn(async move { greeter.greet(stream, Duration::from_millis(300)).await });
    let mut answer = Vec::new();
    let _ = client.read_to_end(&mut answer).await;
    drop(client);
    (answer, greeted.await.unwrap().unwrap_err())
}

#[tokio::test]
async fn plain_text_is_answered_in_its_own_language() {
    let (answer, refused) = say(Protocol::Http1, &[b'G'; 9000]).await;
    let answer = String::from_utf8(answer).unwrap();
    assert!(answer.starts_with("HTTP/1.1 400 ") && answer.contains("https://"), "{answer}");
    assert!(matches!(refused, Refused::PlainText), "{refused}");
    let (answer, _) = say(Protocol::Http2, b"P").await;
    assert!(answer.starts_with(&[0, 0, 0, 4]) && answer.ends_with(b"in the address"), "{answer:?}");
    let length = usize::from(answer[11]);
    assert_eq!(answer.len(), 9 + 9 + length, "GOAWAY is as long as it says");
}

#[tokio::test]
async fn a_silent_client_and_one_that_babbles_do_not_hold_a_place() {
    let (_, refused) = say(Protocol::Http2, b"").await;
    assert!(matches!(refused, Refused::Silent(_)), "{refused}");
    let (_, refused) = say(Protocol::Http2, &[0x16, 3, 1, 0, 2, 9, 9]).await;
    assert!(matches!(refused, Refused::Handshake(_) | Refused::Silent(_)), "{refused}");
}
