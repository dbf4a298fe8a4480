//! Listeners with TLS, an accept loop with connection limits, and flood detection, shared by the gRPC and the web server.
//!
//! Start at [`Identity`], which reads certificates, [`Listener`] and [`AcceptLoop`].
//!
//! A silent client never uses up a connection, because handshakes have a time limit. A client that sends
//! plain text to a TLS port always receives an answer.

mod accept;
mod identity;
mod listener;

pub use accept::{
    AcceptLimits, AcceptLoop, Closing, Connection, ConnectionPermit, Connections, HeldPlace, Places,
    fair_share,
};
pub use identity::{Identity, TlsError};
pub use listener::{HandshakeError, Handshaker, Listener, Meter, Metered, Protocol, Stream};
