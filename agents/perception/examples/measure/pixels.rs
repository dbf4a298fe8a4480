//! Pixels and whole objects: which category they are, and which they are taken for.

use avln_perception::Seen;

/// Sizes from which objects count, pixels of the map.
pub(crate) const SIZES_PX: [usize; 2] = [25, 100];

/// Counts of pixels and objects by what they are (row) and what they are taken for (column).
pub(crate) struct Confusion {
    kinds: usize,
    pixels: Vec<u64>,
    /// For each of [`SIZES_PX`].
    objects: [Vec<u64>; 2],
}

/// What a picture really shows, at the size of the map of what is seen.
pub(crate) struct Truth {
    pub(crate) categories: Vec<u8>,
    pub(crate) instances: Vec<u16>,
}

impl Confusion {
    pub(crate) fn new(kinds: usize) -> Self {
        let table = || vec![0; kinds * kinds];
        Self { kinds, pixels: table(), objects: [table(), table()] }
    }

    pub(crate) fn add(&mut self, seen: &Seen, truth: &Truth, building: usize) {
        let mut objects = std::collections::BTreeMap::<u16, Vec<usize>>::new();
        for (pixel, &category) in
            truth.categories.iter().enumerate().filter(|(_, c)| usize::from(**c) < self.kinds)
        {
            self.pixels[usize::from(category) * self.kinds + usize::from(seen.categories[pixel])] += 1;
            if truth.instances[pixel] > 0 && usize::from(category) >= building {
                objects.entry(truth.instances[pixel]).or_default().push(pixel);
            }
        }
        for mask in objects.values() {
            let is = usize::from(truth.categories[mask[0]]);
            let mut votes = vec![0.0; self.kinds];
            mask.iter()
                .for_each(|&p| votes[usize::from(seen.categories[p])] += f64::from(seen.confidences[p]));
            let told = (0..self.kinds).max_by(|&a, &b| votes[a].total_cmp(&votes[b])).unwrap_or(0);
            for (size, table) in SIZES_PX.iter().zip(&mut self.objects) {
                table[is * self.kinds + told] += u64::from(mask.len() >= *size);
            }
        }
    }

    /// Intersection over union of each category; `None` where nothing is of it.
    pub(crate) fn ious(&self) -> Vec<Option<f64>> {
        let sum = |cells: &mut dyn Iterator<Item = usize>| cells.map(|cell| self.pixels[cell]).sum::<u64>();
        let iou = |kind: usize| {
            let are = sum(&mut (0..self.kinds).map(|told| kind * self.kinds + told));
            let told = sum(&mut (0..self.kinds).map(|is| is * self.kinds + kind));
            let both = self.pixels[kind * self.kinds + kind];
            (are > 0).then(|| both as f64 / (are + told - both) as f64)
        };
        (0..self.kinds).map(iou).collect()
    }

    /// Share of pixels whose category is right.
    pub(crate) fn pixel_accuracy(&self) -> f64 {
        right_share(&self.pixels, self.kinds)
    }

    /// Share of objects of at least the `size`th of [`SIZES_PX`] whose category is right, and how many there are.
    pub(crate) fn object_accuracy(&self, size: usize) -> (f64, u64) {
        (right_share(&self.objects[size], self.kinds), self.objects[size].iter().sum())
    }

    /// What the objects of a category of at least the larger size are taken for.
    pub(crate) fn objects(&self, is: usize) -> &[u64] {
        &self.objects[1][is * self.kinds..(is + 1) * self.kinds]
    }

    /// Objects of at least the larger size that are most often taken for something else: (what, for what, how often, of how
    /// many), by the share, among categories of 20 and more.
    pub(crate) fn worst(&self, most: usize) -> Vec<(usize, usize, u64, u64)> {
        let mut pairs = Vec::new();
        for is in 0..self.kinds {
            let row = self.objects(is);
            let all: u64 = row.iter().sum();
            let wrong =
                row.iter().enumerate().filter(|(told, count)| *told != is && **count > 2 && all >= 20);
            pairs.extend(wrong.map(|(told, count)| (is, told, *count, all)));
        }
        pairs.sort_by(|a, b| (b.2 * a.3).cmp(&(a.2 * b.3)));
        pairs.truncate(most);
        pairs
    }
}

fn right_share(table: &[u64], kinds: usize) -> f64 {
    let right: u64 = (0..kinds).map(|kind| table[kind * kinds + kind]).sum();
    right as f64 / table.iter().sum::<u64>().max(1) as f64
}
