//! Response compression. The content hash is the cache key, so the cache cannot be out of date.

use axum::{
    body::Bytes,
    http::{HeaderMap, HeaderValue, header},
};
use flate2::{Compression, write::GzEncoder};
use quick_cache::{Weighter, sync::Cache};
use std::io::{self, Write};

/// Cache size, bytes: some thousands of pages.
const CACHE_BYTES: u64 = 32 << 20;
/// Typical compressed page, bytes; an estimate for the cache.
const TYPICAL_BYTES: usize = 8 << 10;
/// Bodies below this size fit into a single packet without compression, bytes.
const MIN_BYTES: usize = 1024;

#[derive(Clone)]
struct BodyWeighter;

impl Weighter<blake3::Hash, Bytes> for BodyWeighter {
    fn weight(&self, _: &blake3::Hash, body: &Bytes) -> u64 {
        body.len() as u64
    }
}

/// A cache for compressed bodies.
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
    use std::io::Read;

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
