//! What the store refuses, as the agents' door says it.

use avln_grpc::{Reason, Refusal};
use avln_store::{StoreError, TokenState};

/// Tells the agent what it can mend; everything else is the server's own fault.
pub(super) fn refusal(error: StoreError) -> Refusal {
    let reason = match &error {
        StoreError::Unknown { what: "phase", .. } => Reason::PhaseUnknown,
        StoreError::Unknown { what: "run", .. } => Reason::RunUnknown,
        StoreError::PhaseClosed(_) => Reason::PhaseClosed,
        StoreError::QuotaUsed { .. } => Reason::QuotaTotal,
        StoreError::RunOver { .. } => Reason::RunOver,
        StoreError::OrderNotAllowed { .. } | StoreError::Taken { .. } => Reason::BadRequest,
        _ => return Refusal::internal(error),
    };
    Refusal::new(reason, error.to_string())
}

/// Why a token opens nothing.
pub(super) fn token_refusal(state: &TokenState) -> Refusal {
    let renew = "ask the organiser for a new one (avln team add NAME)";
    match state {
        TokenState::Expired => Refusal::new(Reason::TokenExpired, format!("the token has expired; {renew}")),
        TokenState::Revoked => {
            Refusal::new(Reason::TokenRevoked, format!("the token was taken back; {renew}"))
        }
        TokenState::Valid(_) => Refusal::new(
            Reason::TokenMalformed,
            "the token is of another kind; account tokens start runs, run tokens play them",
        ),
        TokenState::Unknown => Refusal::new(
            Reason::TokenMalformed,
            format!("the token is not one of this server's; check that it was copied whole, or {renew}"),
        ),
    }
}
