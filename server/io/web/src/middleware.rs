//! Middleware for all responses: access log, limits, headers, caching and error bodies.

use crate::{
    compression::CompressedBodies,
    error::RequestError,
    live::LiveStatus,
    management::{MAX_FORM_BYTES, has_session_cookie},
    pages::{self, Menu, PageContext},
};
use axum::{
    Router,
    body::{Body, to_bytes},
    extract::{Request, State},
    http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header},
    middleware::{Next, from_fn_with_state},
    response::{IntoResponse, Response},
};
use serde_json::json;
use std::{sync::Arc, time::Duration};
use tower_http::{
    CompressionLevel,
    catch_panic::CatchPanicLayer,
    compression::{CompressionLayer, DefaultPredicate, Predicate, predicate::NotForContentType},
    limit::RequestBodyLimitLayer,
    trace::{DefaultOnFailure, DefaultOnResponse, TraceLayer},
};
use tracing::Level;

/// Size limit for addresses, bytes.
pub(crate) const MAX_ADDRESS_BYTES: usize = 2048;
const RESPONSE_TIMEOUT: Duration = Duration::from_secs(10);

/// Headers for every response. The referrer policy is not stricter because browsers send a form's origin only where they may send
/// referrers.
const HEADERS: [(HeaderName, &str); 3] = [
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "same-origin"),
    (header::VARY, "authorization, cookie, accept-encoding"),
];
const POLICY: HeaderName = header::CONTENT_SECURITY_POLICY;
/// Headers that forbid frames on other sites.
const UNFRAMED: [(HeaderName, &str); 2] = [
    (
        POLICY,
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; media-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'",
    ),
    (header::X_FRAME_OPTIONS, "DENY"),
];
/// Headers that allow frames on other sites. Embedded pages have no forms, and links open in a new tab.
const FRAMED: [(HeaderName, &str); 1] = [(
    POLICY,
    "default-src 'none'; style-src 'self'; img-src 'self'; base-uri 'self'; form-action 'none'; frame-ancestors *",
)];

/// Marks a response with a streamed body, which is neither cached nor tagged.
#[derive(Clone, Copy)]
pub(crate) struct Streaming;

/// Wraps `router` in all middleware. Pages show the announcement from `live_status`.
pub(crate) fn with_middleware(router: Router, live_status: Option<Arc<dyn LiveStatus>>) -> Router {
    // Sound does not shrink, and a player requests byte ranges of it.
    let is_compressible = DefaultPredicate::new().and(NotForContentType::const_new("audio/"));
    // The path without its query: search words do not belong into a log.
    let access_log = TraceLayer::new_for_http()
        .make_span_with(|request: &Request| {
            tracing::debug_span!("request", method = %request.method(), path = request.uri().path())
        })
        .on_request(())
        .on_response(DefaultOnResponse::new().level(Level::DEBUG))
        .on_failure(DefaultOnFailure::new().level(Level::WARN));
    router
        .layer(from_fn_with_state(Arc::<CompressedBodies>::default(), cache_and_compress))
        .layer(RequestBodyLimitLayer::new(MAX_FORM_BYTES))
        .layer(CatchPanicLayer::new())
        .layer(from_fn_with_state(live_status, finish_response))
        // For streamed and private bodies, which `cache_and_compress` leaves as they are.
        .layer(CompressionLayer::new().quality(CompressionLevel::Fastest).compress_when(is_compressible))
        .layer(access_log)
}

/// Limits time and address length, gives errors a body, and adds the headers.
async fn finish_response(
    State(live_status): State<Option<Arc<dyn LiveStatus>>>,
    request: Request,
    next: Next,
) -> Response {
    let path = request.uri().path().to_owned();
    let for_programs = path.starts_with("/api/") || path == "/readyz";
    let is_too_long = request.uri().path_and_query().is_some_and(|a| a.as_str().len() > MAX_ADDRESS_BYTES);
    let announcement = live_status.map_or_else(String::new, |status| status.announcement());
    let context = PageContext { menu: Menu::default(), announcement };
    let mut response = if is_too_long {
        RequestError::TooLong { limit: MAX_ADDRESS_BYTES }.into_response()
    } else {
        let answer = context.clone().scope(next.run(request));
        let answer = tokio::time::timeout(RESPONSE_TIMEOUT, answer).await;
        answer.unwrap_or_else(|_| RequestError::Busy.into_response())
    };
    let status = response.status();
    if status.is_client_error() || status.is_server_error() {
        response = with_error_body(response, for_programs, &path, context);
    }
    let framing: &[_] = if path.starts_with("/embed/") { &FRAMED } else { &UNFRAMED };
    for (name, value) in HEADERS.iter().chain(framing) {
        response.headers_mut().insert(name.clone(), HeaderValue::from_static(value));
    }
    if for_programs {
        response.headers_mut().insert(header::ACCESS_CONTROL_ALLOW_ORIGIN, HeaderValue::from_static("*"));
    }
    response
}

