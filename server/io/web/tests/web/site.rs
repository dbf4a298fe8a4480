//! Site with recorded actions, and browsers that use it.

use crate::{Answer, Arena, RUDE_TEAM};
use avln_store::{AuditNote, Store, TokenScope};
use avln_web::{
    ActionError, ActionOrigin, ActionOutcome, Management, OrganiserAction, ServerHealth, TeamAction,
    TeamCredential, async_trait,
};
use axum::{
    body::Body,
    http::{Request, StatusCode, header},
};
use std::sync::{Arc, Mutex};

pub(crate) const READ_ONLY: &str = "a-read-only-token";
pub(crate) const NEW_SECRET: &str = "avln_account_shown-once";

/// Management that records actions, and executes rulings on runs.
#[derive(Debug)]
struct FakeManagement {
    store: Store,
    asked: Arc<Mutex<Vec<String>>>,
}

impl FakeManagement {
    fn note(&self, asked: String) {
        self.asked.lock().expect("no panic").push(asked);
    }
}

#[async_trait]
impl Management for FakeManagement {
    async fn team_action(
        &self,
        team: TeamCredential,
        action: TeamAction,
    ) -> Result<ActionOutcome, ActionError> {
        self.note(format!("{}: {action:?}", team.team));
        let secret = matches!(action, TeamAction::IssueToken { .. }).then(|| NEW_SECRET.to_owned());
        Ok(ActionOutcome { message: "It is <done>.".to_owned(), secret })
    }

    async fn organiser_action(
        &self,
        origin: ActionOrigin,
        action: OrganiserAction,
    ) -> Result<ActionOutcome, ActionError> {
        self.note(format!("organiser: {action:?} because {}", origin.reason));
        let store = &self.store;
        let reason = origin.reason.as_str();
        let note = AuditNote { actor: origin.token, reason: origin.reason.clone(), ..AuditNote::default() };
        let mut secret = None;
        match &action {
            OrganiserAction::Disqualify(run) => store.disqualify_run(run, Some(reason), note, 50).await,
            OrganiserAction::Reinstate(run) => store.disqualify_run(run, None, note, 60).await,
            OrganiserAction::Verify { run, verified } => store.verify_run(run, *verified, note, 70).await,
            OrganiserAction::Admit { .. } => {
                secret = Some(NEW_SECRET.to_owned());
                Ok(true)
            }
            OrganiserAction::Grant { .. } => {
                return Err(ActionError::Refused("no such team".to_owned()));
            }
            _ => Ok(true),
        }
        .map_err(|error| ActionError::Failed(error.to_string()))?;
        Ok(ActionOutcome { message: format!("{action:?} is done."), secret })
    }

    fn health(&self) -> ServerHealth {
        ServerHealth { steps: 4321, slots: vec![("run_begun".to_owned(), 2, 77)], ..ServerHealth::default() }
    }
}

/// A browser with a session cookie, if signed in.
pub(crate) struct Browser<'a> {
    arena: &'a Arena,
    pub(crate) cookie: String,
}

/// Web application with [`FakeManagement`].
pub(crate) struct Site {
    pub(crate) arena: Arena,
    asked: Arc<Mutex<Vec<String>>>,
}

impl Site {
    pub(crate) async fn new() -> Self {
        let asked = Arc::<Mutex<Vec<String>>>::default();
        let management =
            |store| Arc::new(FakeManagement { store, asked: asked.clone() }) as Arc<dyn Management>;
        let arena = Arena::with_management(management).await;
        arena.issue(READ_ONLY, TokenScope::ReadOnly, Some(RUDE_TEAM)).await;
        Self { arena, asked }
    }

    /// Returns another management with the same store and record.
    pub(crate) fn management(&self) -> Arc<dyn Management> {
        Arc::new(FakeManagement { store: self.arena.store.clone(), asked: self.asked.clone() })
    }

    pub(crate) fn asked(&self) -> Vec<String> {
        self.asked.lock().expect("no panic").clone()
    }

    pub(crate) fn stranger(&self) -> Browser<'_> {
        Browser { arena: &self.arena, cookie: String::new() }
    }

    pub(crate) async fn signed_in(&self, token: &str) -> Browser<'_> {
        let mut browser = self.stranger();
        let answer = browser.sign_in(token, "").await;
        assert_eq!(answer.status, StatusCode::SEE_OTHER, "{}", answer.body);
        browser
    }
}

impl Browser<'_> {
    pub(crate) fn request(&self, method: &str, address: &str) -> axum::http::request::Builder {
        let request = Request::builder().method(method).uri(address).header(header::HOST, "arena.example");
        // Answers to the same request are equal with the same id.
        let request = request.header("x-request-id", "req_0123456789ab");
        if self.cookie.is_empty() { request } else { request.header(header::COOKIE, &self.cookie) }
    }

    pub(crate) async fn get(&self, address: &str) -> Answer {
        self.arena.ask(self.request("GET", address).body(Body::empty()).expect("a request")).await
    }

    /// Sends a form from a page of the same origin.
    pub(crate) async fn post(&self, address: &str, fields: &str) -> Answer {
        let request = self.request("POST", address).header("sec-fetch-site", "same-origin");
        self.arena.ask(request.body(Body::from(fields.to_owned())).expect("a request")).await
    }

    /// Sends a form with the form key of the session.
    pub(crate) async fn act(&self, address: &str, fields: &str) -> Answer {
        self.post(address, &format!("{fields}&key={}", self.key().await)).await
    }

    pub(crate) async fn key(&self) -> String {
        let page = self.get("/me").await.body + &self.get("/organise").await.body;
        let rest = page.split_once("name=\"key\" value=\"").expect("a form").1;
        rest.split('"').next().expect("a key").to_owned()
    }

    pub(crate) async fn sign_in(&mut self, token: &str, next: &str) -> Answer {
        let answer = self.post("/sign-in", &format!("token=+{token}%0A&next={next}")).await;
        let cookie = answer.header(header::SET_COOKIE);
        self.cookie = cookie.split(';').next().unwrap_or_default().to_owned();
        answer
    }
}
