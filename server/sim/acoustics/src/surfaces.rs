//! Acoustic surface properties, with a table by material.

use avln_scene::{InstanceId, Scene};

/// Octave bands: 125, 250, 500, 1000, 2000 and 4000 Hz. The last also applies to higher bands.
pub const SURFACE_BANDS: usize = 6;

/// A value per band.
type Shares = [f32; SURFACE_BANDS];

/// Band names in messages, hertz.
const BAND_NAMES: [&str; SURFACE_BANDS] = ["125", "250", "500", "1000", "2000", "4000"];

/// Energy shares at a surface by octave band, 0 to 1. `1 - absorption - transmission` is reflected, partly
/// diffuse (Lambert's law), partly specular.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Energy share converted into heat.
    pub absorption: Shares,
    /// Diffuse share in the reflected energy.
    pub scattering: Shares,
    /// Transmitted energy share.
    pub transmission: Shares,
}

/// Surface value errors.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SurfaceError {
    /// A share outside 0 to 1.
    #[error("{what} at {band_hz} Hz is {value}; an energy share must be 0 to 1")]
    Share {
        /// `absorption`, `scattering` or `transmission`.
        what: &'static str,
        /// Octave band centre, hertz.
        band_hz: &'static str,
        /// The share.
        value: f32,
    },
    /// Absorption plus transmission above 1: band in hertz, sum.
    #[error("absorption plus transmission at {0} Hz is {1}; lower one, so that the sum is at most 1")]
    Sum(&'static str, f32),
}

impl Surface {
    /// Creates a surface with these shares by band.
    ///
    /// # Errors
    /// If a share is outside 0 to 1, or absorption plus transmission exceeds 1.
    pub fn new(absorption: Shares, scattering: Shares, transmission: Shares) -> Result<Self, SurfaceError> {
        check_shares("absorption", &absorption)?;
        check_shares("scattering", &scattering)?;
        check_shares("transmission", &transmission)?;
        for (band, (absorbed, through)) in absorption.iter().zip(&transmission).enumerate() {
            // Decimal fractions with the sum 1 may exceed 1 slightly in binary.
            let sum = absorbed + through;
            if sum > 1.0 + 1e-6 {
                return Err(SurfaceError::Sum(BAND_NAMES[band], sum));
            }
        }
        Ok(Self { absorption, scattering, transmission })
    }

    /// Reflected energy share in `band`, 0 to 1.
    pub fn reflected(&self, band: usize) -> f32 {
        (1.0 - self.absorption[band] - self.transmission[band]).max(0.0)
    }
}

fn check_shares(what: &'static str, shares: &Shares) -> Result<(), SurfaceError> {
    match shares.iter().position(|share| !(0.0..=1.0).contains(share)) {
        Some(band) => Err(SurfaceError::Share { what, band_hz: BAND_NAMES[band], value: shares[band] }),
        None => Ok(()),
    }
}

/// A building's surfaces.
#[derive(Clone, Debug, PartialEq)]
pub struct Surfaces {
    kinds: Vec<Surface>,
    /// Per triangle: index into `kinds`.
    kind_of: Vec<u16>,
}

impl Surfaces {
    /// Assigns `surface` to every triangle.
    pub fn uniform(scene: &Scene, surface: Surface) -> Self {
        Self { kinds: vec![surface], kind_of: vec![0; scene.mesh.triangles.len()] }
    }

    /// Assigns kinds by triangle material, object material or category; otherwise a furnished flat's mean.
    pub fn by_material(scene: &Scene) -> Self {
        let kind_of_material: Vec<_> = scene.materials.iter().map(|material| find(&material.name)).collect();
        let kind_of_triangle = |triangle: usize| {
            let material = scene.mesh.material_of.get(triangle).map_or(usize::MAX, |m| usize::from(*m));
            let named = kind_of_material.get(material).copied().flatten();
            named.or_else(|| kind_of_object(scene, triangle)).unwrap_or(UNKNOWN)
        };
        let kind_of = (0..scene.mesh.triangles.len()).map(|triangle| kind_of_triangle(triangle) as u16);
        Self { kind_of: kind_of.collect(), kinds: surfaces() }
    }

    /// Returns a triangle's surface.
    pub fn of(&self, triangle: u32) -> &Surface {
        &self.kinds[usize::from(self.kind_of[triangle as usize])]
    }
}

fn kind_of_object(scene: &Scene, triangle: usize) -> Option<usize> {
    let id = *scene.mesh.instance_of.get(triangle)?;
    let object = (id != InstanceId::NONE).then(|| scene.object(id)).flatten()?;
    find(&object.attributes.material).or_else(|| find(&object.category))
}

