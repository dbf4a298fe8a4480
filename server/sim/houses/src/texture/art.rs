//! Wall pictures: a coloured ground and a motif.

use super::Texture;
use avln_geom::{Rng, angle};
use avln_scene::colors::PALETTE;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Art {
    /// Ground colour, sRGB.
    pub(crate) ground: [u8; 3],
    pub(crate) motif: Motif,
    pub(crate) medium: Medium,
    pub(crate) seed: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Motif {
    Circles,
    Squares,
    Lines,
    Mountains,
    Portrait,
    Flowers,
    Waves,
    Rays,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Medium {
    Oil,
    Print,
    Weaving,
    Panel,
    Plate,
    Glaze,
}

impl Motif {
    pub(crate) const ALL: [Motif; 8] = {
        use Motif::*;
        [Circles, Squares, Lines, Mountains, Portrait, Flowers, Waves, Rays]
    };
}

const SIZE: u32 = 64;

/// Picture coordinates from the centre, y upwards, -1 to 1.
type Place = [f32; 2];

impl Art {
    /// Draws the picture; more than half of the ground stays visible.
    pub(super) fn draw(self) -> Texture {
        let mut rng = Rng::new(u64::from(self.seed));
        // The ground stays the largest area: it is the picture's colour word.
        let mut canvas = vec![self.ground; (SIZE * SIZE) as usize];
        let count = match self.motif {
            Motif::Mountains | Motif::Portrait => 1,
            Motif::Rays => 2,
            _ => 3 + rng.below(3),
        };
        for _ in 0..count {
            let color = tone(&mut rng, self.ground);
            let inside = self.shape(&mut rng);
            for (index, texel) in canvas.iter_mut().enumerate() {
                let (x, y) = ((index as u32 % SIZE) as f32 + 0.5, (index as u32 / SIZE) as f32 + 0.5);
                let half = SIZE as f32 / 2.0;
                if inside([x / half - 1.0, 1.0 - y / half]) {
                    *texel = color;
                }
            }
        }
        let pixels =
            canvas.iter().enumerate().flat_map(|(index, rgb)| self.medium.textured(index as u32, *rgb));
        Texture { width: SIZE, height: SIZE, pixels: pixels.collect() }
    }

    /// Draws a part of the motif as an inside test.
    fn shape(self, rng: &mut Rng) -> Box<dyn Fn(Place) -> bool> {
        let center = [rng.range(-0.65, 0.65), rng.range(-0.65, 0.65)];
        let size = rng.range(0.16, 0.28);
        let off = move |[x, y]: Place| [x - center[0], y - center[1]];
        match self.motif {
            Motif::Circles => Box::new(move |place| length(off(place)) < size),
            Motif::Squares => Box::new(move |place| off(place).iter().all(|d| d.abs() < size * 0.9)),
            Motif::Lines => {
                let turn = angle::sin_cos(rng.range(0.0, std::f32::consts::PI));
                Box::new(move |place| {
                    let [x, y] = off(place);
                    (x * turn.0 + y * turn.1).abs() < size * 0.16
                })
            }
            Motif::Mountains => mountains(center[0], size),
            Motif::Portrait => Box::new(move |[x, y]| {
                length([x / 0.27, (y - 0.2) / 0.36]) < 1.0
                    || (y < -0.15 && length([x / 0.62, (y + 1.0) / 0.75]) < 1.0)
            }),
            Motif::Flowers => Box::new(move |place| {
                let [x, y] = off(place);
                let petals = angle::atan2(y, x);
                let (sin, _) = angle::sin_cos(petals * 2.5);
                length([x, y]) < size * (0.65 + 0.5 * sin.abs()) || (x.abs() < 0.03 && y < 0.0 && y > -0.5)
            }),
            Motif::Waves => Box::new(move |[x, y]| {
                let (sin, _) = angle::sin_cos(x * 5.0 + center[0] * 9.0);
                (y - center[1] - 0.1 * sin).abs() < size * 0.26
            }),
            Motif::Rays => {
                let turn = rng.range(0.0, 0.6);
                Box::new(move |[x, y]| {
                    let sector = (angle::atan2(y, x) + 4.0 + turn) * 8.0 / std::f32::consts::TAU;
                    sector.fract() < 0.22 && length([x, y]) > 0.15 || length([x, y]) < 0.12
                })
            }
        }
    }
}

fn length([x, y]: Place) -> f32 {
    (x * x + y * y).sqrt()
}

/// Peaks at the lower edge, with a sun.
fn mountains(shift: f32, size: f32) -> Box<dyn Fn(Place) -> bool> {
    Box::new(move |[x, y]| {
        let peak = |at: f32, height: f32| y < height - (x - at).abs() * 1.1 - 1.0;
        let sun = length([x + shift, y - 0.5]) < size * 0.7;
        peak(shift, 0.9) || peak(shift - 0.7, 0.6) || peak(shift + 0.8, 0.7) || sun
    })
}

/// Draws a darker or lighter variant of `ground`, sometimes another colour with similar brightness.
fn tone(rng: &mut Rng, ground: [u8; 3]) -> [u8; 3] {
    let mixed = |to: f32, share: f32| {
        ground.map(|value| (f32::from(value) * (1.0 - share) + to * share).round() as u8)
    };
    let brightness = |rgb: [u8; 3]| rgb.iter().map(|&value| u32::from(value)).sum::<u32>();
    let near = |rgb: &[u8; 3]| *rgb != ground && brightness(*rgb).abs_diff(brightness(ground)) < 90;
    let others: Vec<[u8; 3]> = PALETTE.iter().map(|(_, rgb)| *rgb).filter(near).collect();
    match rng.below(4) {
        0 if brightness(ground) > 300 => mixed(255.0, 0.3),
        1 if brightness(ground) > 120 => mixed(0.0, 0.5),
        2 if !others.is_empty() => others[rng.below(others.len())],
        _ if brightness(ground) > 330 => mixed(0.0, 0.28),
        _ => mixed(255.0, if brightness(ground) < 200 { 0.16 } else { 0.28 }),
    }
}

impl Medium {
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Oil => "painted",
            Self::Print => "printed",
            Self::Weaving => "woven",
            Self::Panel => "wooden",
            Self::Plate => "metal",
            Self::Glaze => "ceramic",
        }
    }

    /// Acoustic material.
    pub(crate) fn surface(self) -> &'static str {
        match self {
            Self::Oil | Self::Weaving => "fabric",
            Self::Print => "paper",
            Self::Panel => "wood",
            Self::Plate => "metal",
            Self::Glaze => "ceramic",
        }
    }

    pub(crate) const ALL: [Medium; 6] =
        [Self::Oil, Self::Print, Self::Weaving, Self::Panel, Self::Plate, Self::Glaze];

    fn textured(self, index: u32, rgb: [u8; 3]) -> [u8; 4] {
        let (x, y) = (index % SIZE, index / SIZE);
        let shade = match self {
            Self::Oil => [1.0, 0.96, 0.98, 0.94][((x + y * 3) / 2 % 4) as usize],
            Self::Print => 1.0,
            Self::Weaving => [0.88, 1.0][((x / 2 + y / 2) % 2) as usize],
            Self::Panel if y % 16 == 0 => 0.75,
            Self::Panel => 0.97,
            Self::Plate => [0.92, 1.0, 0.96][(y % 3) as usize],
            Self::Glaze if x % 16 == 0 || y % 16 == 0 => 0.8,
            Self::Glaze => 1.0,
        };
        let [r, g, b] = rgb.map(|value| (f32::from(value) * shade).round() as u8);
        [r, g, b, 255]
    }
}

