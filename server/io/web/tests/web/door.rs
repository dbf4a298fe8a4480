use crate::fixture::Arena;
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::{TcpListener, TcpStream},
    sync::oneshot,
};

#[tokio::test]
async fn the_door_answers_over_a_socket_and_closes_when_told() {
    let arena = Arena::new().await;
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let address = listener.local_addr().expect("an address");
    let (stop, stopped) = oneshot::channel::<()>();
    let served =
        tokio::spawn(avln_web::serve(listener, arena.store.reader(), avln_web::Site::default(), async {
            let _ = stopped.await;
        }));
    let mut visitor = TcpStream::connect(address).await.expect("a connection");
    visitor
        .write_all(b"GET /healthz HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n")
        .await
        .expect("a request");
    let mut answer = String::new();
    visitor.read_to_string(&mut answer).await.expect("an answer");
    assert!(answer.starts_with("HTTP/1.1 200 OK") && answer.ends_with("alive\n"), "{answer}");

    let mut idle = TcpStream::connect(address).await.expect("a connection");
    idle.write_all(b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n").await.expect("a request");
    let mut first = [0; 15];
    idle.read_exact(&mut first).await.expect("an answer");
    stop.send(()).expect("a door");
    served.await.expect("no panic").expect("no failure");
    let mut rest = Vec::new();
    idle.read_to_end(&mut rest).await.expect("the visitor is let go");
    assert!(TcpStream::connect(address).await.is_err(), "nobody is let in any more");
}
