//! What holds for every answer: limits, headers, caching, and errors in the visitor's format.

use crate::{
    office::{MAX_FORM_BYTES, Menu, has_cookie},
    pages,
    press::Press,
    trouble::Trouble,
};
use axum::{
    Router,
    body::{Body, to_bytes},
    extract::{Request, State},
    http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header},
    middleware::{Next, from_fn, from_fn_with_state},
    response::{IntoResponse, Response},
};
use serde_json::json;
use std::{sync::Arc, time::Duration};
use tower_http::{
    CompressionLevel,
    catch_panic::CatchPanicLayer,
    compression::{CompressionLayer, DefaultPredicate, Predicate, predicate::NotForContentType},
    limit::RequestBodyLimitLayer,
};

/// Most bytes of an address.
pub(crate) const MAX_ADDRESS_BYTES: usize = 2048;
const ANSWER_TIMEOUT: Duration = Duration::from_secs(10);

/// Headers of every answer. Nothing is loaded from elsewhere, and nobody elsewhere is told of pages here; browsers tell the
/// origin of forms only where referrers may be told too.
const HEADERS: [(HeaderName, &str); 3] = [
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "same-origin"),
    (header::VARY, "authorization, cookie, accept-encoding"),
];
const POLICY: HeaderName = header::CONTENT_SECURITY_POLICY;
/// Headers of what no other site may show in a frame.
const ALONE: [(HeaderName, &str); 2] = [
    (
        POLICY,
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; media-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'",
    ),
    (header::X_FRAME_OPTIONS, "DENY"),
];
/// Headers of what any site may. There is nothing on it to click but links, which open elsewhere.
const FRAMED: [(HeaderName, &str); 1] = [(
    POLICY,
    "default-src 'none'; style-src 'self'; img-src 'self'; base-uri 'self'; form-action 'none'; frame-ancestors *",
)];

/// Marks an answer that is read from a file while it is sent: nobody keeps copies of it.
#[derive(Clone, Copy)]
pub(crate) struct Streamed;

/// Puts the guard around `router`.
pub(crate) fn guarded(router: Router) -> Router {
    // Noise is no shorter when it is packed, and a player asks for parts of it.
    let is_packed = DefaultPredicate::new().and(NotForContentType::const_new("audio/"));
    router
        .layer(from_fn_with_state(Arc::<Press>::default(), cached))
        .layer(RequestBodyLimitLayer::new(MAX_FORM_BYTES))
        .layer(CatchPanicLayer::new())
        .layer(from_fn(dressed))
        // What is streamed is compressed on its way.
        .layer(CompressionLayer::new().quality(CompressionLevel::Fastest).compress_when(is_packed))
}

/// Limits time and length, gives errors a body and every answer its headers.
async fn dressed(request: Request, next: Next) -> Response {
    let path = request.uri().path().to_owned();
    let for_programs = path.starts_with("/api/") || path == "/readyz";
    let too_long = request.uri().path_and_query().is_some_and(|a| a.as_str().len() > MAX_ADDRESS_BYTES);
    let mut response = if too_long {
        Trouble::TooLong { limit: MAX_ADDRESS_BYTES }.into_response()
    } else {
        let answer = tokio::time::timeout(ANSWER_TIMEOUT, next.run(request)).await;
        answer.unwrap_or_else(|_| Trouble::Busy.into_response())
    };
    let status = response.status();
    if status.is_client_error() || status.is_server_error() {
        response = explained(response, for_programs, &path);
    }
    let framing: &[_] = if path.starts_with("/embed/") { &FRAMED } else { &ALONE };
    for (name, value) in HEADERS.iter().chain(framing) {
        response.headers_mut().insert(name.clone(), HeaderValue::from_static(value));
    }
    if for_programs {
        response.headers_mut().insert(header::ACCESS_CONTROL_ALLOW_ORIGIN, HeaderValue::from_static("*"));
    }
    response
}

/// An error with a body: problem details (RFC 9457) for programs, a page for people.
fn explained(bare: Response, for_programs: bool, path: &str) -> Response {
    let trouble = bare.extensions().get::<Trouble>().cloned();
    let trouble = trouble.unwrap_or_else(|| Trouble::of_status(bare.status()));
    let menu = bare.extensions().get::<Menu>().copied().unwrap_or_default();
    let (mut parts, _) = bare.into_parts();
    let (kind, body) = if for_programs {
        ("application/problem+json", problem(&trouble, path))
    } else {
        ("text/html; charset=utf-8", menu.around(|| pages::trouble(&trouble)))
    };
    parts.status = trouble.status();
    parts.headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(kind));
    parts.headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    parts.headers.remove(header::CONTENT_LENGTH);
    Response::from_parts(parts, Body::from(body))
}

