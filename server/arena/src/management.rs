//! Management actions for signed-in users, and live status for visitors. Audit entries contain the user's
//! token prefix.

use crate::{
    Arena,
    actions::{self, ActionFailure, Attribution, TokenRequest, note, reschedule},
    admin, fault_count,
    phases::seed_to_publish,
};
use avln_grpc::{Control, SessionState, SlotState};
use avln_store::{AuditNote, NewGrant, StoreError, TokenScope, calendar::rfc3339};
use avln_web::{
    ActionError, ActionOrigin, ActionOutcome, LiveSession, LiveSlot, LiveStatus, Management, OrganiserAction,
    ServerHealth, TeamAction, TeamCredential, async_trait,
};
use std::{fmt, sync::Arc, time::Duration};

/// Limit for valid tokens per team: several per member.
const MOST_TOKENS: usize = 50;
const DAY_MS: i64 = 86_400_000;

pub(crate) struct ArenaManagement(pub(crate) Arc<Arena>);

impl fmt::Debug for ArenaManagement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("ArenaManagement")
    }
}

#[async_trait]
impl Management for ArenaManagement {
    async fn team_action(
        &self,
        team: TeamCredential,
        action: TeamAction,
    ) -> Result<ActionOutcome, ActionError> {
        Ok(act(&self.0, &team, action).await?)
    }

    async fn organiser_action(
        &self,
        origin: ActionOrigin,
        action: OrganiserAction,
    ) -> Result<ActionOutcome, ActionError> {
        Ok(organise(&self.0, &origin, action).await?)
    }

    fn health(&self) -> ServerHealth {
        let admin::Status { draining, notice, slots, steps, scene_bytes, hanging } =
            admin::status_of(&self.0);
        let slots = slots.into_iter().map(|slot| (slot.run, slot.slot, slot.step)).collect();
        ServerHealth { draining, notice, slots, steps, scene_bytes, hanging, faults: fault_count() }
    }
}

impl From<ActionFailure> for ActionError {
    fn from(undone: ActionFailure) -> Self {
        match undone {
            ActionFailure::Refused { words, hint: "" } => Self::Refused(words),
            ActionFailure::Refused { words, hint } => Self::Refused(format!("{words}; {hint}")),
            ActionFailure::Store(error) if error.is_fault() => Self::Failed(error.to_string()),
            ActionFailure::Store(error) => Self::Refused(error.to_string()),
            ActionFailure::System(error) => Self::Failed(error),
        }
    }
}

type Answer = Result<ActionOutcome, ActionFailure>;

fn done(words: String) -> Answer {
    Ok(ActionOutcome { message: words, secret: None })
}

async fn act(arena: &Arena, member: &TeamCredential, action: TeamAction) -> Answer {
    let actor = format!("token {} of team {}", member.token, member.team);
    match action {
        TeamAction::IssueToken { name, looks_only, days } => {
            issue(arena, member, &actor, &name, looks_only, days).await
        }
        TeamAction::RevokeToken { id } => {
            let revoked = note(&actor, format!("token {id}"), "revoked", "");
            arena.store.revoke_own_token(&member.team, &id, revoked, arena.clock.now_unix_ms()).await?;
            done(format!("Token {id} is revoked."))
        }
        TeamAction::CancelRun { run } => cancel(arena, member, &actor, &run).await,
    }
}

async fn issue(
    arena: &Arena,
    member: &TeamCredential,
    actor: &str,
    name: &str,
    looks_only: bool,
    days: Option<u32>,
) -> Answer {
    let (store, now) = (&arena.store, arena.clock.now_unix_ms());
    let tokens = store.tokens().await?;
    let is_own = |team: &Option<String>| team.as_deref() == Some(member.team.as_str());
    let holds = |revoked: Option<i64>, expires: Option<i64>| {
        revoked.is_none() && expires.is_none_or(|expires| expires > now)
    };
    let held = tokens.iter().filter(|t| is_own(&t.team) && holds(t.revoked_ms, t.expires_ms)).count();
    if held >= MOST_TOKENS {
        let words = format!("the team has {held} valid tokens, the largest number");
        return Err(ActionFailure::refused(words, "revoke an unused token first"));
    }
    let asked = days.map(|days| now + i64::from(days) * DAY_MS);
    let request = TokenRequest {
        kind: if looks_only { TokenScope::ReadOnly } else { TokenScope::Participant },
        name,
        team: Some(&member.team),
        expires_unix_ms: [asked, member.expires_unix_ms].into_iter().flatten().min(),
    };
    let secret = actions::issue(store, &request, actor, now).await?;
    let until =
        request.expires_unix_ms.map_or_else(String::new, |moment| format!(" until {}", rfc3339(moment)));
    Ok(ActionOutcome { message: format!("The token is valid{until}."), secret: Some(secret) })
}

async fn cancel(arena: &Arena, member: &TeamCredential, actor: &str, run: &str) -> Answer {
    let found = arena.store.run(run).await?;
    if found.team != member.team {
        return Err(StoreError::Unknown { what: "run", name: run.to_owned() }.into());
    }
    if !found.state.is_open() {
        let state = found.state.as_str();
        return Err(StoreError::RunOver { run: run.to_owned(), state }.into());
    }
    arena.cancel(run).await?;
    // After the database: a client that reconnects must find the run cancelled.
    arena.control().leave(run);
    let cancelled = note(actor, format!("run {run}"), "cancelled", "");
    arena.store.add_audit_note(cancelled, arena.clock.now_unix_ms()).await?;
    done(format!("Run {run} is cancelled."))
}