struct Row {
    /// Name token prefixes, separated by spaces.
    words: &'static str,
    /// Energy share not reflected, 0 to 1: absorption including transmission, as in the sources.
    lost: Shares,
    scattering: Shares,
    /// Transmission loss per surface, decibels; a wall has two surfaces.
    reduction_db: Shares,
}

const CLOSED: Shares = [f32::INFINITY; SURFACE_BANDS];

/// Half a heavy wall's transmission loss.
const HEAVY: Shares = [20.0, 22.0, 24.0, 27.0, 30.0, 32.0];

/// Scattering, including edges, for large smooth surfaces, surfaces with relief, and composite objects.
const SMOOTH: Shares = [0.1, 0.1, 0.1, 0.15, 0.2, 0.25];
const ROUGH: Shares = [0.15, 0.2, 0.25, 0.35, 0.45, 0.55];
const BROKEN: Shares = [0.3, 0.4, 0.5, 0.6, 0.7, 0.75];

/// Row index for unknown names.
const UNKNOWN: usize = ROWS.len() - 1;

/// Words, lost share, scattering, transmission loss (sources: `docs/acoustics.md`). The first match applies.
const ROWS: [Row; 17] = [
    row(
        "curtain drape blind",
        [0.30, 0.45, 0.65, 0.56, 0.59, 0.71],
        BROKEN,
        [7.0, 7.0, 8.0, 9.0, 10.0, 11.0],
    ),
    row("carpet rug wool moquette", [0.03, 0.09, 0.25, 0.31, 0.33, 0.44], ROUGH, CLOSED),
    row(
        "fabric cloth textile velvet cotton linen denim knit quilt sofa couch bed mattress \
                cushion pillow towel blanket upholster",
        [0.44, 0.60, 0.77, 0.89, 0.82, 0.70],
        BROKEN,
        CLOSED,
    ),
    row("leather", [0.40, 0.50, 0.58, 0.61, 0.58, 0.50], BROKEN, CLOSED),
    row("foam acoustic insulation mineralwool rockwool", [0.22, 0.60, 0.92, 0.90, 0.88, 0.88], ROUGH, CLOSED),
    row(
        "glass window mirror pane",
        [0.10, 0.05, 0.04, 0.03, 0.03, 0.03],
        SMOOTH,
        [11.0, 13.5, 14.5, 16.0, 16.0, 16.0],
    ),
    row(
        "wood oak pine walnut parquet plywood bamboo wicker laminate door cabinet chest table \
                shelf shelves shelving wardrobe desk",
        [0.14, 0.10, 0.06, 0.08, 0.10, 0.10],
        ROUGH,
        [10.0, 11.5, 13.0, 14.0, 15.0, 16.0],
    ),
    row("brick", [0.03, 0.03, 0.03, 0.04, 0.05, 0.07], ROUGH, HEAVY),
    row(
        "stone concrete marble granite terrazzo cement slate",
        [0.02, 0.03, 0.03, 0.03, 0.04, 0.07],
        SMOOTH,
        HEAVY,
    ),
    row(
        "tile ceramic porcelain sink toilet bathtub shower",
        [0.01, 0.01, 0.01, 0.02, 0.02, 0.02],
        SMOOTH,
        HEAVY,
    ),
    row(
        "metal steel iron chrome brass copper aluminium aluminum appliance refrigerator fridge oven",
        [0.05, 0.04, 0.03, 0.03, 0.03, 0.03],
        ROUGH,
        [15.0, 17.0, 19.0, 21.0, 23.0, 25.0],
    ),
    row(
        "plastic rubber vinyl linoleum pvc acrylic",
        [0.02, 0.03, 0.03, 0.03, 0.03, 0.02],
        ROUGH,
        [18.0, 19.0, 20.0, 21.0, 22.0, 24.0],
    ),
    row("paper book cardboard picture poster cork", [0.05, 0.07, 0.10, 0.13, 0.15, 0.18], BROKEN, CLOSED),
    row("plant leaf leaves grass moss foliage", [0.10, 0.10, 0.12, 0.17, 0.25, 0.30], BROKEN, CLOSED),
    row("people person clothes", [0.16, 0.24, 0.56, 0.69, 0.81, 0.78], BROKEN, CLOSED),
    row(
        "plaster drywall gypsum stucco wallpaper paint wall ceiling",
        [0.16, 0.15, 0.15, 0.15, 0.15, 0.16],
        ROUGH,
        [10.0, 14.0, 18.0, 21.0, 23.0, 23.0],
    ),
    row("", [0.12, 0.13, 0.15, 0.17, 0.19, 0.21], [0.3; SURFACE_BANDS], [12.0, 15.0, 18.0, 21.0, 23.0, 25.0]),
];

