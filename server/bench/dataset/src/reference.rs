use avln_geom::Point3;
use avln_world::{DistanceField, NavMesh, NavPoint};

/// The shortest tour from a start through one point of each region.
///
/// Exact over the points of the regions: dynamic programming over (regions visited, last region), where each
/// state holds the cheapest way to every point of its last region.
pub(crate) struct Tour<'a> {
    navmesh: &'a NavMesh,
    start: NavPoint,
    regions: &'a [Vec<NavPoint>],
}

/// The cheapest ways to the points of the region that was visited last.
struct State {
    region: usize,
    /// State before this one; `None` when the tour came straight from the start.
    previous: Option<usize>,
    /// Cheapest way of all, metres; infinite when the region cannot be reached.
    best_m: f64,
    /// Distance of any place by way of this state.
    field: DistanceField,
}

impl<'a> Tour<'a> {
    pub(crate) fn new(navmesh: &'a NavMesh, start: NavPoint, regions: &'a [Vec<NavPoint>]) -> Self {
        Self { navmesh, start, regions }
    }

    /// Length, metres, and corners of the tour that visits the regions as listed; `None` when one is out of reach.
    pub(crate) fn ordered(&self) -> Option<(f64, Vec<Point3<f32>>)> {
        let mut states: Vec<State> = Vec::new();
        for region in 0..self.regions.len() {
            let previous = region.checked_sub(1);
            states.push(self.visit(&states, previous, region));
        }
        self.finish(&states, self.regions.len().checked_sub(1)?)
    }

    /// The same for the best of all orders.
    pub(crate) fn unordered(&self) -> Option<(f64, Vec<Point3<f32>>)> {
        let count = self.regions.len();
        let mut states: Vec<State> = Vec::new();
        let mut ending_with = vec![Vec::new(); 1 << count];
        for visited in 1_usize..1 << count {
            for last in (0..count).filter(|last| visited >> last & 1 == 1) {
                let before = visited & !(1 << last);
                let options: Vec<Option<usize>> = match before {
                    0 => vec![None],
                    _ => ending_with[before].iter().copied().map(Some).collect(),
                };
                let ways = options.into_iter().map(|previous| self.visit(&states, previous, last));
                let way = ways.min_by(|a, b| a.best_m.total_cmp(&b.best_m))?;
                ending_with[visited].push(states.len());
                states.push(way);
            }
        }
        let complete = ending_with.last()?.iter().copied();
        let best = complete.min_by(|&a, &b| states[a].best_m.total_cmp(&states[b].best_m))?;
        self.finish(&states, best)
    }

    /// Goes on from state `previous`, or from the start, to every point of `region`.
    fn visit(&self, states: &[State], previous: Option<usize>, region: usize) -> State {
        let from_start = previous.is_none().then(|| self.navmesh.field(&[(self.start, 0.0)]));
        let reached = from_start.as_ref().or(previous.map(|index| &states[index].field));
        let cost = |point: &NavPoint| reached.and_then(|field| field.distance_m(self.navmesh, point));
        let points = self.regions[region].iter();
        let seeds: Vec<_> = points.filter_map(|point| Some((*point, cost(point)?))).collect();
        let best_m = seeds.iter().map(|(_, cost_m)| *cost_m).fold(f64::INFINITY, f64::min);
        State { region, previous, best_m, field: self.navmesh.field(&seeds) }
    }

    fn finish(&self, states: &[State], last: usize) -> Option<(f64, Vec<Point3<f32>>)> {
        let length_m = states[last].best_m;
        length_m.is_finite().then(|| (length_m, self.corners(states, last).unwrap_or_default()))
    }

    /// Walks the states backwards from the cheapest point of `last` to the start.
    fn corners(&self, states: &[State], last: usize) -> Option<Vec<Point3<f32>>> {
        let mut state = &states[last];
        let mut point = *self.regions[state.region].iter().min_by(|a, b| {
            let cost = |p| state.field.distance_m(self.navmesh, p).unwrap_or(f64::INFINITY);
            cost(a).total_cmp(&cost(b))
        })?;
        let mut backwards = Vec::new();
        while let Some(previous) = state.previous {
            state = &states[previous];
            let leg = state.field.path(self.navmesh, &point)?;
            point = self.navmesh.snap(leg.last()?, 0.1)?;
            backwards.extend(leg);
        }
        backwards.extend(self.navmesh.path(&point, &self.start)?);
        backwards.reverse();
        backwards.dedup();
        Some(backwards)
    }
}
