//! Request ids: in log lines, in the response header `x-request-id` and in error bodies.

use axum::{
    extract::Request,
    http::{HeaderMap, HeaderName, HeaderValue},
    middleware::Next,
    response::Response,
};
use std::{
    fmt,
    hash::{BuildHasher, Hasher, RandomState},
    ops::RangeInclusive,
};

/// Header of requests and responses.
pub(crate) const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

/// Accepted lengths of an id from outside.
const LENGTHS: RangeInclusive<usize> = 8..=64;

/// Id of a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct RequestId(HeaderValue);

impl RequestId {
    /// Returns the id of a proxy in front of this server if it is well-formed, otherwise a random one.
    fn of(headers: &HeaderMap) -> Self {
        let sent = headers.get(&REQUEST_ID).filter(|value| is_well_formed(value.as_bytes()));
        sent.cloned().map_or_else(Self::random, Self)
    }

    fn random() -> Self {
        // The keys of a new state differ from all others; an id needs no secrecy.
        let random = RandomState::new().build_hasher().finish() >> 16;
        let id = HeaderValue::from_str(&format!("req_{random:012x}"));
        Self(id.unwrap_or(HeaderValue::from_static("req_")))
    }

    fn as_str(&self) -> &str {
        self.0.to_str().unwrap_or_default()
    }
}

impl fmt::Display for RequestId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

/// Allows nothing that could look like another part of a log line or a page.
fn is_well_formed(id: &[u8]) -> bool {
    LENGTHS.contains(&id.len()) && id.iter().all(|byte| byte.is_ascii_alphanumeric() || b"-_".contains(byte))
}

/// Adds an id to the request, for all inner layers, and to the response.
pub(crate) async fn identify(mut request: Request, next: Next) -> Response {
    let id = RequestId::of(request.headers());
    request.extensions_mut().insert(id.clone());
    let mut response = next.run(request).await;
    response.headers_mut().insert(REQUEST_ID, id.0);
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    fn id_for(sent: &'static str) -> RequestId {
        RequestId::of(&HeaderMap::from_iter([(REQUEST_ID, HeaderValue::from_static(sent))]))
    }

    #[test]
    fn well_formed_ids_are_kept() {
        for sent in ["req_0123456789ab", "7d1f3c2a-0b7e-4f6e-9a55-0c1d2e3f4a5b"] {
            assert_eq!(id_for(sent).as_str(), sent);
        }
    }

    #[test]
    fn malformed_ids_are_replaced() {
        let long = "x".repeat(65);
        for sent in ["", "short", "<script>alert", "a=1 level=ERROR", long.leak()] {
            let id = id_for(sent);
            assert!(id.as_str().starts_with("req_") && id.as_str().len() == 16, "{sent}: {id}");
        }
    }

    #[test]
    fn ids_differ() {
        assert_ne!(RequestId::random(), RequestId::random());
    }
}
