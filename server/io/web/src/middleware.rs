//! Middleware for all responses: access log, limits, headers, caching, compression and error bodies.

use crate::{
    error::{RequestError, RequestId, add_request_id},
    live::LiveStatus,
    management::{MAX_FORM_BYTES, has_session_cookie},
    pages,
    request::{CONTEXT, Menu, PageContext},
    server::Streaming,
};
use axum::{
    Router,
    body::{Body, Bytes, to_bytes},
    extract::{Request, State},
    http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header},
    middleware::{Next, from_fn, from_fn_with_state},
    response::{IntoResponse, Response},
};
use flate2::{Compression, write::GzEncoder};
use quick_cache::{Weighter, sync::Cache};
use serde_json::json;
use std::{
    io::{self, Write},
    sync::Arc,
    time::Duration,
};
use tower_http::{
    CompressionLevel,
    catch_panic::CatchPanicLayer,
    compression::{CompressionLayer, DefaultPredicate, Predicate, predicate::NotForContentType},
    limit::RequestBodyLimitLayer,
    trace::{DefaultOnFailure, TraceLayer},
};
use tracing::{Level, Span, field::Empty};

pub(crate) const MAX_ADDRESS_BYTES: usize = 2048;
const RESPONSE_TIMEOUT: Duration = Duration::from_secs(10);

// Cache size, bytes: some thousands of pages.
const CACHE_BYTES: u64 = 32 << 20;
// Typical compressed page, bytes; an estimate for the cache.
const TYPICAL_BYTES: usize = 8 << 10;
// Bodies below this size fit into a single packet without compression, bytes.
const MIN_BYTES: usize = 1024;

