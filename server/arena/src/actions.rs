//! Organiser actions shared by commands and pages, and the start of sealed runs.

use crate::{
    Failure, challenge,
    data::DataFolder,
    ids::{IssuedRun, new_token},
    now_unix_ms,
    phases::{PhaseCatalog, find_phase},
};
use avln_challenge::{
    MethodInfo, MethodType,
    names::{is_visible, is_visible_text, look_alike_form, mixes_scripts},
};
use avln_episode::Order;
use avln_store::{
    AuditNote, NewRun, NewToken, Phase, PhaseState, Reference, Run, Schedule, Store, StoreError, TokenScope,
};

/// A failed action.
#[derive(Debug)]
pub enum ActionFailure {
    /// A refusal.
    Refused {
        /// Reason.
        words: String,
        /// Next step; may be empty.
        hint: &'static str,
    },
    /// A store error.
    Store(StoreError),
    /// A system error.
    System(String),
}

impl ActionFailure {
    pub(crate) fn refused(words: impl Into<String>, hint: &'static str) -> Self {
        Self::Refused { words: words.into(), hint }
    }
}

impl From<StoreError> for ActionFailure {
    fn from(error: StoreError) -> Self {
        Self::Store(error)
    }
}

impl From<ActionFailure> for Failure {
    fn from(failure: ActionFailure) -> Self {
        match failure {
            ActionFailure::Refused { words, hint } => {
                let failure = Self::data(words);
                if hint.is_empty() { failure } else { failure.hinted(hint) }
            }
            ActionFailure::Store(error) => error.into(),
            ActionFailure::System(error) => Self::internal(error),
        }
    }
}

/// Actor and reason for audit entries.
#[derive(Clone, Copy, Debug)]
pub struct Attribution<'a> {
    /// Actor.
    pub actor: &'a str,
    /// Reason; may be empty.
    pub reason: &'a str,
}

/// Returns an audit entry.
pub fn note(actor: &str, subject: String, what: &str, reason: &str) -> AuditNote {
    let (actor, what, reason) = (actor.to_owned(), what.to_owned(), reason.to_owned());
    AuditNote { actor, subject, what, reason, ..AuditNote::default() }
}

/// A token request.
#[derive(Clone, Copy, Debug)]
pub struct TokenRequest<'a> {
    /// Scope; not a run token.
    pub kind: TokenScope,
    /// Name; may be empty.
    pub name: &'a str,
    /// Team; `None` for an organiser.
    pub team: Option<&'a str>,
    /// Expiry time, Unix milliseconds; `None` if the token never expires.
    pub expires_unix_ms: Option<i64>,
}

/// Admits a new or former team and returns an account token.
pub async fn admit(
    store: &Store,
    name: &str,
    reference: Option<Reference>,
    now_unix_ms: i64,
) -> Result<String, ActionFailure> {
    if store.team(name).await?.is_none() {
        check_new_name(store, name).await?;
    }
    let kind = TokenScope::Participant;
    let secret = random_token(kind)?;
    store.create_team(name, reference, now_unix_ms).await?;
    let token = NewToken { secret: &secret, kind, name: "", team: Some(name), expires_unix_ms: None };
    store.issue_token(&token, now_unix_ms).await?;
    Ok(secret)
}

/// Rejects a name that is invisible, or that people confuse with the name of another team.
async fn check_new_name(store: &Store, name: &str) -> Result<(), ActionFailure> {
    let shown = name.escape_debug();
    if name.trim().is_empty() || name.len() > 64 || !name.chars().all(is_visible) {
        let words = format!("'{shown}' cannot be the name of a team");
        return Err(ActionFailure::refused(words, "use 1 to 64 bytes of printable text"));
    }
    if mixes_scripts(name) {
        let words = format!("the team name '{shown}' mixes Latin letters with Greek or Cyrillic ones");
        return Err(ActionFailure::refused(words, "use the letters of a single script"));
    }
    let form = look_alike_form(name);
    let names = store.team_names().await?;
    match names.iter().find(|known| look_alike_form(known) == form) {
        Some(known) => {
            let words = format!("the team name '{shown}' looks like that of team '{}'", known.escape_debug());
            Err(ActionFailure::refused(words, "use a name that nobody confuses with it"))
        }
        None => Ok(()),
    }
}

