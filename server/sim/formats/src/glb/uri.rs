//! Addresses inside a glTF file: names of neighbouring files and `data:` URIs.

use crate::files::Checked;
use avln_scene::limits::MAX_FILE_BYTES;
use std::fs::File;
use std::io::Read;
use std::path::{Component, Path, PathBuf};

/// How the text begins that Git LFS keeps instead of a file.
const LFS_POINTER: &[u8] = b"version https://git-lfs";

/// The bytes behind `address`; takes their number from `budget`.
pub(super) fn load(address: &str, folder: Option<&Path>, budget: &mut u64) -> Checked<Vec<u8>> {
    let bytes = if let Some(data) = address.strip_prefix("data:") {
        let (_, encoded) =
            data.split_once(";base64,").ok_or("a data: URI is not base64; export it as .glb")?;
        base64(encoded).ok_or("a data: URI is not valid base64; export it as .glb")?
    } else {
        let folder = folder.ok_or_else(|| {
            format!("it keeps data in another file, {address:?}; open it by its path, or export it as .glb")
        })?;
        read_limited(&neighbour(folder, address)?, *budget).map_err(|error| {
            format!(
                "its file {address:?} cannot be read ({error}); put it beside the scene, or export it as .glb"
            )
        })?
    };
    *budget = budget.checked_sub(bytes.len() as u64).ok_or_else(|| {
        format!(
            "the files it names hold more than {MAX_FILE_BYTES} bytes together; split or simplify the scene"
        )
    })?;
    Ok(bytes)
}

/// Whether `address` names a neighbouring file that does not exist.
pub(super) fn is_absent(address: &str, folder: Option<&Path>) -> bool {
    let path =
        folder.filter(|_| !address.starts_with("data:")).and_then(|folder| neighbour(folder, address).ok());
    path.is_some_and(|path| !path.exists())
}

/// Reads an ordinary file of at most `limit` bytes; refuses the pointer that Git LFS leaves in a file's place.
pub(crate) fn read_limited(path: &Path, limit: u64) -> std::io::Result<Vec<u8>> {
    let refuse = |reason: String| Err(std::io::Error::new(std::io::ErrorKind::InvalidInput, reason));
    let metadata = std::fs::metadata(path)?;
    if !metadata.is_file() {
        return refuse("it is not an ordinary file".to_owned());
    }
    if metadata.len() > limit {
        return refuse(format!("it has {} bytes, at most {limit} are read", metadata.len()));
    }
    let mut bytes = Vec::with_capacity(metadata.len() as usize);
    File::open(path)?.take(limit).read_to_end(&mut bytes)?;
    if bytes.starts_with(LFS_POINTER) {
        return refuse(
            "it is a Git LFS pointer in the file's place; run `git lfs pull` in its folder".to_owned(),
        );
    }
    Ok(bytes)
}

/// The file that a relative URI names, which must lie in `folder` or below it.
pub(crate) fn neighbour(folder: &Path, address: &str) -> Checked<PathBuf> {
    let outside =
        || format!("it names {address:?}, which does not lie in its own folder; move that file beside it");
    let decoded = percent_decoded(address).ok_or_else(outside)?;
    let mut relative = PathBuf::new();
    for component in Path::new(&decoded).components() {
        match component {
            Component::CurDir => {}
            Component::Normal(name) => relative.push(name),
            Component::ParentDir if relative.pop() => {}
            _ => return Err(outside()),
        }
    }
    if decoded.contains("://") || relative.as_os_str().is_empty() {
        return Err(outside());
    }
    Ok(folder.join(relative))
}

fn percent_decoded(text: &str) -> Option<String> {
    let mut decoded = Vec::with_capacity(text.len());
    let mut bytes = text.bytes();
    while let Some(byte) = bytes.next() {
        if byte == b'%' {
            let digits = [bytes.next()?, bytes.next()?];
            decoded.push(u8::from_str_radix(std::str::from_utf8(&digits).ok()?, 16).ok()?);
        } else {
            decoded.push(byte);
        }
    }
    String::from_utf8(decoded).ok().filter(|text| !text.contains('\0'))
}

/// RFC 4648 section 4; padding may be absent, white space may not be there.
fn base64(text: &str) -> Option<Vec<u8>> {
    let digits = text.trim_end_matches('=').as_bytes();
    let mut bytes = Vec::with_capacity(digits.len() / 4 * 3 + 3);
    for group in digits.chunks(4) {
        let mut word = 0_u32;
        for &digit in group {
            word = word << 6 | u32::from(sextet(digit)?);
        }
        word <<= 6 * (4 - group.len());
        let whole = [0, 0, 1, 2, 3][group.len()];
        if whole == 0 {
            return None;
        }
        bytes.extend_from_slice(&word.to_be_bytes()[1..=whole]);
    }
    Some(bytes)
}

fn sextet(digit: u8) -> Option<u8> {
    match digit {
        b'A'..=b'Z' => Some(digit - b'A'),
        b'a'..=b'z' => Some(digit - b'a' + 26),
        b'0'..=b'9' => Some(digit - b'0' + 52),
        b'+' => Some(62),
        b'/' => Some(63),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_follows_the_test_vectors_of_rfc_4648() {
        for (plain, coded) in
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")]
        {
            assert_eq!(base64(coded).unwrap(), plain.as_bytes());
        }
        assert_eq!([base64("Z"), base64("Zm9v!")], [None, None]);
    }

    #[test]
    fn a_neighbour_stays_in_the_folder() {
        let folder = Path::new("scenes");
        assert_eq!(neighbour(folder, "a%20b/../c.bin").unwrap(), Path::new("scenes/c.bin"));
        for address in
            ["../secret", "a/../../secret", "/etc/passwd", "https://example.org/a.bin", "", "%00", "%2e%2e/x"]
        {
            assert!(neighbour(folder, address).unwrap_err().contains("its own folder"), "{address}");
        }
    }
}
