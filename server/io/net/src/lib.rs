//! Listeners with TLS, an accept loop with connection limits, and flood detection, shared by the gRPC and the web server.
//!
//! Start at [`Identity`], which reads certificates, [`Listener`] and [`AcceptLoop`].
//!
//! *Never*: lets a silent client use up a connection, since handshakes have a time limit; leaves a client that sends plain text to a
//! TLS port without an answer.

mod accept;
mod identity;
mod listener;

pub use accept::{AcceptLimits, AcceptLoop, Closing, Connection, ConnectionPermit, Connections};
pub use identity::{Identity, TlsError};
pub use listener::{HandshakeError, Handshaker, Listener, Meter, Metered, Protocol, Stream};
