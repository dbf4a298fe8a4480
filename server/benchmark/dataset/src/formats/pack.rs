use super::FormatsError;
use flate2::{Compression, GzBuilder, read::MultiGzDecoder};
use std::io::{Read, Write};

/// Most bytes that one file may hold once it is unpacked.
pub(super) const MAX_BYTES: u64 = 1 << 30;
const MAGIC: [u8; 2] = [0x1f, 0x8b];

/// The JSON of a file that may be packed by gzip.
pub(super) fn unpack(file: &str, bytes: &[u8]) -> Result<serde_json::Value, FormatsError> {
    unpack_within(file, bytes, MAX_BYTES)
}

fn unpack_within(file: &str, bytes: &[u8], limit: u64) -> Result<serde_json::Value, FormatsError> {
    let malformed =
        |place: String, cause: String| FormatsError::Malformed { file: file.to_owned(), place, cause };
    let mut plain = Vec::new();
    let text = if bytes.starts_with(&MAGIC) {
        let mut reader = MultiGzDecoder::new(bytes).take(limit + 1);
        reader.read_to_end(&mut plain).map_err(|error| {
            malformed("its gzip stream".to_owned(), format!("{error}; copy the file again"))
        })?;
        &plain[..]
    } else {
        bytes
    };
    if text.len() as u64 > limit {
        return Err(malformed(
            "its end".to_owned(),
            format!("it holds more than {limit} bytes; split it by scene"),
        ));
    }
    serde_json::from_slice(text).map_err(|error| {
        malformed(format!("line {}, column {}", error.line(), error.column()), format!("no JSON: {error}"))
    })
}

/// Packs bytes by gzip; the same bytes give the same file.
pub(super) fn pack(bytes: &[u8]) -> Result<Vec<u8>, std::io::Error> {
    let mut writer = GzBuilder::new().mtime(0).write(Vec::new(), Compression::default());
    writer.write_all(bytes)?;
    writer.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packed_and_plain_files_are_read() {
        let packed = pack(br#"{"episodes": []}"#).unwrap();
        assert_eq!(pack(br#"{"episodes": []}"#).unwrap(), packed);
        assert_eq!(unpack("a", &packed).unwrap(), unpack("b", br#"{"episodes": []}"#).unwrap());
    }

    #[test]
    fn what_is_cut_or_too_large_is_refused() {
        let packed = pack(&[b'['; 4000]).unwrap();
        let said = |bytes: &[u8]| unpack("val.json.gz", bytes).unwrap_err().to_string();
        assert!(said(&packed[..packed.len() / 2]).contains("val.json.gz"));
        assert!(said(&packed[..packed.len() / 2]).contains("gzip"));
        assert!(said(b"{\"episodes\": [").contains("line 1"));
        let bomb = pack(&[b' '; 100_000]).unwrap();
        assert!(unpack_within("b", &bomb, 1000).unwrap_err().to_string().contains("more than 1000 bytes"));
    }
}
