/// An image segmentation: a coarser map over the whole image.
#[derive(Clone, Debug, PartialEq)]
pub struct Segmentation {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Likeliest category by pixel, row by row from the top-left.
    pub categories: Vec<u8>,
    /// Probability, 0 to 1.
    pub confidences: Vec<f32>,
    /// Instances, largest first, without the building itself.
    pub segments: Vec<Segment>,
}

/// The visible part of an instance.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// Pixel indices, ascending: row times width plus column.
    pub mask: Vec<u32>,
    /// Probability by category; the sum is 1.
    pub categories: Vec<f32>,
    /// Unit embedding: close by cosine to other views of the instance, distant from other instances in the category.
    pub embedding: Vec<f32>,
    /// Colours.
    pub histogram: Histogram,
    /// Bounding box.
    pub bounds: PixelBox,
}

/// A box of pixels; both ends are inside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelBox {
    /// First and last column.
    pub columns: [u32; 2],
    /// First and last row.
    pub rows: [u32; 2],
}

/// Radius around an image's middle, as a share of the width.
const MIDDLE_SHARE: f32 = 0.08;

impl Segmentation {
    /// Returns the instance in the middle; `None` if only the building is there.
    pub fn in_the_middle(&self) -> Option<&Segment> {
        let weighed = self.segments.iter().map(|segment| (segment, self.middle_weight(segment)));
        let best = weighed.max_by(|a, b| a.1.total_cmp(&b.1))?;
        (best.1 > 0.0).then_some(best.0)
    }

    /// Returns a segment's pixel weight in the middle.
    fn middle_weight(&self, segment: &Segment) -> f32 {
        let reach = MIDDLE_SHARE * self.width as f32;
        let from_middle = |at: usize, side: usize| (at as f32 + 0.5 - 0.5 * side as f32) / reach;
        let weight = |pixel: &u32| {
            let (row, column) = (*pixel as usize / self.width, *pixel as usize % self.width);
            let (x, y) = (from_middle(column, self.width), from_middle(row, self.height));
            libm::expf(-0.5 * (x * x + y * y))
        };
        segment.mask.iter().map(weight).sum()
    }
}

impl Segment {
    /// Returns the likeliest category and the probability.
    pub fn category(&self) -> (usize, f32) {
        let all = self.categories.iter().copied().enumerate();
        all.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0))
    }

    /// Returns the cosine of the embeddings, -1 to 1; meaningful within a category.
    pub fn cosine(&self, other: &Self) -> f32 {
        self.embedding.iter().zip(&other.embedding).map(|(a, b)| a * b).sum()
    }
}

impl PixelBox {
    /// Returns the bounding box for pixels in rows of `width`; `None` without pixels.
    pub(crate) fn around(pixels: &[u32], width: usize) -> Option<Self> {
        let place = |pixel: &u32| (pixel % width as u32, pixel / width as u32);
        let (column, row) = place(pixels.first()?);
        let start = Self { columns: [column; 2], rows: [row; 2] };
        Some(pixels.iter().map(place).fold(start, |bounds, (column, row)| Self {
            columns: [bounds.columns[0].min(column), bounds.columns[1].max(column)],
            rows: [bounds.rows[0].min(row), bounds.rows[1].max(row)],
        }))
    }
}

/// Hues, each in [`VIVIDNESSES`] steps of saturation; then greys by value.
const HUES: usize = 12;
const VIVIDNESSES: usize = 3;
const GREYS: usize = 4;
const BINS: usize = HUES * VIVIDNESSES + GREYS;
/// Saturation below which a colour is grey, 0 to 1, and value below which it is black, 0 to 255.
const GREY: f32 = 0.12;
const BLACK: f32 = 40.0;

/// A colour histogram: shares by hue and saturation, and of greys by value; they add up to 1 unless empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Histogram {
    shares: Vec<f32>,
}

impl Histogram {
    /// Counts pixels.
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

    /// Returns the shares: 12 hues from red, three saturations each, then four greys from black.
    pub fn shares(&self) -> &[f32] {
        &self.shares
    }

    /// Returns the histogram intersection, 0 to 1 (Swain and Ballard 1991).
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

    fn segment(mask: Vec<u32>) -> Segment {
        let bounds = PixelBox::around(&mask, 16).expect("pixels");
        let (categories, histogram) = (vec![0.2, 0.7, 0.1], Histogram::default());
        Segment { mask, categories, embedding: vec![0.6, 0.8], histogram, bounds }
    }

    #[test]
    fn middle_prefers_position_to_size() {
        let large = segment((0..80).collect());
        let small = segment(vec![119, 120, 135, 136]);
        let mut seen = Segmentation {
            width: 16,
            height: 16,
            categories: vec![0; 256],
            confidences: vec![1.0; 256],
            segments: vec![large, small],
        };
        assert_eq!(seen.in_the_middle().map(|segment| segment.mask.len()), Some(4));
        seen.segments.clear();
        assert_eq!(seen.in_the_middle(), None);
    }

    #[test]
    fn segments_have_box_category_and_cosine() {
        let segment = segment(vec![18, 35, 36]);
        assert_eq!(segment.bounds, PixelBox { columns: [2, 4], rows: [1, 2] });
        assert_eq!(segment.category(), (1, 0.7));
        assert!((segment.cosine(&segment) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn distinct_colours_have_distinct_bins() {
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
    fn likeness_is_the_intersection() {
        let red = Histogram::of([[200, 0, 0]; 4].into_iter());
        let half = Histogram::of([[200, 0, 0], [200, 0, 0], [0, 0, 200], [0, 0, 200]].into_iter());
        assert_eq!((red.likeness(&red), red.likeness(&half), half.likeness(&red)), (1.0, 0.5, 0.5));
        assert_eq!(Histogram::of(std::iter::empty()).likeness(&red), 0.0);
    }
}
