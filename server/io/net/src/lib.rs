//! Listeners that speak TLS, or plain text where that is safe.
//!
//! Start reading at [`Identity`], which is read from files, and [`Listener`].
//!
//! *Never*: lets a silent client hold a place, for a handshake has a time limit; leaves a client that speaks plain text to a
//! TLS port without an answer.

mod identity;
mod listener;
mod stream;

pub use identity::{Identity, TlsError};
pub use listener::{Greeter, Listener, Protocol, Refused};
pub use stream::Stream;
