//! Listeners with TLS, an accept loop with connection limits, and flood detection, shared by the gRPC and the web server.
//!
//! Start at [`Identity`], which reads certificates, [`Listener`] and [`AcceptLoop`].
//!
//! *Never*: lets a silent client keep a place, since handshakes have a time limit; leaves a client that sends plain text to a
//! TLS port without an answer.

mod accept;
mod identity;
mod listener;
mod meter;

pub use accept::{AcceptLimits, AcceptLoop, Closing, Connection, Connections, Place};
pub use identity::{Identity, TlsError};
pub use listener::{HandshakeError, Handshaker, Listener, Protocol, Stream};
pub use meter::{Meter, Metered};
