use crate::Histogram;

/// What a picture shows, pixel by pixel of a map that covers the whole of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Seen {
    /// Pixels in a row of the map.
    pub width: usize,
    /// Rows of the map.
    pub height: usize,
    /// The likeliest category of each pixel, row by row from the top-left.
    pub categories: Vec<u8>,
    /// The likelihood of it, 0 to 1.
    pub confidences: Vec<f32>,
    /// Instances, the largest first. The building itself is in none.
    pub segments: Vec<Segment>,
}

/// One instance as far as a picture shows it.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// Its pixels, ascending: row times the width of the map plus column.
    pub mask: Vec<u32>,
    /// Likelihood of each category; they add up to 1.
    pub categories: Vec<f32>,
    /// Where it lies among things of its category: near, by cosine, to other views of the same instance. Length 1.
    pub embedding: Vec<f32>,
    /// Its colours.
    pub histogram: Histogram,
    /// The box around its pixels.
    pub bounds: PixelBox,
}

/// Columns and rows of a map, first and last, both inside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelBox {
    /// First and last column.
    pub columns: [u32; 2],
    /// First and last row.
    pub rows: [u32; 2],
}

/// How far from the middle of a picture pixels count for what is in the middle, as a share of its width.
const MIDDLE_SHARE: f32 = 0.08;

impl Seen {
    /// The instance in the middle; `None` where only the building is.
    pub fn in_the_middle(&self) -> Option<&Segment> {
        let weighed = self.segments.iter().map(|segment| (segment, self.middle_weight(segment)));
        let best = weighed.max_by(|a, b| a.1.total_cmp(&b.1))?;
        (best.1 > 0.0).then_some(best.0)
    }

    /// How much of a segment is in the middle.
    fn middle_weight(&self, segment: &Segment) -> f32 {
        let reach = MIDDLE_SHARE * self.width as f32;
        let from_middle = |at: usize, side: usize| (at as f32 + 0.5 - 0.5 * side as f32) / reach;
        let weight = |pixel: &u32| {
            let (row, column) = (*pixel as usize / self.width, *pixel as usize % self.width);
            let (x, y) = (from_middle(column, self.width), from_middle(row, self.height));
            (-0.5 * (x * x + y * y)).exp()
        };
        segment.mask.iter().map(weight).sum()
    }
}

impl Segment {
    /// Number of the likeliest category and its likelihood.
    pub fn category(&self) -> (usize, f32) {
        let all = self.categories.iter().copied().enumerate();
        all.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0))
    }

    /// Cosine of the angle between the embeddings, -1 to 1; above all among segments of one category.
    pub fn cosine(&self, other: &Self) -> f32 {
        self.embedding.iter().zip(&other.embedding).map(|(a, b)| a * b).sum()
    }
}

impl PixelBox {
    /// Around some pixels of a map with rows of `width`; `None` around none.
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

#[cfg(test)]
mod tests {
    use super::*;

    fn segment(mask: Vec<u32>) -> Segment {
        let bounds = PixelBox::around(&mask, 16).expect("pixels");
        let (categories, histogram) = (vec![0.2, 0.7, 0.1], Histogram::default());
        Segment { mask, categories, embedding: vec![0.6, 0.8], histogram, bounds }
    }

    #[test]
    fn the_middle_is_what_is_there_and_not_what_is_large() {
        let large = segment((0..80).collect());
        let small = segment(vec![119, 120, 135, 136]);
        let mut seen = Seen {
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
    fn segments_tell_box_category_and_likeness() {
        let segment = segment(vec![18, 35, 36]);
        assert_eq!(segment.bounds, PixelBox { columns: [2, 4], rows: [1, 2] });
        assert_eq!(segment.category(), (1, 0.7));
        assert!((segment.cosine(&segment) - 1.0).abs() < 1e-6);
    }
}
