//! Material libraries (`.mtl`).

use crate::files::plain_words;
use avln_scene::Material;

const DEFAULT_DIFFUSE: [f32; 3] = [0.8; 3];
/// Opacity below which a surface is transparent.
const SEE_THROUGH: f32 = 0.5;
#[derive(Clone, Debug, PartialEq)]
pub(super) struct MtlMaterial {
    pub(super) name: String,
    diffuse: [f32; 3],
    opacity: f32,
    pub(super) picture: Option<String>,
}

impl MtlMaterial {
    fn new(name: &str) -> Self {
        Self { name: name.to_owned(), diffuse: DEFAULT_DIFFUSE, opacity: 1.0, picture: None }
    }

    /// Returns the material with the image number `texture`. Colours are display values, as in common viewers.
    pub(super) fn material(&self, texture: Option<u16>) -> Material {
        let [r, g, b] = self.diffuse.map(|share| (share.clamp(0.0, 1.0) * 255.0).round() as u8);
        // An image on black would be invisible: viewers show it as if the colour were white.
        let is_hidden = texture.is_some() && [r, g, b] == [0; 3];
        let alpha = (self.opacity.clamp(0.0, 1.0) * 255.0).round() as u8;
        Material {
            name: plain_words(&self.name),
            base_color: if is_hidden { [255, 255, 255, alpha] } else { [r, g, b, alpha] },
            texture,
            alpha_cutoff: (self.opacity < 1.0).then_some((SEE_THROUGH * 255.0) as u8),
        }
    }
}

pub(super) fn plain(name: &str) -> Material {
    MtlMaterial::new(name).material(None)
}

/// Parses a library; unknown lines are ignored, because materials change no surface.
pub(super) fn parse(text: &str) -> Vec<MtlMaterial> {
    let mut entries: Vec<MtlMaterial> = Vec::new();
    for line in text.lines() {
        let line = line.trim();
        let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        if keyword == "newmtl" {
            entries.push(MtlMaterial::new(rest.trim()));
        }
        let Some(entry) = entries.last_mut() else { continue };
        let number = || rest.split_whitespace().next().and_then(number);
        match keyword {
            "Kd" => entry.diffuse = diffuse(rest).unwrap_or(entry.diffuse),
            "d" => entry.opacity = number().unwrap_or(entry.opacity),
            "Tr" => entry.opacity = number().map_or(entry.opacity, |share| 1.0 - share),
            "map_Kd" => entry.picture = picture(rest),
            _ => {}
        }
    }
    entries
}

fn number(word: &str) -> Option<f32> {
    word.parse().ok().filter(|number: &f32| number.is_finite())
}

fn diffuse(text: &str) -> Option<[f32; 3]> {
    let numbers: Option<Vec<f32>> = text.split_whitespace().map(number).collect();
    match numbers?[..] {
        [grey] => Some([grey; 3]),
        [r, g, b, ..] => Some([r, g, b]),
        _ => None,
    }
}

/// The file name after the options; it may contain blanks.
fn picture(text: &str) -> Option<String> {
    let mut rest = text.trim();
    while let Some(values) = option_values(rest) {
        rest = after_word(rest);
        for index in 0..values {
            let word = rest.split_whitespace().next().unwrap_or_default();
            // Vectors may end after their first number.
            if index > 0 && number(word).is_none() || rest.is_empty() {
                break;
            }
            rest = after_word(rest);
        }
    }
    (!rest.is_empty()).then(|| rest.to_owned())
}

/// Value count for the `map_Kd` option at the start (one to three for vectors).
fn option_values(text: &str) -> Option<usize> {
    match text.split_whitespace().next()? {
        "-blendu" | "-blendv" | "-boost" | "-texres" | "-clamp" | "-bm" | "-imfchan" | "-type" | "-cc"
        | "-colorspace" => Some(1),
        "-mm" => Some(2),
        "-o" | "-s" | "-t" => Some(3),
        _ => None,
    }
}

fn after_word(text: &str) -> &str {
    text.split_once(char::is_whitespace).map_or("", |(_, rest)| rest.trim_start())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_opacity_and_pictures_are_read() {
        let text = "# made by hand\nKd 1 0 0\nnewmtl oak floor\n\tKd 0.5 0.25 0\r\nmap_Kd -s 2 2 1 -clamp on wood 1.png\n\
            newmtl glass\nd 0.25\nnewmtl dark\nKd 0 0 0\nmap_Kd a\\b.jpg\nKd nan 0 0\n";
        let entries = parse(text);
        assert_eq!(entries.len(), 3);
        assert_eq!(
            (entries[0].name.as_str(), entries[0].picture.as_deref()),
            ("oak floor", Some("wood 1.png"))
        );
        assert_eq!(entries[0].material(Some(4)).base_color, [128, 64, 0, 255]);
        assert_eq!(entries[1].material(None).base_color, [204, 204, 204, 64]);
        assert_eq!(entries[1].material(None).alpha_cutoff, Some(127));
        assert_eq!(entries[2].material(Some(0)).base_color, [255; 4], "a picture on black is shown");
        assert_eq!(entries[2].material(None).base_color, [0, 0, 0, 255]);
    }

    #[test]
    fn options_before_the_name_are_skipped() {
        for (line, expected) in [
            ("-o 0.5 1 oak.png", Some("oak.png")),
            ("-mm 0 1 -blendu off 7.png", Some("7.png")),
            ("-s", None),
            ("", None),
        ] {
            assert_eq!(picture(line).as_deref(), expected, "{line}");
        }
    }
}
