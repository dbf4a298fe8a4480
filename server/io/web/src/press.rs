//! Bodies in few bytes. What was compressed is kept by the hash of its plain text: a page that did not change is not compressed
//! again, and no answer can be out of date.

use axum::{
    body::Bytes,
    http::{HeaderMap, HeaderValue, header},
};
use flate2::{Compression, write::GzEncoder};
use std::{
    collections::VecDeque,
    io::Write,
    sync::{Mutex, PoisonError},
};

/// Memory for compressed bodies: some thousands of pages.
const KEPT_BYTES: usize = 32 << 20;
/// Shorter bodies take no fewer packets when they are compressed.
const LEAST_BYTES: usize = 1024;

/// Compressed bodies by the hash of what is in them, the one that was asked for last first.
#[derive(Default)]
pub(crate) struct Press(Mutex<VecDeque<(blake3::Hash, Bytes)>>);

impl Press {
    /// The body as it is sent to somebody who reads `accepted`; tells so in `headers`.
    pub(crate) fn packed(
        &self,
        hash: blake3::Hash,
        body: Bytes,
        accepted: Option<&HeaderValue>,
        headers: &mut HeaderMap,
    ) -> Bytes {
        if body.len() < LEAST_BYTES || !accepted.is_some_and(takes_gzip) || !is_text(headers) {
            return body;
        }
        let kept = self.find(&hash);
        let Some(packed) = kept.or_else(|| Some(self.keep(hash, gzip(&body)?))) else { return body };
        headers.insert(header::CONTENT_ENCODING, HeaderValue::from_static("gzip"));
        headers.remove(header::CONTENT_LENGTH);
        packed
    }

    fn find(&self, hash: &blake3::Hash) -> Option<Bytes> {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let place = kept.iter().position(|(other, _)| other == hash)?;
        let found = kept.remove(place)?;
        let packed = found.1.clone();
        kept.push_front(found);
        Some(packed)
    }

    fn keep(&self, hash: blake3::Hash, packed: Bytes) -> Bytes {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        kept.push_front((hash, packed.clone()));
        let mut bytes: usize = kept.iter().map(|(_, packed)| packed.len()).sum();
        while bytes > KEPT_BYTES {
            let Some((_, gone)) = kept.pop_back() else { break };
            bytes -= gone.len();
        }
        packed
    }
}

fn gzip(body: &[u8]) -> Option<Bytes> {
    let mut encoder = GzEncoder::new(Vec::with_capacity(body.len() / 4), Compression::fast());
    encoder.write_all(body).ok()?;
    encoder.finish().ok().map(Bytes::from)
}

/// Whether `gzip` is among what somebody reads, and not by `q=0`.
fn takes_gzip(accepted: &HeaderValue) -> bool {
    let words = accepted.to_str().unwrap_or_default();
    words.split(',').any(|word| {
        let (name, weight) = word.split_once(';').unwrap_or((word, ""));
        let is_refused = matches!(weight.trim(), "q=0" | "q=0.0" | "q=0.00" | "q=0.000");
        matches!(name.trim(), "gzip" | "*") && !is_refused
    })
}

/// Whether the body is text; pictures and sounds are compressed already.
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
    fn text_is_compressed_once_and_can_be_read_again() {
        let (press, plain) = (Press::default(), Bytes::from("all the same ".repeat(1000)));
        let (hash, gzip) = (blake3::hash(&plain), HeaderValue::from_static("br, gzip;q=0.8"));
        let mut told = headers("text/html");
        let first = press.packed(hash, plain.clone(), Some(&gzip), &mut told);
        assert_eq!(told[header::CONTENT_ENCODING], "gzip");
        let mut back = String::new();
        flate2::read::GzDecoder::new(&first[..]).read_to_string(&mut back).expect("gzip");
        assert_eq!(back.as_bytes(), plain);
        let again = press.packed(hash, plain, Some(&gzip), &mut headers("text/html"));
        assert_eq!((again.as_ptr(), again.len()), (first.as_ptr(), first.len()), "the same bytes");
    }

    #[test]
    fn what_is_short_or_no_text_or_not_wanted_stays_as_it_is() {
        let (press, gzip) = (Press::default(), HeaderValue::from_static("gzip"));
        let long = Bytes::from(vec![b'a'; 5000]);
        let sent = |body: &Bytes, accepted: Option<&HeaderValue>, kind| {
            press.packed(blake3::hash(body), body.clone(), accepted, &mut headers(kind)).len()
        };
        assert_eq!(sent(&long, Some(&gzip), "image/png"), 5000);
        assert_eq!(sent(&long, None, "text/css"), 5000);
        assert_eq!(sent(&long, Some(&HeaderValue::from_static("gzip;q=0, br")), "text/css"), 5000);
        assert_eq!(sent(&Bytes::from_static(b"short"), Some(&gzip), "text/css"), 5);
        assert!(sent(&long, Some(&gzip), "application/json") < 100);
    }
}
