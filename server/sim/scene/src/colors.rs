//! The twelve colour words, and conversion between sRGB bytes and linear light.

use std::sync::LazyLock;

/// Colour words for [`Attributes::color`](crate::Attributes::color) with a typical sRGB value.
pub const PALETTE: [(&str, [u8; 3]); 12] = [
    ("red", [196, 36, 34]),
    ("orange", [240, 134, 38]),
    ("yellow", [240, 216, 70]),
    ("green", [58, 146, 66]),
    ("teal", [36, 150, 150]),
    ("blue", [52, 88, 196]),
    ("purple", [124, 60, 158]),
    ("pink", [238, 150, 182]),
    ("brown", [112, 72, 42]),
    ("black", [24, 24, 26]),
    ("grey", [128, 128, 128]),
    ("white", [242, 242, 240]),
];

/// Further colours with the same words: dark and light variants, and wood hues.
const VARIANTS: [(&str, [u8; 3]); 15] = [
    ("red", [122, 18, 22]),
    ("yellow", [214, 184, 40]),
    ("green", [34, 78, 40]),
    ("green", [146, 196, 120]),
    ("teal", [20, 90, 92]),
    ("blue", [22, 32, 96]),
    ("blue", [126, 170, 222]),
    ("purple", [176, 130, 204]),
    ("brown", [74, 46, 28]),
    ("brown", [147, 67, 31]),
    ("brown", [170, 116, 72]),
    ("brown", [217, 159, 101]),
    ("black", [46, 46, 48]),
    ("grey", [84, 84, 86]),
    ("grey", [178, 178, 178]),
];

static LIGHT: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|code| linear(code as f32 / 255.0)));

/// `BETWEEN[i]`: the light half-way, in sRGB, between the codes `i` and `i + 1`.
// Boundaries are half-way between the codes in sRGB, not in light: then every code converts to light and back unchanged.
static BETWEEN: LazyLock<[f32; 255]> =
    LazyLock::new(|| std::array::from_fn(|code| linear((code as f32 + 0.5) / 255.0)));

/// Palette and variants in CIE L\*a\*b\*.
static NAMED: LazyLock<Vec<(&str, [f32; 3])>> =
    LazyLock::new(|| PALETTE.iter().chain(&VARIANTS).map(|&(name, rgb)| (name, lab(rgb))).collect());

/// Returns the nearest known colour's word by the CIE 1976 difference in L\*a\*b\*. A [`PALETTE`] colour has
/// that colour's word.
pub fn name_of(rgb: [u8; 3]) -> &'static str {
    let wanted = lab(rgb);
    let difference = |known: &[f32; 3]| distance_squared(&wanted, known);
    let nearest = NAMED.iter().min_by(|a, b| difference(&a.1).total_cmp(&difference(&b.1)));
    nearest.map_or("", |(name, _)| name)
}

/// Converts an sRGB byte to linear light, 0 to 1.
pub fn light_of(code: u8) -> f32 {
    LIGHT[usize::from(code)]
}

/// Converts linear light to the nearest sRGB byte; values outside 0 to 1 are clamped, NaN is 0.
pub fn code_of(light: f32) -> u8 {
    BETWEEN.partition_point(|&boundary| boundary <= light) as u8
}

/// Converts an sRGB value to linear light, both 0 to 1 (IEC 61966-2-1).
fn linear(value: f32) -> f32 {
    if value <= 0.040_45 { value / 12.92 } else { libm::powf((value + 0.055) / 1.055, 2.4) }
}

/// CIE L\*a\*b\* under D65 (CIE 15:2004, with the sRGB primaries of IEC 61966-2-1).
fn lab(rgb: [u8; 3]) -> [f32; 3] {
    let [r, g, b] = rgb.map(light_of);
    let x = cube_root((0.412_456 * r + 0.357_576 * g + 0.180_438 * b) / 0.950_47);
    let y = cube_root(0.212_673 * r + 0.715_152 * g + 0.072_175 * b);
    let z = cube_root((0.019_334 * r + 0.119_192 * g + 0.950_304 * b) / 1.088_83);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// Compressed cube root of CIE 15:2004, linear near 0.
fn cube_root(value: f32) -> f32 {
    if value > 0.008_856 { libm::cbrtf(value) } else { 7.787 * value + 16.0 / 116.0 }
}

fn distance_squared(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_palette_entry_has_its_own_name() {
        for (name, rgb) in PALETTE {
            assert_eq!(name_of(rgb), name);
        }
    }

    #[test]
    fn common_colours_have_common_names() {
        for (rgb, word) in [
            ([255, 0, 0], "red"),
            ([92, 60, 30], "brown"),
            ([217, 159, 101], "brown"),
            ([255, 140, 0], "orange"),
            ([245, 240, 225], "white"),
            ([0, 0, 0], "black"),
            ([255, 255, 255], "white"),
            ([160, 160, 165], "grey"),
            ([20, 40, 120], "blue"),
            ([30, 90, 40], "green"),
        ] {
            assert_eq!(name_of(rgb), word, "{rgb:?}");
        }
    }

    #[test]
    fn light_and_code_are_inverse_for_all_bytes() {
        for code in 0..=255 {
            assert_eq!(code_of(light_of(code)), code);
        }
        assert!((light_of(188) - 0.502_886).abs() < 1e-5, "sRGB 188 is half the light");
        assert_eq!([code_of(-1.0), code_of(7.0), code_of(f32::NAN)], [0, 255, 0]);
    }
}