fn problem(trouble: &Trouble, path: &str) -> String {
    json!({
        "type": "about:blank",
        "title": trouble.title(),
        "status": trouble.status().as_u16(),
        "detail": trouble.to_string(),
        "instance": path,
        "reason": trouble.reason(),
    })
    .to_string()
}

/// Tags good answers with a hash of their body, says when the visitor has that body already, and compresses it otherwise.
async fn cached(State(press): State<Arc<Press>>, request: Request, next: Next) -> Response {
    let accepted = request.headers().get(header::ACCEPT_ENCODING).cloned();
    let known = request.headers().get(header::IF_NONE_MATCH).cloned();
    let private = request.headers().contains_key(header::AUTHORIZATION) || has_cookie(request.headers());
    let (is_get, is_post) = (request.method() == Method::GET, request.method() == Method::POST);
    let mut response = next.run(request).await;
    if is_post {
        response.headers_mut().insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    }
    if !is_get || response.status() != StatusCode::OK || response.extensions().get::<Streamed>().is_some() {
        return response;
    }
    let (mut parts, body) = response.into_parts();
    // Every other body is in memory already.
    let Ok(body) = to_bytes(body, usize::MAX).await else { return Trouble::Internal.into_response() };
    // Weak, for it is the same however the body is compressed.
    let hash = blake3::hash(&body);
    let tag = format!("W/\"{}\"", &hash.to_hex()[..32]);
    set_caching(&mut parts.headers, &tag, private);
    if known.is_some_and(|known| matches_tag(&known, &tag)) {
        parts.status = StatusCode::NOT_MODIFIED;
        parts.headers.remove(header::CONTENT_TYPE);
        parts.headers.remove(header::CONTENT_LENGTH);
        return Response::from_parts(parts, Body::empty());
    }
    // What a token opened is kept by nobody, here neither; it is compressed on its way.
    let body = if private { body } else { press.packed(hash, body, accepted.as_ref(), &mut parts.headers) };
    Response::from_parts(parts, Body::from(body))
}

/// Copies are kept but asked for again; what a token or a session opened is kept by nobody.
fn set_caching(headers: &mut HeaderMap, tag: &str, private: bool) {
    let control = if private { "private, no-store" } else { "public, no-cache" };
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

    /// Status and body of the answer at `address` of a router where everything breaks.
    async fn ask(address: &str) -> (StatusCode, String) {
        let broken = Router::new()
            .route("/panic", get(async || if true { panic!("a secret reason") } else { "" }))
            .route("/api/panic", get(async || if true { panic!("a secret reason") } else { "" }))
            .route("/endless", get(async || std::future::pending::<&str>().await));
        let request = Request::get(address).body(Body::empty()).expect("a request");
        let response = guarded(broken).oneshot(request).await.expect("an answer");
        let status = response.status();
        let body = response.into_body().collect().await.expect("a body").to_bytes();
        (status, String::from_utf8(body.to_vec()).expect("text"))
    }

    #[tokio::test]
    async fn a_panic_is_an_answer_without_its_reason() {
        let (status, page) = ask("/panic").await;
        assert_eq!(status, StatusCode::INTERNAL_SERVER_ERROR);
        assert!(page.contains("<h1>Something broke</h1>") && !page.contains("secret"), "{page}");
        let (status, problem) = ask("/api/panic").await;
        assert_eq!(status, StatusCode::INTERNAL_SERVER_ERROR);
        assert!(problem.contains("\"reason\":\"INTERNAL\"") && !problem.contains("secret"), "{problem}");
    }

    #[tokio::test(start_paused = true)]
    async fn an_answer_that_takes_too_long_is_given_up() {
        let (status, page) = ask("/endless").await;
        assert_eq!(status, StatusCode::SERVICE_UNAVAILABLE);
        assert!(page.contains("<h1>Busy</h1>"), "{page}");
    }

    #[test]
    fn tags_are_compared_weakly_and_in_lists() {
        let matches = |known: &'static str| matches_tag(&HeaderValue::from_static(known), "\"a\"");
        assert!(matches("\"a\"") && matches("W/\"a\"") && matches("\"b\", \"a\"") && matches("*"));
        assert!(!matches("\"b\"") && !matches("a") && !matches(""));
    }
}
