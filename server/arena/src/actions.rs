//! Organiser actions shared by commands and pages.

use crate::{Failure, challenge, ids::new_token, now_unix_ms};
use avln_challenge::names::{is_visible, is_visible_text, look_alike_form, mixes_scripts};
use avln_store::{
    AuditNote, NewToken, Phase, PhaseState, Reference, Schedule, Store, StoreError, TokenScope,
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
}