async fn organise(arena: &Arena, origin: &ActionOrigin, action: OrganiserAction) -> Answer {
    let actor = format!("token {} of the organiser", origin.token);
    let by = Attribution { actor: &actor, reason: &origin.reason };
    match action {
        OrganiserAction::Admit { team } => admit(arena, &actor, &origin.reason, &team).await,
        OrganiserAction::Approve { team, phase, approved } => {
            let word = if approved { "approved" } else { "no more approved" };
            let decided =
                note(&actor, format!("team {team}"), &format!("{word} in phase {phase}"), &origin.reason);
            arena.store.approve(&phase, &team, approved, decided, arena.clock.now_unix_ms()).await?;
            done(format!("Team {team} is {word} in phase {phase}."))
        }
        OrganiserAction::Grant { team, phase, runs } => {
            let grant = NewGrant { phase: &phase, team: &team, runs, reason: &origin.reason };
            let granted =
                note(&actor, format!("team {team}"), &format!("granted in phase {phase}"), &origin.reason);
            let granted = AuditNote { after: Some(format!("{runs} runs")), ..granted };
            arena.store.grant(&grant, granted, arena.clock.now_unix_ms()).await?;
            done(format!("Team {team} has {runs} more runs in phase {phase}."))
        }
        OrganiserAction::Verify { run, verified } => {
            done(sentence(&actions::verify(&arena.store, &run, verified, by).await?))
        }
        OrganiserAction::Disqualify(run) => {
            done(sentence(&actions::disqualify(&arena.store, &run, true, by).await?))
        }
        OrganiserAction::Reinstate(run) => {
            done(sentence(&actions::disqualify(&arena.store, &run, false, by).await?))
        }
        of_phase => rule_phase(arena, by, of_phase).await,
    }
}

async fn admit(arena: &Arena, actor: &str, reason: &str, team: &str) -> Answer {
    let (store, now) = (&arena.store, arena.clock.now_unix_ms());
    let secret = actions::admit(store, team, None, now).await?;
    let admitted = note(actor, format!("team {team}"), "admitted, token for account", reason);
    store.add_audit_note(admitted, now).await?;
    let message = format!("Team {team} is admitted, and has a new account token.");
    Ok(ActionOutcome { message, secret: Some(secret) })
}

fn sentence(words: &str) -> String {
    let mut letters = words.chars();
    let first = letters.next().map(|letter| letter.to_uppercase().to_string()).unwrap_or_default();
    format!("{first}{}.", letters.as_str())
}

async fn rule_phase(arena: &Arena, by: Attribution<'_>, action: OrganiserAction) -> Answer {
    let store = &arena.store;
    match action {
        OrganiserAction::Pause(id) => {
            let words = by.reason.to_owned();
            reschedule(store, &id, by, |schedule| schedule.paused = Some(words)).await?;
            done(format!("Phase {id} is paused; started runs continue."))
        }
        OrganiserAction::Resume(id) => {
            let change = |schedule: &mut avln_store::Schedule| {
                (schedule.paused, schedule.closed) = (None, false);
            };
            let phase = reschedule(store, &id, by, change).await?;
            done(format!(
                "Phase {id} is {}.",
                actions::state_word(phase.schedule.state(arena.clock.now_unix_ms()))
            ))
        }
        OrganiserAction::Close(id) => {
            reschedule(store, &id, by, |schedule| schedule.closed = true).await?;
            done(format!("Phase {id} is closed; its results remain."))
        }
        OrganiserAction::Reveal(id) => {
            let revealed = note(by.actor, format!("phase {id}"), "revealed", by.reason);
            let seed = seed_to_publish(&arena.phases.data, store, &id).await;
            let seed = seed.map_err(|failure| ActionFailure::System(failure.to_string()))?;
            store.reveal_phase(&id, seed.as_ref(), revealed, arena.clock.now_unix_ms()).await?;
            done(format!("The committed values of phase {id} are published."))
        }
        other => Err(ActionFailure::System(format!("{other:?} is not a phase action"))),
    }
}

#[derive(Clone, Debug)]
pub(crate) struct ControlStatus(pub(crate) Control);

impl LiveStatus for ControlStatus {
    fn session(&self, run: &str) -> Option<LiveSession> {
        let SessionState { is_there, slots } = self.0.session(run)?;
        Some(LiveSession { is_connected: is_there, slots: slots.iter().map(live_slot).collect() })
    }

    fn draining(&self) -> Option<String> {
        self.0.draining().map(|drain| drain.reason)
    }

    fn announcement(&self) -> String {
        self.0.announcement()
    }
}

fn live_slot(slot: &SlotState) -> LiveSlot {
    LiveSlot {
        slot: slot.slot,
        step: slot.step,
        last_step_s: slot.last_step.as_ref().map(Duration::as_secs_f64),
        mean_step_s: slot.mean_step.as_ref().map(Duration::as_secs_f64),
        since_unix_ms: slot.at_unix_ms,
    }
}
