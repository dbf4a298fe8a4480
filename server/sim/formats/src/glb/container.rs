//! From bytes to a document and its buffers: the GLB container, external files, `data:` URIs.

use super::schema::Document;
use super::uri;
use crate::files::Checked;
use avln_scene::limits::{MAX_FILE_BYTES, MAX_JSON_BYTES};
use std::borrow::Cow;
use std::path::Path;

const MAGIC: &[u8; 4] = b"glTF";
const HEADER_BYTES: usize = 12;
const CHUNK_HEADER_BYTES: usize = 8;
const JSON_CHUNK: &[u8] = b"JSON";
const BIN_CHUNK: &[u8] = b"BIN\0";

/// A parsed file with all its bytes at hand.
pub(super) struct Source<'a> {
    pub(super) document: Document,
    pub(super) buffers: Vec<Cow<'a, [u8]>>,
    /// Where external files lie; `None` when the bytes came from no folder.
    pub(super) folder: Option<&'a Path>,
}

impl<'a> Source<'a> {
    /// Parses a `.glb` or `.gltf` file's bytes and reads the buffers it names.
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

    /// The bytes of a buffer view.
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

/// The sentence for an index that points nowhere.
pub(super) fn missing(what: &str, index: usize) -> String {
    format!("it refers to {what} {index}, which does not exist; export the file again")
}

type Chunks<'a> = (&'a [u8], Option<&'a [u8]>);

/// The JSON chunk and the binary chunk of a GLB file.
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

/// Kind, content and what follows of the chunk at the start of `bytes`.
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
            Some(address) => Cow::Owned(uri::load(address, folder, &mut budget)?),
            None if index == 0 => {
                Cow::Borrowed(bin.ok_or("its binary chunk is missing; copy the file again")?)
            }
            None => return Err(format!("buffer {index} names no file; export the file again")),
        };
        if bytes.len() < buffer.byte_length {
            return Err(format!(
                "buffer {index} should hold {} bytes and holds {}; copy the files again",
                buffer.byte_length,
                bytes.len()
            ));
        }
        buffers.push(bytes);
    }
    Ok(buffers)
}
