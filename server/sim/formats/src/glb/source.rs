//! A file's document and buffers: GLB container, external files, `data:` URIs.

use crate::files::{Checked, neighbour, read_limited};
use crate::glb::document::{Document, missing};
use avln_scene::limits::{MAX_FILE_BYTES, MAX_JSON_BYTES};
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use base64::{Engine as _, alphabet};
use std::borrow::Cow;
use std::path::Path;

const MAGIC: &[u8; 4] = b"glTF";
const HEADER_BYTES: usize = 12;
const CHUNK_HEADER_BYTES: usize = 8;
const JSON_CHUNK: &[u8] = b"JSON";
const BIN_CHUNK: &[u8] = b"BIN\0";

/// A parsed file with buffers.
pub(super) struct Source<'a> {
    pub(super) document: Document,
    pub(super) buffers: Vec<Cow<'a, [u8]>>,
    /// External file folder; `None` for bytes in memory.
    pub(super) folder: Option<&'a Path>,
}

impl<'a> Source<'a> {
    /// Parses a `.glb` or `.gltf` file, and reads external buffers.
    pub(super) fn parse(bytes: &'a [u8], folder: Option<&'a Path>) -> Checked<Self> {
        let is_binary = bytes.starts_with(MAGIC);
        let (json, bin) = if is_binary { chunks(bytes)? } else { (bytes, None) };
        if json.len() > MAX_JSON_BYTES {
            return Err(format!(
                "its JSON part is {} bytes long, at most {MAX_JSON_BYTES} are read; save it as .glb",
                json.len()
            ));
        }
        let kind =
            if is_binary { "its JSON part is damaged" } else { "it is neither binary glTF nor glTF JSON" };
        let document: Document = serde_json::from_slice(json)
            .map_err(|error| format!("{kind} ({error}); export it as .glb again"))?;
        let buffers = load_buffers(&document, bin, folder)?;
        Ok(Self { document, buffers, folder })
    }

    /// Returns a buffer view's bytes.
    pub(super) fn view(&self, index: usize) -> Checked<&[u8]> {
        let view = self.document.buffer_views.get(index).ok_or_else(|| missing("buffer view", index))?;
        let buffer = self.buffers.get(view.buffer).ok_or_else(|| missing("buffer", view.buffer))?;
        let end = view.byte_offset.checked_add(view.byte_length);
        end.and_then(|end| buffer.get(view.byte_offset..end)).ok_or_else(|| {
            format!(
                "buffer view {index} reaches beyond its buffer of {} bytes; export the file again",
                buffer.len()
            )
        })
    }
}

type Chunks<'a> = (&'a [u8], Option<&'a [u8]>);

/// A GLB file's JSON chunk and binary chunk.
fn chunks(bytes: &[u8]) -> Checked<Chunks<'_>> {
    let version = word(bytes, 4).ok_or("it ends inside its header; copy the file again")?;
    if version != 2 {
        return Err(format!(
            "it is binary glTF version {version}, only version 2 is read; export it as glTF 2.0"
        ));
    }
    let length = word(bytes, 8).ok_or("it ends inside its header; copy the file again")?;
    if length > bytes.len() {
        return Err(format!(
            "it is cut short: {length} bytes announced, {} present; copy the file again",
            bytes.len()
        ));
    }
    // Bytes after the announced length are ignored, as by other readers.
    let bytes = &bytes[..length];
    let (kind, json, rest) = chunk(bytes.get(HEADER_BYTES..).unwrap_or_default())?;
    if kind != JSON_CHUNK {
        return Err("its first chunk is not JSON; export the file again".to_owned());
    }
    if rest.is_empty() {
        return Ok((json, None));
    }
    let (kind, bin, _) = chunk(rest)?;
    Ok((json, (kind == BIN_CHUNK).then_some(bin)))
}

/// The first chunk's kind and content, and the bytes after it.
fn chunk(bytes: &[u8]) -> Checked<(&[u8], &[u8], &[u8])> {
    let cut = || "one of its chunks reaches beyond the end of the file; copy the file again".to_owned();
    let length = word(bytes, 0).ok_or_else(cut)?;
    let kind = bytes.get(4..CHUNK_HEADER_BYTES).ok_or_else(cut)?;
    let end = CHUNK_HEADER_BYTES.checked_add(length).ok_or_else(cut)?;
    let content = bytes.get(CHUNK_HEADER_BYTES..end).ok_or_else(cut)?;
    Ok((kind, content, &bytes[end..]))
}

fn word(bytes: &[u8], offset: usize) -> Option<usize> {
    let four = bytes.get(offset..offset + 4)?;
    Some(u32::from_le_bytes([four[0], four[1], four[2], four[3]]) as usize)
}

fn load_buffers<'a>(
    document: &Document,
    bin: Option<&'a [u8]>,
    folder: Option<&Path>,
) -> Checked<Vec<Cow<'a, [u8]>>> {
    let mut budget = MAX_FILE_BYTES;
    let mut buffers = Vec::with_capacity(document.buffers.len());
    for (index, buffer) in document.buffers.iter().enumerate() {
        let bytes = match &buffer.uri {
            Some(address) => Cow::Owned(load(address, folder, &mut budget)?),
            None if index == 0 => {
                Cow::Borrowed(bin.ok_or("its binary chunk is missing; copy the file again")?)
            }
            None => return Err(format!("buffer {index} has no URI; export the file again")),
        };
        if bytes.len() < buffer.byte_length {
            return Err(format!(
                "buffer {index} has {} bytes, {} were announced; copy the files again",
                bytes.len(),
                buffer.byte_length
            ));
        }
        buffers.push(bytes);
    }
    Ok(buffers)
}

/// Loads the bytes at `address`, and subtracts their number from `budget`.
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
                "its file {address:?} cannot be read ({error}); put it next to the scene, or export it as .glb"
            )
        })?
    };
    *budget = budget.checked_sub(bytes.len() as u64).ok_or_else(|| {
        format!(
            "its external files have more than {MAX_FILE_BYTES} bytes together; split or simplify the scene"
        )
    })?;
    Ok(bytes)
}

/// Returns whether `address` refers to a missing file.
pub(super) fn is_absent(address: &str, folder: Option<&Path>) -> bool {
    let path =
        folder.filter(|_| !address.starts_with("data:")).and_then(|folder| neighbour(folder, address).ok());
    path.is_some_and(|path| !path.exists())
}

/// Decodes base64 (RFC 4648, section 4); padding is optional, white space is an error.
fn base64(text: &str) -> Option<Vec<u8>> {
    const LENIENT: GeneralPurpose = GeneralPurpose::new(
        &alphabet::STANDARD,
        GeneralPurposeConfig::new()
            .with_decode_padding_mode(DecodePaddingMode::Indifferent)
            .with_decode_allow_trailing_bits(true),
    );
    LENIENT.decode(text).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_agrees_with_rfc_4648() {
        for (plain, coded) in
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")]
        {
            assert_eq!(base64(coded).unwrap(), plain.as_bytes());
        }
        assert_eq!([base64("Z"), base64("Zm9v!")], [None, None]);
    }
}
