//! Lines and words of an `.obj` file.

use crate::files::Checked;
use std::borrow::Cow;

/// The lines of `bytes` with the number of the first physical line of each; a backslash at the end joins the next.
pub(super) fn lines(bytes: &[u8]) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    let mut physical = bytes.split(|&byte| byte == b'\n').enumerate();
    std::iter::from_fn(move || {
        let (index, first) = physical.next()?;
        let mut line = String::from_utf8_lossy(first);
        while let Some(joined) = line.trim_end().strip_suffix('\\') {
            let joined = joined.to_owned();
            let Some((_, next)) = physical.next() else { return Some((index + 1, Cow::Owned(joined))) };
            line = Cow::Owned(format!("{joined} {}", String::from_utf8_lossy(next)));
        }
        Some((index + 1, line))
    })
}

/// Keyword and what follows, without a comment.
pub(super) fn split(line: &str) -> (&str, &str) {
    let line = line.split('#').next().unwrap_or_default().trim();
    line.split_once(char::is_whitespace).map_or((line, ""), |(keyword, rest)| (keyword, rest.trim()))
}

/// Up to `N` numbers from the front of `text`, and how many there were; at least `least`, all finite and within `limit`.
pub(super) fn numbers<const N: usize>(text: &str, least: usize, limit: f32) -> Checked<([f32; N], usize)> {
    let mut found = [0.0; N];
    let mut count = 0;
    for word in text.split_whitespace().take(N) {
        let number: f32 = word.parse().map_err(|_| format!("{word:?} is not a number"))?;
        if number.is_nan() || number.abs() > limit {
            return Err(format!("{word:?} is no usable coordinate"));
        }
        found[count] = number;
        count += 1;
    }
    if count < least {
        Err(format!("{count} numbers stand where {least} should"))
    } else {
        Ok((found, count))
    }
}

/// Position and, if given, texture coordinate of a face's corner such as `3`, `3/1`, `3//2` or `-1/-1/-1`, counted from 0;
/// `positions` and `uvs` are how many there are.
pub(super) fn corner(word: &str, positions: usize, uvs: usize) -> Checked<(u32, Option<u32>)> {
    let mut parts = word.split('/');
    let position = index(parts.next().unwrap_or_default(), positions, "vertex")?;
    let uv = match parts.next() {
        None | Some("") => None,
        Some(part) => Some(index(part, uvs, "texture coordinate")?),
    };
    Ok((position, uv))
}

/// An index that counts from 1, or back from the end where it is negative.
fn index(word: &str, count: usize, what: &str) -> Checked<u32> {
    let number: i64 = word.parse().map_err(|_| format!("{word:?} is no number of a {what}"))?;
    let index = if number < 0 { number.checked_add(count as i64) } else { number.checked_sub(1) };
    index
        .filter(|index| (0..count as i64).contains(index))
        .map(|index| index as u32)
        .ok_or_else(|| format!("it refers to {what} {number}, there are {count} so far"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_backslash_joins_lines() {
        let found: Vec<(usize, String)> =
            lines(b"f 1 \\\r\n2 3\nv\\").map(|(number, line)| (number, line.into_owned())).collect();
        assert_eq!(found[0].0, 1);
        assert_eq!(split(&found[0].1).1.split_whitespace().collect::<Vec<_>>(), ["1", "2", "3"]);
        assert_eq!(found[1], (3, "v".to_owned()));
    }

    #[test]
    fn corners_count_from_one_or_back_from_the_end() {
        assert_eq!(corner("3", 3, 0).unwrap(), (2, None));
        assert_eq!(corner("1//7", 3, 0).unwrap(), (0, None));
        assert_eq!(corner("-1/-2/-3", 3, 2).unwrap(), (2, Some(0)));
        for wrong in ["0", "4", "-4", "1/3", "x", "", "1/x", "9223372036854775807", "-9223372036854775808"] {
            assert!(corner(wrong, 3, 2).is_err(), "{wrong}");
        }
    }

    #[test]
    fn numbers_must_be_usable() {
        assert_eq!(numbers::<3>("1 -2.5 3e1 9", 3, 1e6).unwrap(), ([1.0, -2.5, 30.0], 3));
        for wrong in ["1 2", "1 2 x", "1 2 nan", "1 2 inf", "1 2 1e30"] {
            assert!(numbers::<3>(wrong, 3, 1e6).is_err(), "{wrong}");
        }
    }
}
