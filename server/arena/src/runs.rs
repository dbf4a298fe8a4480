//! Sealed runs, started by the organiser.

use crate::{
    Failure,
    data::DataFolder,
    ids, now_unix_ms,
    phases::{PhaseCatalog, find_phase},
};
use avln_challenge::{MethodInfo, MethodType, names::is_visible_text};
use avln_episode::Order;
use avln_store::{NewRun, Run, Store};
use std::sync::Arc;

/// A run id and a token.
#[derive(Clone, Debug)]
pub struct IssuedRun {
    /// Run id.
    pub run: String,
    /// Token for this run only.
    pub token: String,
}

impl IssuedRun {
    pub(crate) fn random() -> Result<Self, getrandom::Error> {
        Ok(Self { run: format!("run_{}", ids::random_hex()?), token: ids::new_token("run")? })
    }
}

/// Source of run ids: random by default, or a function for simulations.
#[derive(Clone, Default)]
pub(crate) struct RunIds(pub(crate) Option<Arc<dyn Fn() -> String + Send + Sync>>);

impl RunIds {
    /// Returns the next run's id, with a random token.
    pub(crate) fn next(&self) -> Result<IssuedRun, getrandom::Error> {
        let random = IssuedRun::random()?;
        Ok(match &self.0 {
            Some(name) => IssuedRun { run: name(), ..random },
            None => random,
        })
    }
}

/// The organiser's request for a sealed run.
#[derive(Clone, Copy, Debug)]
pub struct SealedRunRequest<'a> {
    /// Phase id.
    pub phase: &'a str,
    /// Team.
    pub team: &'a str,
    /// Method name on leaderboards.
    pub method: &'a str,
    /// Method version; may be empty.
    pub version: &'a str,
    /// Method type.
    pub method_type: Option<MethodType>,
    /// Goal order.
    pub order: Order,
}

/// Starts a run and records the enforced and the missing restrictions; `missing` may be empty.
pub async fn start_sealed_run(
    data: &DataFolder,
    store: &Store,
    request: &SealedRunRequest<'_>,
    enforced: String,
    missing: String,
) -> Result<IssuedRun, Failure> {
    let method = method_of(request)?;
    let phases = PhaseCatalog::open(data, store, Some(request.phase)).await?.now(store).await?;
    let Some(phase) = find_phase(&phases, request.phase) else {
        let known = store.phases().await?;
        return Err(unknown(request.phase, known.iter().map(|phase| phase.id.as_str()).collect()));
    };
    let mut digests = phase.digests();
    digests.insert(Run::SEALED.to_owned(), enforced);
    if !missing.is_empty() {
        digests.insert(Run::UNSEALED.to_owned(), missing);
    }
    let issued = IssuedRun::random().map_err(Failure::internal)?;
    let new = NewRun {
        id: &issued.run,
        token: &issued.token,
        phase: request.phase,
        team: request.team,
        method: &method,
        order: request.order,
        client_request_id: None,
        digests: &digests,
    };
    store.start_run(&new, now_unix_ms()).await?;
    Ok(issued)
}

/// Returns the requested method, with the limits for methods of agents.
fn method_of(request: &SealedRunRequest<'_>) -> Result<MethodInfo, Failure> {
    let (name, version) = (request.method.trim(), request.version.trim());
    let limits = [
        ("--method", name, 1..=MethodInfo::MAX_NAME_CHARS),
        ("--method-version", version, 0..=MethodInfo::MAX_VERSION_CHARS),
    ];
    for (option, text, length) in limits {
        if !is_visible_text(text, &length) {
            let message = format!("{option} cannot be '{}'", text.escape_debug());
            let (least, most) = (length.start(), length.end());
            return Err(Failure::data(message).hinted(format!("use {least} to {most} printable characters")));
        }
    }
    Ok(MethodInfo { method_type: request.method_type, ..MethodInfo::new(name, version) })
}

fn unknown(phase: &str, known: Vec<&str>) -> Failure {
    let message = format!("there is no phase '{}'", phase.escape_debug());
    let hint = match known.join(", ") {
        none if none.is_empty() => "make one with: avln challenge phase open ID --split NAME".to_owned(),
        known => format!("the data folder has: {known}"),
    };
    Failure::data(message).hinted(hint)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn methods_of_sealed_runs_are_limited() {
        let check = |method: &str, version: &str| {
            let request = SealedRunRequest {
                phase: "p",
                team: "t",
                method,
                version,
                method_type: Some(MethodType::Rl),
                order: Order::Ordered,
            };
            method_of(&request)
        };
        let method = check(" walker ", "").expect("a method");
        assert_eq!((method.name.as_str(), method.version.as_str()), ("walker", ""));
        assert_eq!(method.method_type, Some(MethodType::Rl));
        assert!(check(&"x".repeat(80), &"1".repeat(40)).is_ok());
        for (method, version) in [
            ("", "1"),
            (&"x".repeat(81)[..], "1"),
            ("m\u{202e}", "1"),
            ("m", &"1".repeat(41)[..]),
            ("m", "1\n2"),
        ] {
            assert!(check(method, version).is_err(), "{method:?} {version:?}");
        }
    }
}