const fn row(words: &'static str, lost: Shares, scattering: Shares, reduction_db: Shares) -> Row {
    Row { words, lost, scattering, reduction_db }
}

fn surfaces() -> Vec<Surface> {
    ROWS.iter().map(Row::surface).collect()
}

/// Returns the first row with a prefix of a token in `name`; `None` without a match.
fn find(name: &str) -> Option<usize> {
    let tokens = tokens(name);
    let fits = |row: &Row| {
        row.words.split_whitespace().any(|word| tokens.iter().any(|token| token.starts_with(word)))
    };
    ROWS.iter().position(fits)
}

/// Lower-case words in a name, split at non-letters and before capitals.
fn tokens(name: &str) -> Vec<String> {
    let mut tokens = vec![String::new()];
    let mut after_small = false;
    for letter in name.chars() {
        if !letter.is_alphabetic() || (after_small && letter.is_uppercase()) {
            tokens.push(String::new());
        }
        after_small = letter.is_lowercase();
        if let (true, Some(token)) = (letter.is_alphabetic(), tokens.last_mut()) {
            token.extend(letter.to_lowercase());
        }
    }
    tokens
}

impl Row {
    fn surface(&self) -> Surface {
        let transmission: Shares = std::array::from_fn(|band| libm::exp10f(-self.reduction_db[band] / 10.0));
        let absorption = std::array::from_fn(|band| (self.lost[band] - transmission[band]).max(0.0));
        Surface { absorption, scattering: self.scattering, transmission }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_shares_are_reported_by_name() {
        let fine = [0.5; SURFACE_BANDS];
        let with = |band: usize, value: f32| {
            let mut shares = fine;
            shares[band] = value;
            shares
        };
        assert!(Surface::new(fine, fine, fine).is_ok());
        let message = |result: Result<Surface, SurfaceError>| result.expect_err("refused").to_string();
        let text = message(Surface::new(with(2, 1.5), fine, [0.0; SURFACE_BANDS]));
        assert_eq!(text, "absorption at 500 Hz is 1.5; an energy share must be 0 to 1");
        assert!(message(Surface::new(fine, with(0, -0.1), fine)).starts_with("scattering at 125 Hz"));
        assert!(message(Surface::new(fine, fine, with(5, f32::NAN))).contains("4000 Hz is NaN"));
        assert!(message(Surface::new(fine, fine, with(1, 0.75))).contains("at 250 Hz is 1.25;"));
    }

    #[test]
    fn every_row_is_a_surface() {
        for (surface, row) in surfaces().into_iter().zip(&ROWS) {
            let checked = Surface::new(surface.absorption, surface.scattering, surface.transmission);
            assert_eq!(checked, Ok(surface), "{:?}", row.words);
        }
        assert!(ROWS[UNKNOWN].words.is_empty());
    }

    #[test]
    fn names_match_by_token_prefix() {
        let word_of = |name: &str| find(name).and_then(|row| ROWS[row].words.split(' ').next());
        for (name, word) in [
            ("wood", "wood"),
            ("WoodFloorsCrossRED", "wood"),
            ("aws_robomaker_residential_Carpet_01_0", "carpet"),
            ("YellowDrywall", "plaster"),
            ("WhiteMarble2", "stone"),
            ("shower curtain", "curtain"),
            ("chest_of_drawers", "wood"),
            ("KitchenTiles", "tile"),
        ] {
            assert_eq!(word_of(name), Some(word), "{name}");
        }
        for name in ["", "mat12", "chunk_003", "flat_black", "Material", "drug"] {
            assert_eq!(word_of(name), None, "{name}");
        }
    }

    /// A row as printed in the document.
    fn shown(row: &Row) -> String {
        let list = |values: &[f32; SURFACE_BANDS]| values.map(|value| format!("{value}")).join(" ");
        let reduction = if row.reduction_db == CLOSED { "closed".into() } else { list(&row.reduction_db) };
        let words = if row.words.is_empty() { "anything else".into() } else { row.words.replace(' ', ", ") };
        format!("| {words} | {} | {} | {reduction} |", list(&row.lost), list(&row.scattering))
    }

    #[test]
    fn documentation_contains_the_table() {
        let page = include_str!("../../../../docs/acoustics.md");
        for row in &ROWS {
            assert!(page.contains(&shown(row)), "docs/acoustics.md lacks this row:\n{}", shown(row));
        }
    }
}