/// Draws upright book spines in a row.
pub(super) fn books(seed: u8) -> Texture {
    let mut rng = Rng::new(0xb00c + u64::from(seed));
    let mut columns: Vec<([u8; 3], u32)> = Vec::new();
    while columns.len() < SIZE as usize {
        let (_, rgb) = PALETTE[rng.below(PALETTE.len())];
        let dimmed = rgb.map(|value| (f32::from(value) * 0.85) as u8);
        let band = rng.below(40) as u32 + 6;
        let width = 3 + rng.below(4);
        columns.extend((0..width).map(|i| if i == 0 { ([40, 38, 36], SIZE) } else { (dimmed, band) }));
    }
    let texel = |x: usize, y: u32| {
        let (rgb, band) = columns[x];
        let gilt = y == band || y == band + 3;
        if gilt { [214, 190, 120] } else { rgb }
    };
    let rows = (0..SIZE).flat_map(|y| (0..SIZE as usize).map(move |x| (x, y)));
    let pixels = rows.flat_map(|(x, y)| {
        let [r, g, b] = texel(x, y);
        [r, g, b, 255]
    });
    Texture { width: SIZE, height: SIZE, pixels: pixels.collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ground_covers_more_than_half_of_pictures() {
        for seed in 0..160_u32 {
            let motif = Motif::ALL[seed as usize % 8];
            let art = Art { ground: [246, 226, 52], motif, medium: Medium::Print, seed };
            let texture = art.draw();
            let same = texture.pixels.chunks(4).filter(|texel| texel[..3] == art.ground).count();
            let all = (SIZE * SIZE) as usize;
            assert!(same > all / 2 && same < all, "{motif:?}, seed {seed}: {same}");
        }
    }
}
