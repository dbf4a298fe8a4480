//! Protocol between agents and server: messages and encodings in package `avln.v1`.
//!
//! ```
//! use avln_proto::{v1::Encoding, wire::audio};
//!
//! // A step's sound: samples of the left ear, then of the right ear.
//! let bytes = audio::encode(Encoding::AudioI16, &[0.5, -0.25, 0.0, 1.0])?;
//! let samples = audio::decode(Encoding::AudioI16, 4, &bytes)?;
//! assert!((samples[0] - 0.5).abs() < 1e-4);
//! # Ok::<_, avln_proto::wire::CodecError>(())
//! ```
//!
//! `PROTOCOL.md` defines states and rules; continue with [`v1::PlayRequest`], [`v1::PlayResponse`] and [`wire`].
//!
//! This crate never contains behaviour beyond messages and encodings or names a scene, a target or a score
//! that a phase hides.

pub mod wire;

use prost::Message;
use std::marker::PhantomData;
use tonic::{
    Code, Status,
    codec::{Codec, EncodeBuf, Encoder},
};
use tonic_prost::{ProstCodec, ProstDecoder};
use v1::Reason;

/// Messages, clients and servers, generated from `avln/v1/*.proto`.
#[allow(missing_docs, unreachable_pub, clippy::all, rustdoc::all)]
pub mod v1 {
    tonic::include_proto!("avln.v1");
}

/// The compiled `.proto` files, for gRPC reflection.
pub const FILE_DESCRIPTOR_SET: &[u8] = tonic::include_file_descriptor_set!("avln_descriptor");

/// `avln.v1` minor version.
pub const API_MINOR: u32 = 0;

/// Largest message in either direction, bytes.
pub const MAX_MESSAGE_BYTES: usize = 16 << 20;

/// gRPC status trailer with [`v1::Reason::word`].
pub const REASON_KEY: &str = "avln-reason";

/// gRPC status trailer with the retry delay, decimal seconds.
pub const RETRY_AFTER_KEY: &str = "avln-retry-after-s";

const REASON_PREFIX: &str = "REASON_";

impl Reason {
    /// Returns the trailer word without the prefix: `"TOKEN_MISSING"`.
    pub fn word(self) -> &'static str {
        let name = self.as_str_name();
        name.strip_prefix(REASON_PREFIX).unwrap_or(name)
    }

    /// Parses a [`word`](Self::word); `None` for a newer minor version's word.
    pub fn from_word(word: &str) -> Option<Self> {
        Self::from_str_name(&format!("{REASON_PREFIX}{word}"))
    }

    /// Returns the gRPC status code, on unary calls and in `Fault.code`.
    pub fn code(self) -> Code {
        match self {
            Self::Unspecified => Code::Unknown,
            Self::TokenMissing | Self::TokenMalformed | Self::TokenExpired | Self::TokenRevoked => {
                Code::Unauthenticated
            }
            Self::TeamNotApproved | Self::PhaseNotVisible | Self::TokenScope => Code::PermissionDenied,
            Self::QuotaDay | Self::QuotaMonth | Self::QuotaTotal | Self::QuotaConcurrent => {
                Code::ResourceExhausted
            }
            Self::NoCapacity | Self::RateLimit => Code::ResourceExhausted,
            Self::PhaseNotOpen | Self::PhaseClosed | Self::PhasePaused => Code::FailedPrecondition,
            Self::ClientTooOld | Self::ClientTooNew => Code::FailedPrecondition,
            Self::EncodingUnsupported | Self::SensorNotAllowed => Code::FailedPrecondition,
            Self::StepAhead | Self::EpisodeOver | Self::RunOver => Code::FailedPrecondition,
            Self::PhaseUnknown | Self::RunUnknown | Self::SlotUnknown | Self::EpisodeUnknown => {
                Code::NotFound
            }
            Self::ActionOutOfRange | Self::BadRequest => Code::InvalidArgument,
            Self::StepConflict | Self::Superseded => Code::Aborted,
            Self::Draining => Code::Unavailable,
            Self::SimFault | Self::Internal => Code::Internal,
            Self::Unsupported => Code::Unimplemented,
            Self::TooSlow => Code::DeadlineExceeded,
            Self::SlotBusy => Code::AlreadyExists,
        }
    }
}

/// Protocol buffer codec that reserves space for the whole message before it encodes.
#[derive(Debug, Default)]
pub struct WholeCodec<T, U>(PhantomData<(T, U)>);

impl<T, U> Codec for WholeCodec<T, U>
where
    T: Message + Send + 'static,
    U: Message + Default + Send + 'static,
{
    type Encode = T;
    type Decode = U;
    type Encoder = WholeEncoder<T>;
    type Decoder = ProstDecoder<U>;

    fn encoder(&mut self) -> Self::Encoder {
        WholeEncoder(PhantomData)
    }

    fn decoder(&mut self) -> Self::Decoder {
        ProstCodec::<T, U>::default().decoder()
    }
}

/// [`WholeCodec`]'s encoder.
#[derive(Debug)]
pub struct WholeEncoder<T>(PhantomData<T>);

impl<T: Message> Encoder for WholeEncoder<T> {
    type Item = T;
    type Error = Status;

    fn encode(&mut self, message: T, buffer: &mut EncodeBuf<'_>) -> Result<(), Status> {
        // Images are large, and a growing buffer would copy them.
        buffer.reserve(message.encoded_len());
        message.encode(buffer).map_err(|error| Status::internal(format!("cannot encode a message: {error}")))
    }
}