/// Issues a token, with an audit entry.
pub async fn issue(
    store: &Store,
    request: &TokenRequest<'_>,
    actor: &str,
    now_unix_ms: i64,
) -> Result<String, ActionFailure> {
    let TokenRequest { kind, name, team, expires_unix_ms } = *request;
    if !is_visible_text(name, &(0..=64)) {
        return Err(ActionFailure::refused("a token name has at most 64 printable characters", ""));
    }
    let secret = random_token(kind)?;
    let token = NewToken { secret: &secret, kind, name, team, expires_unix_ms };
    store.issue_token(&token, now_unix_ms).await?;
    let whose = team.map_or_else(|| "organiser".to_owned(), |team| format!("team {team}"));
    let issued = note(actor, whose, &format!("token for {}", word(kind)), "");
    let name = Some(name.to_owned()).filter(|name| !name.is_empty());
    store.add_audit_note(AuditNote { after: name, ..issued }, now_unix_ms).await?;
    Ok(secret)
}

/// Returns the word for a scope in token prefixes and audit entries.
fn word(kind: TokenScope) -> &'static str {
    match kind {
        TokenScope::Participant => "account",
        TokenScope::ReadOnly => "looking",
        TokenScope::Organiser => "organiser",
        TokenScope::Run => "run",
    }
}

fn random_token(kind: TokenScope) -> Result<String, ActionFailure> {
    new_token(word(kind)).map_err(|error| ActionFailure::System(error.to_string()))
}

/// Changes a phase's schedule, with audit entries.
pub async fn reschedule(
    store: &Store,
    id: &str,
    by: Attribution<'_>,
    change: impl FnOnce(&mut Schedule),
) -> Result<Phase, StoreError> {
    let before = store.phase(id).await?;
    let mut after = before.clone();
    change(&mut after.schedule);
    let notes = challenge::notes(by.actor, Some(&before), &after, by.reason);
    if !notes.is_empty() {
        store.change_phases(std::slice::from_ref(&after), &notes, now_unix_ms()).await?;
    }
    Ok(after)
}

/// Sets or removes an ended run's verified mark; returns a message.
pub async fn verify(
    store: &Store,
    run: &str,
    verified: bool,
    by: Attribution<'_>,
) -> Result<String, StoreError> {
    let word = if verified { "verified" } else { "no more verified" };
    let ruled = note(by.actor, format!("run {run}"), word, by.reason);
    let changed = store.verify_run(run, verified, ruled, now_unix_ms()).await?;
    Ok(format!("run {run} is {word}{}", as_before(changed)))
}

/// Disqualifies a run, or reinstates it; returns a message. The reason is public.
pub async fn disqualify(
    store: &Store,
    run: &str,
    disqualified: bool,
    by: Attribution<'_>,
) -> Result<String, StoreError> {
    let what = if disqualified { "disqualified" } else { "put back on boards" };
    let ruled = note(by.actor, format!("run {run}"), what, by.reason);
    let public = disqualified.then_some(by.reason);
    let changed = store.disqualify_run(run, public, ruled, now_unix_ms()).await?;
    let effect = if disqualified {
        "is removed from leaderboards; its page shows the reason"
    } else {
        "can appear on leaderboards again"
    };
    Ok(format!("run {run} {effect}{}", as_before(changed)))
}

fn as_before(changed: bool) -> &'static str {
    if changed { "" } else { ", as before" }
}

/// Returns the word for the state after a resume.
pub fn state_word(state: PhaseState) -> &'static str {
    match state {
        PhaseState::Upcoming => "not open before its date",
        PhaseState::Open => "open",
        PhaseState::Paused => "paused",
        PhaseState::Closed => "closed since its date",
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

    #[tokio::test]
    async fn new_teams_have_names_of_their_own() {
        let folder = tempfile::tempdir().expect("a folder");
        let store = Store::open(&folder.path().join("arena.db")).await.expect("a database");
        let refused = async |name: &str| match admit(&store, name, None, 1).await {
            Err(ActionFailure::Refused { words, .. }) => words,
            other => panic!("{name} was not refused: {other:?}"),
        };
        admit(&store, "Mallory", None, 1).await.expect("a new team");
        admit(&store, "Mallory", None, 2).await.expect("the same team again");
        admit(&store, "\u{41c}\u{438}\u{440}", None, 2).await.expect("a single script");
        for hidden in ["", " ", "two\nlines", "\u{200b}", "Ada\u{202e}"] {
            assert!(refused(hidden).await.contains("cannot be the name"), "{hidden:?}");
        }
        assert!(refused("M\u{430}llory").await.contains("mixes Latin letters"));
        for alike in ["mallory", "MaIlory", "Ma1l0ry", "Mallory "] {
            assert!(refused(alike).await.contains("looks like that of team 'Mallory'"), "{alike}");
        }
        let names = store.team_names().await.expect("a list");
        assert_eq!(names, ["Mallory", "\u{41c}\u{438}\u{440}"]);
    }

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
