/// Hues, each in [`VIVIDNESSES`] steps of saturation; then greys by value.
const HUES: usize = 12;
const VIVIDNESSES: usize = 3;
const GREYS: usize = 4;
const BINS: usize = HUES * VIVIDNESSES + GREYS;
/// Saturation below which a colour is a grey, 0 to 1, and value below which it is black, 0 to 255.
const GREY: f32 = 0.12;
const BLACK: f32 = 40.0;

/// Shares of the pixels by hue and saturation, those of greys by value; they add up to 1 unless there is no pixel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Histogram {
    shares: Vec<f32>,
}

impl Histogram {
    /// The histogram of some pixels.
    pub fn of(pixels: impl Iterator<Item = [u8; 3]>) -> Self {
        let mut shares = vec![0.0; BINS];
        let mut count = 0.0_f32;
        for rgb in pixels {
            shares[bin(rgb)] += 1.0;
            count += 1.0;
        }
        shares.iter_mut().for_each(|share| *share /= count.max(1.0));
        Self { shares }
    }

    /// The shares: 12 hues from red on, three saturations of each, then four greys from black on.
    pub fn shares(&self) -> &[f32] {
        &self.shares
    }

    /// What both have in common, 0 to 1 (Swain and Ballard 1991).
    pub fn likeness(&self, other: &Self) -> f32 {
        self.shares.iter().zip(&other.shares).map(|(a, b)| a.min(*b)).sum()
    }
}

fn bin(rgb: [u8; 3]) -> usize {
    let [r, g, b] = rgb.map(f32::from);
    let (most, least) = (r.max(g).max(b), r.min(g).min(b));
    let (chroma, saturation) = (most - least, (most - least) / most.max(1.0));
    if saturation < GREY || most < BLACK {
        return HUES * VIVIDNESSES + ((most / 256.0 * GREYS as f32) as usize).min(GREYS - 1);
    }
    let sixth = match most {
        most if most == r => ((g - b) / chroma).rem_euclid(6.0),
        most if most == g => (b - r) / chroma + 2.0,
        _ => (r - g) / chroma + 4.0,
    };
    let hue = (sixth / 6.0 * HUES as f32) as usize % HUES;
    let vivid = ((saturation - GREY) / (1.0 - GREY) * VIVIDNESSES as f32) as usize;
    hue * VIVIDNESSES + vivid.min(VIVIDNESSES - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_fall_into_bins_of_their_own() {
        let bins: Vec<usize> = [
            [255, 0, 0],
            [255, 140, 0],
            [255, 255, 0],
            [0, 255, 0],
            [0, 0, 255],
            [255, 0, 255],
            [200, 90, 90],
            [255, 200, 200],
            [10, 0, 0],
            [90, 90, 90],
            [160, 160, 160],
            [250, 250, 250],
        ]
        .map(bin)
        .to_vec();
        let mut distinct = bins.clone();
        distinct.sort_unstable();
        distinct.dedup();
        assert_eq!(distinct.len(), bins.len(), "{bins:?}");
        assert!(bins.iter().all(|bin| *bin < BINS));
    }

    #[test]
    fn likeness_is_what_is_in_common() {
        let red = Histogram::of([[200, 0, 0]; 4].into_iter());
        let half = Histogram::of([[200, 0, 0], [200, 0, 0], [0, 0, 200], [0, 0, 200]].into_iter());
        assert_eq!((red.likeness(&red), red.likeness(&half), half.likeness(&red)), (1.0, 0.5, 0.5));
        assert_eq!(Histogram::of(std::iter::empty()).likeness(&red), 0.0);
    }
}
