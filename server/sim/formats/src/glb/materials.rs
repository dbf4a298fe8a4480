//! Materials and textures, read at the first use by a surface.

use crate::files::Checked;
use crate::glb::document::{MaterialEntry, TextureUse, missing};
use crate::glb::source::{Source, is_absent, load};
use crate::images;
use crate::options::ImportReport;
use avln_scene::colors::code_of;
use avln_scene::limits::{MAX_FILE_BYTES, MAX_TEXELS};
use avln_scene::{Material, Texture};
use std::borrow::Cow;
use std::collections::BTreeMap;

/// Alpha below which a blended surface is transparent.
const BLEND_CUTOFF: u8 = 128;
/// Default alpha cutoff (glTF 2.0, section 3.9.4).
const DEFAULT_CUTOFF: f32 = 0.5;
/// Texture extensions with other image formats.
const TEXTURE_EXTENSIONS: [&str; 4] =
    ["GOOGLE_texture_basis", "KHR_texture_basisu", "EXT_texture_webp", "MSFT_texture_dds"];

/// Scene materials and textures, by their numbers in the file.
pub(super) struct Palette<'a, 'r> {
    source: &'a Source<'a>,
    report: &'r mut ImportReport,
    pub(super) materials: Vec<Material>,
    pub(super) textures: Vec<Texture>,
    material_of: BTreeMap<Option<usize>, u16>,
    /// Texture number by image; `None` is the missing image.
    texture_of: BTreeMap<Option<usize>, u16>,
    texels_left: u64,
    bytes_left: u64,
}

impl<'a, 'r> Palette<'a, 'r> {
    pub(super) fn new(source: &'a Source<'a>, report: &'r mut ImportReport) -> Self {
        Self {
            source,
            report,
            materials: Vec::new(),
            textures: Vec::new(),
            material_of: BTreeMap::new(),
            texture_of: BTreeMap::new(),
            texels_left: MAX_TEXELS,
            bytes_left: MAX_FILE_BYTES,
        }
    }

    /// Returns the scene's number for material `index`; `None` is glTF's default material.
    pub(super) fn material(&mut self, index: Option<usize>) -> Checked<u16> {
        // Materials are read at their first use: unused ones often refer to missing images.
        if let Some(&known) = self.material_of.get(&index) {
            return Ok(known);
        }
        let default = MaterialEntry::default();
        let entry = self.entry(index)?.unwrap_or(&default);
        let texture = entry.texture().map(|used| self.texture(used)).transpose()?;
        self.materials.push(material(entry, texture));
        let number = number(self.materials.len(), "materials")?;
        self.material_of.insert(index, number);
        Ok(number)
    }

    /// Returns material `index`'s texture use.
    pub(super) fn texture_use(&self, index: Option<usize>) -> Checked<Option<TextureUse>> {
        Ok(self.entry(index)?.and_then(MaterialEntry::texture))
    }

    fn entry(&self, index: Option<usize>) -> Checked<Option<&'a MaterialEntry>> {
        let Some(index) = index else { return Ok(None) };
        self.source.document.materials.get(index).map(Some).ok_or_else(|| missing("material", index))
    }

    fn texture(&mut self, used: TextureUse) -> Checked<u16> {
        let image = self.image_of(used.index)?;
        if let Some(&known) = self.texture_of.get(&image) {
            return Ok(known);
        }
        let texture = match image.map(|image| self.picture(image)).transpose()?.flatten() {
            Some(texture) => texture,
            None => {
                let name = image
                    .map_or_else(|| format!("of texture {}", used.index), |image| self.image_label(image));
                self.report.warn(format!("texture image {name} is missing; a checker replaces it"));
                images::checker()
            }
        };
        self.textures.push(texture);
        let number = number(self.textures.len(), "textures")?;
        self.texture_of.insert(image, number);
        Ok(number)
    }

    /// Decodes image `index`; `None` if it is missing.
    fn picture(&mut self, index: usize) -> Checked<Option<Texture>> {
        let Some(bytes) = self.image_bytes(index)? else { return Ok(None) };
        let decoded = images::decode(&bytes, &mut self.texels_left);
        let fail = |reason| format!("its texture image {} cannot be used: {reason}", self.image_label(index));
        decoded.map(Some).map_err(fail)
    }

    /// A texture's image, or an extension's image.
    fn image_of(&self, texture: usize) -> Checked<Option<usize>> {
        let entry = self.source.document.textures.get(texture).ok_or_else(|| missing("texture", texture))?;
        let offered = || {
            let sources = TEXTURE_EXTENSIONS
                .iter()
                .filter_map(|name| entry.extensions.get(*name)?.get("source")?.as_u64());
            sources.map(|source| source as usize).next()
        };
        Ok(entry.source.or_else(offered))
    }

    fn image_bytes(&mut self, index: usize) -> Checked<Option<Cow<'a, [u8]>>> {
        let source = self.source;
        let image = source.document.images.get(index).ok_or_else(|| missing("image", index))?;
        match (&image.uri, image.buffer_view) {
            (_, Some(view)) => Ok(Some(Cow::Borrowed(source.view(view)?))),
            (Some(address), None) if is_absent(address, source.folder) => Ok(None),
            (Some(address), None) => {
                load(address, source.folder, &mut self.bytes_left).map(|bytes| Some(Cow::Owned(bytes)))
            }
            (None, None) => Ok(None),
        }
    }

    fn image_label(&self, index: usize) -> String {
        let image = &self.source.document.images[index];
        match &image.uri {
            Some(address) if !address.starts_with("data:") => format!("{address:?}"),
            _ => format!(
                "{index} ({})",
                if image.mime_type.is_empty() { "no type given" } else { &image.mime_type }
            ),
        }
    }
}

fn number(count: usize, what: &str) -> Checked<u16> {
    u16::try_from(count - 1).map_err(|_| format!("it uses more than 65536 {what}; merge some of them"))
}

fn material(entry: &MaterialEntry, texture: Option<u16>) -> Material {
    let [r, g, b, a] = entry.color();
    let cutoff = entry.alpha_cutoff.unwrap_or(DEFAULT_CUTOFF);
    Material {
        name: entry.name.clone(),
        base_color: [code_of(r), code_of(g), code_of(b), byte(a)],
        texture,
        alpha_cutoff: match entry.alpha_mode.as_str() {
            "MASK" => Some(byte(cutoff)),
            "BLEND" => Some(BLEND_CUTOFF),
            _ => None,
        },
    }
}

fn byte(share: f32) -> u8 {
    (share * 255.0).round() as u8
}
