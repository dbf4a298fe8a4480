//! Requests to the web server: a line with the address, a line per header, an empty line, and a form, if any.
#![no_main]

use avln_store::Store;
use avln_web::{
    ActionError, ActionOrigin, ActionOutcome, Management, OrganiserAction, ServerHealth, Site, TeamAction,
    TeamCredential, async_trait,
};
use axum::{Router, body::Body, http::Request};
use std::sync::{Arc, OnceLock};
use tempfile::TempDir;
use tokio::runtime::{Builder, Runtime};
use tower::ServiceExt;

/// Management that refuses every action.
#[derive(Debug)]
struct Refusal;

#[async_trait]
impl Management for Refusal {
    async fn team_action(&self, _: TeamCredential, _: TeamAction) -> Result<ActionOutcome, ActionError> {
        Err(ActionError::Refused("no action".to_owned()))
    }

    async fn organiser_action(
        &self,
        _: ActionOrigin,
        _: OrganiserAction,
    ) -> Result<ActionOutcome, ActionError> {
        Err(ActionError::Refused("no action".to_owned()))
    }

    fn health(&self) -> ServerHealth {
        ServerHealth::default()
    }
}

struct Server {
    runtime: Runtime,
    router: Router,
    _folder: TempDir,
}

impl Server {
    /// Returns a server with an empty database.
    fn new() -> Self {
        let runtime = Builder::new_current_thread().enable_all().build().expect("a runtime");
        let folder = tempfile::tempdir().expect("a folder");
        let router = runtime.block_on(async {
            let store = Store::open(&folder.path().join("arena.db")).await.expect("a new database");
            let management: Arc<dyn Management> = Arc::new(Refusal);
            avln_web::router(store.reader(), Site { management: Some(management), ..Site::default() })
        });
        Self { runtime, router, _folder: folder }
    }
}

fn request(bytes: &[u8]) -> Option<Request<Body>> {
    let text = String::from_utf8_lossy(bytes);
    let (head, form) = text.split_once("\n\n").unwrap_or((&text[..], ""));
    let mut lines = head.lines();
    let method = if form.is_empty() { "GET" } else { "POST" };
    let mut request = Request::builder().method(method).uri(lines.next()?);
    for (name, value) in lines.filter_map(|line| line.split_once(": ")) {
        request = request.header(name, value);
    }
    request.body(Body::from(form.to_owned())).ok()
}

static SERVER: OnceLock<Server> = OnceLock::new();

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let Some(request) = request(bytes) else { return };
    let server = SERVER.get_or_init(Server::new);
    // The body of a response can be an endless stream of events: it is not read.
    server.runtime.block_on(async { drop(server.router.clone().oneshot(request).await) });
});
