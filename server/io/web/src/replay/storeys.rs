//! Storeys, found from the floor polygons.

use avln_store::SceneMap;
use std::collections::BTreeMap;

const LAYER_M: f32 = 0.3;
/// Smallest distance between storeys, metres.
const APART_M: f32 = 1.5;
// Smallest share of the floor area in a storey; stairs and platforms stay below.
const LEAST_SHARE: f32 = 0.08;

/// A map point, metres: +x is right (world +X), +y is down (world +Z).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Spot {
    pub(crate) x: f32,
    pub(crate) y: f32,
}

pub(super) fn spot(point: &[f32; 3]) -> Spot {
    let finite = |value: f32| if value.is_finite() { value } else { 0.0 };
    Spot { x: finite(point[0]), y: finite(point[2]) }
}

/// Storey heights, metres, lowest first; never empty.
#[derive(Debug, PartialEq)]
pub(crate) struct Storeys(Vec<f32>);

impl Storeys {
    /// Selects the layers with most floor area; `fallback_m` is for buildings without floor.
    pub(super) fn of(map: &SceneMap, fallback_m: f32) -> Self {
        let mut layers: BTreeMap<i32, f32> = BTreeMap::new();
        for polygon in map.polygons.iter().filter(|polygon| !polygon.is_empty()) {
            *layers.entry((height(polygon) / LAYER_M).round() as i32).or_default() += area(polygon);
        }
        let all: f32 = layers.values().sum();
        let mut heights = Vec::new();
        while let Some((&layer, &floor)) = layers.iter().max_by(|a, b| a.1.total_cmp(b.1)) {
            if floor < LEAST_SHARE * all && !heights.is_empty() {
                break;
            }
            heights.push(layer as f32 * LAYER_M);
            layers.retain(|other, _| (other - layer).abs() as f32 * LAYER_M >= APART_M);
        }
        heights.sort_by(f32::total_cmp);
        Self(if heights.is_empty() { vec![fallback_m] } else { heights })
    }

    pub(super) fn count(&self) -> usize {
        self.0.len()
    }

    pub(super) fn nearest(&self, height: f32) -> usize {
        let distance = |index: &usize| (self.0[*index] - height).abs();
        (0..self.0.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(0)
    }

    pub(super) fn heights_m(&self) -> impl Iterator<Item = f32> {
        self.0.iter().map(|height| height - self.0[0])
    }
}

pub(super) fn height(polygon: &[[f32; 3]]) -> f32 {
    polygon.iter().map(|point| point[1]).sum::<f32>() / polygon.len().max(1) as f32
}

fn area(polygon: &[[f32; 3]]) -> f32 {
    let next = polygon.iter().cycle().skip(1);
    let twice: f32 = polygon.iter().zip(next).map(|(a, b)| a[0] * b[2] - b[0] * a[2]).sum();
    twice.abs() / 2.0
}

/// Splits a path by storey; consecutive pieces share a point.
pub(super) fn by_storey(points: &[[f32; 3]], storeys: &Storeys) -> Vec<(usize, Vec<Spot>)> {
    let mut pieces: Vec<(usize, Vec<Spot>)> = Vec::new();
    for pair in points.windows(2) {
        let storey = storeys.nearest((pair[0][1] + pair[1][1]) / 2.0);
        let to = spot(&pair[1]);
        match pieces.last_mut() {
            Some((last, spots)) if *last == storey => spots.push(to),
            _ => pieces.push((storey, vec![spot(&pair[0]), to])),
        }
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    fn floor(height: f32, side: f32) -> Vec<[f32; 3]> {
        vec![[0.0, height, 0.0], [side, height, 0.0], [side, height, side], [0.0, height, side]]
    }

    fn map(polygons: Vec<Vec<[f32; 3]>>) -> SceneMap {
        SceneMap { polygons, ..SceneMap::default() }
    }

    #[test]
    fn storeys_have_most_of_the_floor() {
        let mut polygons = vec![floor(0.0, 10.0), floor(3.12, 8.0)];
        polygons.extend((1..15).map(|step| floor(step as f32 * 0.2, 0.5)));
        let storeys = Storeys::of(&map(polygons), 7.0);
        assert_eq!(storeys.count(), 2);
        assert_eq!([storeys.nearest(0.4), storeys.nearest(1.4), storeys.nearest(2.0)], [0, 0, 1]);
        let heights: Vec<f32> = storeys.heights_m().collect();
        assert!(heights[0] == 0.0 && (heights[1] - 3.1).abs() < 0.2, "{heights:?}");
    }

    #[test]
    fn a_building_without_floor_has_one_storey() {
        let storeys = Storeys::of(&map(vec![vec![]]), 7.0);
        assert_eq!((storeys.count(), storeys.nearest(-3.0)), (1, 0));
        assert_eq!(storeys.heights_m().collect::<Vec<_>>(), [0.0]);
    }

    #[test]
    fn paths_are_split_between_storeys() {
        let storeys = Storeys(vec![0.0, 3.0]);
        let points = [[0.0, 0.0, 0.0], [1.0, 0.5, 0.0], [2.0, 2.9, 0.0], [3.0, 3.0, 0.0]];
        let pieces = by_storey(&points, &storeys);
        let lengths: Vec<(usize, usize)> =
            pieces.iter().map(|(storey, spots)| (*storey, spots.len())).collect();
        assert_eq!(lengths, [(0, 2), (1, 3)]);
        assert_eq!(pieces[0].1[1], pieces[1].1[0]);
    }
}