/// Gives an error its body: problem details (RFC 9457) for programs, a page for people.
fn with_error_body(bare: Response, for_programs: bool, path: &str, context: PageContext) -> Response {
    let error = bare.extensions().get::<RequestError>().cloned();
    let error = error.unwrap_or_else(|| RequestError::of_status(bare.status()));
    let menu = bare.extensions().get::<Menu>().copied().unwrap_or_default();
    let (mut parts, _) = bare.into_parts();
    let (kind, body) = if for_programs {
        ("application/problem+json", problem(&error, path))
    } else {
        let context = PageContext { menu, ..context };
        ("text/html; charset=utf-8", context.sync_scope(|| pages::error_page(&error)))
    };
    parts.status = error.status();
    parts.headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(kind));
    parts.headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    parts.headers.remove(header::CONTENT_LENGTH);
    Response::from_parts(parts, Body::from(body))
}

fn problem(error: &RequestError, path: &str) -> String {
    json!({
        "type": "about:blank",
        "title": error.title(),
        "status": error.status().as_u16(),
        "detail": error.to_string(),
        "instance": path,
        "reason": error.reason(),
    })
    .to_string()
}

/// Adds an `ETag` to successful responses, answers `If-None-Match` with 304, and compresses public bodies.
async fn cache_and_compress(
    State(compressed): State<Arc<CompressedBodies>>,
    request: Request,
    next: Next,
) -> Response {
    let accepted = request.headers().get(header::ACCEPT_ENCODING).cloned();
    let known = request.headers().get(header::IF_NONE_MATCH).cloned();
    let is_private =
        request.headers().contains_key(header::AUTHORIZATION) || has_session_cookie(request.headers());
    let is_get = request.method() == Method::GET;
    let is_post = request.method() == Method::POST;
    let mut response = next.run(request).await;
    if is_post {
        response.headers_mut().insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    }
    if !is_get || response.status() != StatusCode::OK || response.extensions().get::<Streaming>().is_some() {
        return response;
    }
    let (mut parts, body) = response.into_parts();
    // Bodies that are not streamed are in memory already, so this needs no limit.
    let Ok(body) = to_bytes(body, usize::MAX).await else { return RequestError::Internal.into_response() };
    // A weak tag, because it is the same for all encodings of the body.
    let hash = blake3::hash(&body);
    let tag = format!("W/\"{}\"", &hash.to_hex()[..32]);
    set_caching(&mut parts.headers, &tag, is_private);
    if known.is_some_and(|known| matches_tag(&known, &tag)) {
        parts.status = StatusCode::NOT_MODIFIED;
        parts.headers.remove(header::CONTENT_TYPE);
        parts.headers.remove(header::CONTENT_LENGTH);
        return Response::from_parts(parts, Body::empty());
    }
    // Private bodies must not stay in memory: `CompressionLayer` compresses them while they are sent.
    let body = if is_private {
        body
    } else {
        compressed.compress(hash, body, accepted.as_ref(), &mut parts.headers)
    };
    Response::from_parts(parts, Body::from(body))
}

/// Lets caches store public responses, with revalidation, and forbids copies of private responses.
fn set_caching(headers: &mut HeaderMap, tag: &str, is_private: bool) {
    let control = if is_private { "private, no-store" } else { "public, no-cache" };
    headers.entry(header::CACHE_CONTROL).or_insert(HeaderValue::from_static(control));
    if let Ok(tag) = HeaderValue::from_str(tag) {
        headers.insert(header::ETAG, tag);
    }
}

fn matches_tag(known: &HeaderValue, tag: &str) -> bool {
    let known = known.to_str().unwrap_or_default();
    known
        .split(',')
        .map(str::trim)
        .any(|one| one == "*" || one.trim_start_matches("W/") == tag.trim_start_matches("W/"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::routing::get;
    use http_body_util::BodyExt;
    use tower::ServiceExt;

    /// Requests an address from a router with broken handlers.
    async fn ask(address: &str) -> (StatusCode, String) {
        let broken = Router::new()
            .route("/panic", get(async || if true { panic!("a secret reason") } else { "" }))
            .route("/api/panic", get(async || if true { panic!("a secret reason") } else { "" }))
            .route("/endless", get(async || std::future::pending::<&str>().await));
        let request = Request::get(address).body(Body::empty()).expect("a request");
        let response = with_middleware(broken, None).oneshot(request).await.expect("an answer");
        let status = response.status();
        let body = response.into_body().collect().await.expect("a body").to_bytes();
        (status, String::from_utf8(body.to_vec()).expect("text"))
    }

    #[tokio::test]
    async fn panics_do_not_reveal_their_reason() {
        let (status, page) = ask("/panic").await;
        assert_eq!(status, StatusCode::INTERNAL_SERVER_ERROR);
        assert!(page.contains("<h1>Internal error</h1>") && !page.contains("secret"), "{page}");
        let (status, problem) = ask("/api/panic").await;
        assert_eq!(status, StatusCode::INTERNAL_SERVER_ERROR);
        assert!(problem.contains("\"reason\":\"INTERNAL\"") && !problem.contains("secret"), "{problem}");
    }

    #[tokio::test(start_paused = true)]
    async fn slow_responses_time_out() {
        let (status, page) = ask("/endless").await;
        assert_eq!(status, StatusCode::SERVICE_UNAVAILABLE);
        assert!(page.contains("<h1>Busy</h1>"), "{page}");
    }

    #[test]
    fn tags_are_compared_weakly() {
        let matches = |known: &'static str| matches_tag(&HeaderValue::from_static(known), "\"a\"");
        assert!(matches("\"a\"") && matches("W/\"a\"") && matches("\"b\", \"a\"") && matches("*"));
        assert!(!matches("\"b\"") && !matches("a") && !matches(""));
    }
}
