use crate::v1::Reason;
use tonic::Code;

const PREFIX: &str = "REASON_";

impl Reason {
    /// The word without its prefix, as it travels in the trailer `avln-reason`: `"TOKEN_MISSING"`.
    pub fn word(self) -> &'static str {
        let name = self.as_str_name();
        name.strip_prefix(PREFIX).unwrap_or(name)
    }

    /// The reason that [`word`](Self::word) belongs to; `None` for a word of a newer minor version.
    pub fn from_word(word: &str) -> Option<Self> {
        Self::from_str_name(&format!("{PREFIX}{word}"))
    }

    /// The gRPC status code that goes with the reason, on unary calls and in `Fault.code`.
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