// Headers for every response. The referrer policy is not stricter because browsers send a form's origin only where they may send
// referrers.
static HEADERS: [(HeaderName, &str); 3] = [
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "same-origin"),
    (
        HeaderName::from_static("permissions-policy"),
        "camera=(), microphone=(), geolocation=(), payment=(), usb=()",
    ),
];
const VARY: &str = "authorization, cookie, accept-encoding";
// Without canonical addresses, pages contain the host of the request.
const VARY_BY_HOST: &str = "authorization, cookie, accept-encoding, host";
// A year: browsers then use only TLS for this host.
const ONLY_TLS: (HeaderName, &str) = (header::STRICT_TRANSPORT_SECURITY, "max-age=31536000");
// Headers with which pages of other sites may read the API, also with a token and with revalidation.
static SHARED: [(HeaderName, &str); 2] = [
    (header::ACCESS_CONTROL_ALLOW_ORIGIN, "*"),
    (header::ACCESS_CONTROL_EXPOSE_HEADERS, "etag, x-request-id"),
];
static PREFLIGHT: [(HeaderName, &str); 3] = [
    (header::ACCESS_CONTROL_ALLOW_METHODS, "GET, HEAD"),
    (header::ACCESS_CONTROL_ALLOW_HEADERS, "authorization, if-none-match"),
    (header::ACCESS_CONTROL_MAX_AGE, "86400"),
];
const POLICY: HeaderName = header::CONTENT_SECURITY_POLICY;
static UNFRAMED: [(HeaderName, &str); 3] = [
    (
        POLICY,
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; media-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'",
    ),
    (header::X_FRAME_OPTIONS, "DENY"),
    (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
];
// Headers that allow frames on other sites. Embedded pages have no forms, and links open in a new tab.
static FRAMED: [(HeaderName, &str); 1] = [(
    POLICY,
    "default-src 'none'; style-src 'self'; img-src 'self'; base-uri 'self'; form-action 'none'; frame-ancestors *",
)];

/// Settings for all responses of a site.
#[derive(Clone, Debug, Default)]
pub(crate) struct ResponseSettings {
    /// Source of the announcement on pages.
    pub(crate) live_status: Option<Arc<dyn LiveStatus>>,
    /// Time of a static copy, milliseconds since 1970-01-01 UTC.
    pub(crate) frozen_unix_ms: Option<i64>,
    /// True if browsers must use TLS for this host.
    pub(crate) requires_tls: bool,
    /// True if pages depend on the `Host` header.
    pub(crate) varies_by_host: bool,
}

impl ResponseSettings {
    fn page_context(&self) -> PageContext {
        let announcement = self.live_status.as_ref().map_or_else(String::new, |status| status.announcement());
        PageContext { menu: Menu::default(), announcement, frozen_unix_ms: self.frozen_unix_ms }
    }

    fn add_headers(&self, headers: &mut HeaderMap, path: &str, for_programs: bool) {
        insert(headers, &HEADERS);
        insert(headers, &[(header::VARY, if self.varies_by_host { VARY_BY_HOST } else { VARY })]);
        let framing: &[_] = if path.starts_with("/embed/") { &FRAMED } else { &UNFRAMED };
        insert(headers, framing);
        if self.requires_tls {
            insert(headers, &[ONLY_TLS]);
        }
        if for_programs {
            insert(headers, &SHARED);
        }
    }
}

/// Wraps `router` in all middleware.
pub(crate) fn with_middleware(router: Router, settings: ResponseSettings) -> Router {
    // Sound does not shrink, and a player requests byte ranges of it.
    let is_compressible = DefaultPredicate::new().and(NotForContentType::const_new("audio/"));
    let access_log = TraceLayer::new_for_http()
        .make_span_with(request_span)
        .on_request(())
        .on_response(log_response)
        .on_failure(DefaultOnFailure::new().level(Level::WARN));
    router
        .layer(from_fn_with_state(Arc::<CompressedBodies>::default(), cache_and_compress))
        .layer(RequestBodyLimitLayer::new(MAX_FORM_BYTES))
        .layer(CatchPanicLayer::new())
        .layer(from_fn_with_state(settings, finish_response))
        // For streamed and private bodies, which `cache_and_compress` leaves as they are.
        .layer(CompressionLayer::new().quality(CompressionLevel::Fastest).compress_when(is_compressible))
        .layer(access_log)
        .layer(from_fn(add_request_id))
}

/// Creates the span of a request. Its level is error, so that every line of a request has the id.
fn request_span(request: &Request) -> Span {
    tracing::error_span!(
        "request",
        id = request.extensions().get::<RequestId>().map(tracing::field::display),
        method = %request.method(),
        // Without the query: search words do not belong into a log.
        path = request.uri().path(),
        status = Empty,
        duration_ms = Empty
    )
}

fn log_response<B>(response: &axum::http::Response<B>, took: Duration, span: &Span) {
    span.record("status", response.status().as_u16());
    span.record("duration_ms", took.as_micros() as f64 / 1000.0);
    tracing::debug!("request ended");
}

/// Limits time and address length, and adds error bodies and headers.
async fn finish_response(State(settings): State<ResponseSettings>, request: Request, next: Next) -> Response {
    let path = request.uri().path().to_owned();
    let id = request.extensions().get::<RequestId>().map(RequestId::to_string).unwrap_or_default();
    let for_programs = path.starts_with("/api/") || path == "/readyz";
    let is_too_long = request.uri().path_and_query().is_some_and(|a| a.as_str().len() > MAX_ADDRESS_BYTES);
    let context = settings.page_context();
    let mut response = if for_programs && request.method() == Method::OPTIONS {
        preflight()
    } else if is_too_long {
        RequestError::TooLong { limit: MAX_ADDRESS_BYTES }.into_response()
    } else {
        let answer = CONTEXT.scope(context.clone(), next.run(request));
        let answer = tokio::time::timeout(RESPONSE_TIMEOUT, answer).await;
        answer.unwrap_or_else(|_| RequestError::Busy.into_response())
    };
    let status = response.status();
    if status.is_client_error() || status.is_server_error() {
        response = with_error_body(response, for_programs, (&path, &id), context);
    }
    settings.add_headers(response.headers_mut(), &path, for_programs);
    response
}

/// Answers the question of a browser whether a page of another site may send a request with a token.
fn preflight() -> Response {
    let mut response = StatusCode::NO_CONTENT.into_response();
    insert(response.headers_mut(), &PREFLIGHT);
    response
}

fn insert(headers: &mut HeaderMap, added: &[(HeaderName, &'static str)]) {
    for (name, value) in added {
        headers.insert(name.clone(), HeaderValue::from_static(value));
    }
}

/// Adds the body of an error: problem details (RFC 9457) for programs, a page for people.
fn with_error_body(
    bare: Response,
    for_programs: bool,
    (path, id): (&str, &str),
    context: PageContext,
) -> Response {
    let error = bare.extensions().get::<RequestError>().cloned();
    let error = error.unwrap_or_else(|| RequestError::of_status(bare.status()));
    let menu = bare.extensions().get::<Menu>().copied().unwrap_or_default();
    let (mut parts, _) = bare.into_parts();
    let (kind, body) = if for_programs {
        ("application/problem+json", json!(error.problem(path, id)).to_string())
    } else {
        let context = PageContext { menu, ..context };
        ("text/html; charset=utf-8", CONTEXT.sync_scope(context, || pages::error_page(&error, id)))
    };
    parts.status = error.class().status;
    parts.headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(kind));
    parts.headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    parts.headers.remove(header::CONTENT_LENGTH);
    Response::from_parts(parts, Body::from(body))
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
    // Caches may store public responses, with revalidation, but no private ones.
    let control = if is_private { "private, no-store" } else { "public, no-cache" };
    parts.headers.entry(header::CACHE_CONTROL).or_insert(HeaderValue::from_static(control));
    if let Ok(tag) = HeaderValue::from_str(&tag) {
        parts.headers.insert(header::ETAG, tag);
    }
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

fn matches_tag(known: &HeaderValue, tag: &str) -> bool {
    let known = known.to_str().unwrap_or_default();
    known
        .split(',')
        .map(str::trim)
        .any(|one| one == "*" || one.trim_start_matches("W/") == tag.trim_start_matches("W/"))
}

#[derive(Clone)]
struct BodyWeighter;

impl Weighter<blake3::Hash, Bytes> for BodyWeighter {
    fn weight(&self, _: &blake3::Hash, body: &Bytes) -> u64 {
        body.len() as u64
    }
}

pub(crate) struct CompressedBodies(Cache<blake3::Hash, Bytes, BodyWeighter>);

impl Default for CompressedBodies {
    fn default() -> Self {
        Self(Cache::with_weighter(CACHE_BYTES as usize / TYPICAL_BYTES, CACHE_BYTES, BodyWeighter))
    }
}

impl CompressedBodies {
    /// Returns the body compressed if the client accepts that and it helps; updates `headers` accordingly.
    pub(crate) fn compress(
        &self,
        hash: blake3::Hash,
        body: Bytes,
        accepted: Option<&HeaderValue>,
        headers: &mut HeaderMap,
    ) -> Bytes {
        if body.len() < MIN_BYTES || !accepted.is_some_and(accepts_gzip) || !is_text(headers) {
            return body;
        }
        let Ok(compressed) = self.0.get_or_insert_with(&hash, || gzip(&body)) else { return body };
        headers.insert(header::CONTENT_ENCODING, HeaderValue::from_static("gzip"));
        headers.remove(header::CONTENT_LENGTH);
        compressed
    }
}

fn gzip(body: &[u8]) -> io::Result<Bytes> {
    let mut encoder = GzEncoder::new(Vec::with_capacity(body.len() / 4), Compression::fast());
    encoder.write_all(body)?;
    encoder.finish().map(Bytes::from)
}

/// Returns true if `Accept-Encoding` lists gzip with a weight above 0.
fn accepts_gzip(accepted: &HeaderValue) -> bool {
    let encodings = accepted.to_str().unwrap_or_default();
    encodings.split(',').any(|encoding| {
        let (name, weight) = encoding.split_once(';').unwrap_or((encoding, ""));
        let is_refused = matches!(weight.trim(), "q=0" | "q=0.0" | "q=0.00" | "q=0.000");
        matches!(name.trim(), "gzip" | "*") && !is_refused
    })
}

/// Returns true for text; pictures and sound are compressed already.
fn is_text(headers: &HeaderMap) -> bool {
    let kind = headers.get(header::CONTENT_TYPE).and_then(|kind| kind.to_str().ok()).unwrap_or_default();
    kind.starts_with("text/") || kind.starts_with("application/") || kind.starts_with("image/svg")
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::routing::get;
    use http_body_util::BodyExt;
    use std::io::Read;
    use tower::ServiceExt;

    /// Requests an address from a router with broken handlers.
    async fn ask(address: &str) -> (StatusCode, String) {
        let (status, _, body) = ask_as(address, "").await;
        (status, body)
    }

    /// Requests an address with a request id. Returns status, request id and body.
    async fn ask_as(address: &str, id: &'static str) -> (StatusCode, String, String) {
        let broken = Router::new()
            .route("/panic", get(async || if true { panic!("a secret reason") } else { "" }))
            .route("/api/panic", get(async || if true { panic!("a secret reason") } else { "" }))
            .route("/endless", get(async || std::future::pending::<&str>().await));
        let request =
            Request::get(address).header("x-request-id", id).body(Body::empty()).expect("a request");
        let response =
            with_middleware(broken, ResponseSettings::default()).oneshot(request).await.expect("an answer");
        let status = response.status();
        let id = response.headers()["x-request-id"].to_str().expect("text").to_owned();
        let body = response.into_body().collect().await.expect("a body").to_bytes();
        (status, id, String::from_utf8(body.to_vec()).expect("text"))
    }

    #[tokio::test]
    async fn errors_name_the_request_id() {
        for address in ["/panic", "/api/panic", "/nowhere", "/api/nowhere"] {
            let (_, id, body) = ask_as(address, "from-a-proxy").await;
            assert!(id == "from-a-proxy" && body.contains("from-a-proxy"), "{address}: {id} {body}");
            let (_, id, body) = ask_as(address, "<b>forged</b>").await;
            assert!(id.starts_with("req_") && body.contains(&id), "{address}: {id} {body}");
            assert!(!body.contains("forged"), "{body}");
        }
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
    fn only_tls_sites_require_tls() {
        for requires_tls in [false, true] {
            let settings = ResponseSettings { requires_tls, ..ResponseSettings::default() };
            let mut sent = HeaderMap::new();
            settings.add_headers(&mut sent, "/", false);
            assert_eq!(sent.contains_key(header::STRICT_TRANSPORT_SECURITY), requires_tls);
        }
    }

    #[test]
    fn tags_are_compared_weakly() {
        let matches = |known: &'static str| matches_tag(&HeaderValue::from_static(known), "\"a\"");
        assert!(matches("\"a\"") && matches("W/\"a\"") && matches("\"b\", \"a\"") && matches("*"));
        assert!(!matches("\"b\"") && !matches("a") && !matches(""));
    }

    fn headers(kind: &'static str) -> HeaderMap {
        HeaderMap::from_iter([(header::CONTENT_TYPE, HeaderValue::from_static(kind))])
    }

    #[test]
    fn text_is_compressed_once() {
        let (bodies, plain) = (CompressedBodies::default(), Bytes::from("all the same ".repeat(1000)));
        let (hash, gzip) = (blake3::hash(&plain), HeaderValue::from_static("br, gzip;q=0.8"));
        let mut sent = headers("text/html");
        let first = bodies.compress(hash, plain.clone(), Some(&gzip), &mut sent);
        assert_eq!(sent[header::CONTENT_ENCODING], "gzip");
        let mut decoded = String::new();
        flate2::read::GzDecoder::new(&first[..]).read_to_string(&mut decoded).expect("gzip");
        assert_eq!(decoded.as_bytes(), plain);
        let second = bodies.compress(hash, plain, Some(&gzip), &mut headers("text/html"));
        assert_eq!((second.as_ptr(), second.len()), (first.as_ptr(), first.len()), "the cached bytes");
    }

    #[test]
    fn short_binary_and_unwanted_bodies_stay_plain() {
        let (bodies, gzip) = (CompressedBodies::default(), HeaderValue::from_static("gzip"));
        let long = Bytes::from(vec![b'a'; 5000]);
        let sent = |body: &Bytes, accepted: Option<&HeaderValue>, kind| {
            bodies.compress(blake3::hash(body), body.clone(), accepted, &mut headers(kind)).len()
        };
        assert_eq!(sent(&long, Some(&gzip), "image/png"), 5000);
        assert_eq!(sent(&long, None, "text/css"), 5000);
        assert_eq!(sent(&long, Some(&HeaderValue::from_static("gzip;q=0, br")), "text/css"), 5000);
        assert_eq!(sent(&Bytes::from_static(b"short"), Some(&gzip), "text/css"), 5);
        assert!(sent(&long, Some(&gzip), "application/json") < 100);
    }
}
