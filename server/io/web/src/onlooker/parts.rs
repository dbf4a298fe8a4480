//! Answers of which a visitor may take a part, as players of sound do.

use axum::{
    body::Bytes,
    http::{HeaderMap, HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};

/// All of `bytes`, or the part that the visitor asked for.
pub(super) fn answer(kind: &'static str, bytes: Vec<u8>, asked: &HeaderMap) -> Response {
    let bytes = Bytes::from(bytes);
    let headers = [(header::CONTENT_TYPE, kind), (header::ACCEPT_RANGES, "bytes")];
    let Some((first, last)) = part(asked, bytes.len()) else { return (headers, bytes).into_response() };
    let words = format!("bytes {first}-{last}/{}", bytes.len());
    let mut response = (StatusCode::PARTIAL_CONTENT, headers, bytes.slice(first..=last)).into_response();
    // A part has no tag, so nobody could ask whether a kept one is still right.
    response.headers_mut().insert(header::CACHE_CONTROL, HeaderValue::from_static("private, no-store"));
    if let Ok(words) = HeaderValue::from_str(&words) {
        response.headers_mut().insert(header::CONTENT_RANGE, words);
    }
    response
}

/// The first and the last byte of the one part that is asked for; `None` for all, which is an answer to everything else too.
fn part(asked: &HeaderMap, length: usize) -> Option<(usize, usize)> {
    // Tags are weak here, and a weak tag never makes a part valid.
    if asked.contains_key(header::IF_RANGE) {
        return None;
    }
    let (first, last) = asked.get(header::RANGE)?.to_str().ok()?.strip_prefix("bytes=")?.split_once('-')?;
    let (first, last) = match (first, last) {
        ("", count) => (length.checked_sub(count.parse().ok()?)?, length.checked_sub(1)?),
        (first, "") => (first.parse().ok()?, length.checked_sub(1)?),
        (first, last) => (first.parse().ok()?, last.parse::<usize>().ok()?.min(length.checked_sub(1)?)),
    };
    (first <= last && last < length).then_some((first, last))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(range: &'static str) -> Option<(usize, usize)> {
        part(&HeaderMap::from_iter([(header::RANGE, HeaderValue::from_static(range))]), 10)
    }

    #[test]
    fn one_part_is_given_and_everything_else_is_all() {
        assert_eq!(asked("bytes=0-"), Some((0, 9)));
        assert_eq!(asked("bytes=2-3"), Some((2, 3)));
        assert_eq!(asked("bytes=2-99"), Some((2, 9)));
        assert_eq!(asked("bytes=-4"), Some((6, 9)));
        for all in [
            "bytes=10-",
            "bytes=-11",
            "bytes=-0",
            "bytes=3-2",
            "bytes=0-1,3-4",
            "bytes=x-",
            "steps=0-1",
            "bytes=",
        ] {
            assert_eq!(asked(all), None, "{all}");
        }
        let both = [(header::RANGE, "bytes=0-1"), (header::IF_RANGE, "W/\"a\"")];
        let both = both.map(|(name, value)| (name, HeaderValue::from_static(value)));
        assert_eq!(part(&HeaderMap::from_iter(both), 10), None);
        assert_eq!(
            part(&HeaderMap::from_iter([(header::RANGE, HeaderValue::from_static("bytes=0-"))]), 0),
            None
        );
    }
}
