//! The words that agents and server exchange: package `avln.v1`.
//!
//! `PROTOCOL.md` beside this crate draws the states and tells the rules; start there, then read
//! [`v1::PlayRequest`] and [`v1::PlayResponse`].
//!
//! *Never*: holds behaviour beyond words; names a scene, a target or a score that a phase hides.

mod reason;
mod whole;

pub use whole::{WholeCodec, WholeEncoder};

/// Messages, clients and servers, generated from `avln/v1/*.proto`.
#[allow(missing_docs, unreachable_pub, clippy::all, rustdoc::all)]
pub mod v1 {
    tonic::include_proto!("avln.v1");
}

/// The compiled `.proto` files, for gRPC reflection.
pub const FILE_DESCRIPTOR_SET: &[u8] = tonic::include_file_descriptor_set!("avln_descriptor");

/// Minor number of `avln.v1` that these files define.
pub const API_MINOR: u32 = 0;

/// Largest message that either side may send, bytes.
pub const MAX_MESSAGE_BYTES: usize = 16 << 20;

/// Trailer of a gRPC status that carries [`v1::Reason::word`].
pub const REASON_KEY: &str = "avln-reason";

/// Trailer of a gRPC status that carries the seconds after which trying again makes sense, in decimals.
pub const RETRY_AFTER_KEY: &str = "avln-retry-after-s";
