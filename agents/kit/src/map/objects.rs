//! Object memory: hypotheses from detections over time.

use crate::LOOK_M;
use crate::geometry::{FloorPoint, Pose2d};
use crate::map::occupancy::Occupancy;
use crate::perception::category::categories_of;
use crate::perception::objects::DetectedObject;

const MOST: usize = 400;
/// Distance between the positions of two near views that both count, metres: one position is one look.
const APART_M: f32 = 0.2;
/// Positions of near views kept per hypothesis.
const MOST_VIEWS: usize = 12;

/// The paper's object memory O_t: object hypotheses merged over images, and their compatibility with the goals.
#[derive(Clone, Debug, Default)]
pub struct ObjectMemory {
    all: Vec<ObjectHypothesis>,
    goals: usize,
}

/// An object hypothesis.
#[derive(Clone, Debug)]
pub struct ObjectHypothesis {
    /// Position, extent and appearance.
    pub detection: DetectedObject,
    /// Near views.
    pub looks: u32,
    /// Frames with a detection of the hypothesis.
    views: u32,
    /// Claims after which the hypothesis is no candidate: refuted ones, and right ones without a further goal.
    pub wrong_submits: i32,
    /// Visual compatibility by goal over all views, 0 to 1 (s_vis in the paper).
    vis: Vec<f32>,
    /// Positions of the near views.
    viewed_from: Vec<FloorPoint>,
    /// Positions of views without the expected detection.
    missed_from: Vec<FloorPoint>,
    /// Probabilities of the categories in the tables of priors.
    categories: Vec<f32>,
}

/// A detection in the current frame: the only evidence for a visual verification.
///
/// Only [`ObjectMemory::recognise`] creates looks, from the detections of one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FreshLook {
    object: usize,
    fits: Vec<f32>,
}

impl FreshLook {
    /// Returns the index of the hypothesis that the detection belongs to.
    pub fn object(&self) -> usize {
        self.object
    }

    /// Returns s_vis of this look for a goal, 0 to 1.
    pub fn vis(&self, goal: usize) -> f32 {
        self.fits.get(goal).copied().unwrap_or(0.0)
    }
}

impl ObjectMemory {
    /// Creates a memory for `goals` goals.
    pub fn new(goals: usize) -> Self {
        Self { all: Vec::new(), goals }
    }

    /// Adds an image's detections.
    pub fn see(&mut self, seen: Vec<DetectedObject>) {
        for detection in seen {
            self.add(detection);
        }
    }

    /// Adds the detections of a frame from `pose`, compares each with the goals, and returns the looks. Views within
    /// [`LOOK_M`] count as near views.
    pub fn recognise(
        &mut self,
        pose: &Pose2d,
        seen: Vec<DetectedObject>,
        fit: impl Fn(&DetectedObject, usize) -> f32,
    ) -> Vec<FreshLook> {
        let mut looks = Vec::new();
        for detection in seen {
            let fits: Vec<f32> = (0..self.goals).map(|goal| fit(&detection, goal)).collect();
            let is_near = detection.distance_m(pose.place) <= LOOK_M;
            let is_cut = detection.is_cut;
            let Some(object) = self.add(detection) else { continue };
            self.all[object].view(&fits, is_near.then_some(pose.place), is_cut);
            looks.push(FreshLook { object, fits });
        }
        looks
    }

    /// Records a view from `place` that should show a hypothesis but does not: its compatibility with all goals falls, once per
    /// position.
    pub fn miss(&mut self, index: usize, place: FloorPoint) {
        let Some(object) = self.all.get_mut(index) else { return };
        if object.missed_from.iter().all(|from| from.distance_m(place) >= APART_M) {
            object.missed_from.push(place);
            object.mix(&vec![0.0; self.goals], object.views + object.missed_from.len() as u32, 1.0);
        }
    }

    /// Merges a detection into its hypothesis, or adds one; returns the index, `None` if the memory is full.
    fn add(&mut self, detection: DetectedObject) -> Option<usize> {
        // The first match wins: indices stay stable, which Submits and traces refer to.
        let known = self.all.iter().position(|known| known.detection.is_same(&detection));
        if let Some(index) = known {
            self.all[index].detection.merge(&detection);
        } else if self.all.len() < MOST {
            self.all.push(ObjectHypothesis::new(detection, self.goals));
        } else {
            return None;
        }
        let index = known.unwrap_or(self.all.len() - 1);
        self.all[index].categories = categories_of(&self.all[index].detection);
        Some(index)
    }

    /// Returns all hypotheses. Indices are stable within an episode.
    pub fn all(&self) -> &[ObjectHypothesis] {
        &self.all
    }

    /// Compares every object in view within `reach_m` metres with the goals; returns the objects' indices.
    pub fn look(
        &mut self,
        map: &Occupancy,
        pose: &Pose2d,
        reach_m: f32,
        fit: impl Fn(&DetectedObject, usize) -> f32,
    ) -> Vec<usize> {
        let mut in_view = Vec::new();
        for (index, object) in self.all.iter_mut().enumerate() {
            if map.is_in_view(pose, object.detection.center(), reach_m) {
                let fits: Vec<f32> = (0..self.goals).map(|goal| fit(&object.detection, goal)).collect();
                object.look(&fits);
                in_view.push(index);
            }
        }
        in_view
    }

    /// Returns all hypotheses for updates.
    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut ObjectHypothesis> {
        self.all.iter_mut()
    }

    /// Records a claim at a hypothesis, which is then no candidate, and resets the views.
    pub fn refute(&mut self, index: usize) {
        if let Some(object) = self.all.get_mut(index) {
            object.wrong_submits += 1;
            object.looks = 0;
            object.viewed_from.clear();
        }
    }
}

impl ObjectHypothesis {
    /// Adds a near view, given the fits by goal, 0 to 1.
    pub fn look(&mut self, fits: &[f32]) {
        self.looks += 1;
        self.mix(fits, self.looks, 1.0);
    }

    fn new(detection: DetectedObject, goals: usize) -> Self {
        let (vis, viewed_from, categories) = (vec![0.0; goals], Vec::new(), Vec::new());
        let missed_from = Vec::new();
        Self { detection, looks: 0, views: 0, wrong_submits: 0, vis, viewed_from, missed_from, categories }
    }

    /// Adds a view of a frame with the fits by goal; a near view counts as a look if its position is new.
    ///
    /// Parts of an object say less about it: views that cut it off have a fraction of the weight.
    fn view(&mut self, fits: &[f32], near: Option<FloorPoint>, is_cut: bool) {
        const CUT_WEIGHT: f32 = 0.25;
        self.views += 1;
        self.mix(fits, self.views, if is_cut { CUT_WEIGHT } else { 1.0 });
        let Some(place) = near else { return };
        if self.viewed_from.iter().all(|from| from.distance_m(place) >= APART_M) {
            self.looks += 1;
            if self.viewed_from.len() >= MOST_VIEWS {
                self.viewed_from.remove(0);
            }
            self.viewed_from.push(place);
        }
    }

    /// Adds a view of `weight` as number `views` to the mean.
    fn mix(&mut self, fits: &[f32], views: u32, weight: f32) {
        /// Views of the mean. Older ones fade, since extents grow from view to view.
        const WINDOW: u32 = 4;
        let share = if views <= 1 { 1.0 } else { weight / views.min(WINDOW) as f32 };
        self.vis.iter_mut().zip(fits).for_each(|(vis, fit)| *vis += share * (fit - *vis));
    }

    /// Returns the positions of the last near views.
    pub fn viewed_from(&self) -> &[FloorPoint] {
        &self.viewed_from
    }

    /// Returns the probability of a category in the tables of priors, 0 to 1.
    pub(crate) fn category(&self, index: usize) -> f32 {
        self.categories.get(index).copied().unwrap_or(0.0)
    }

    /// Returns the visual compatibility with a goal, 0 to 1; 0 before the first view.
    pub fn vis(&self, goal: usize) -> f32 {
        self.vis.get(goal).copied().unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::perception::objects::Palette;

    fn detection(x: f32, size_m: [f32; 2], high_m: f32, rgb: [u8; 3]) -> DetectedObject {
        let (min, max) = (FloorPoint::new(x, 0.0), FloorPoint::new(x + size_m[0], size_m[1]));
        let palette = Palette::of([rgb; 50].into_iter());
        DetectedObject { min, max, low_m: 0.0, high_m, palette, views: 1, ..DetectedObject::default() }
    }

    #[test]
    fn images_of_one_object_give_one_hypothesis() {
        let mut objects = ObjectMemory::new(2);
        let bed = detection(0.0, [2.0, 1.6], 0.6, [40, 60, 190]);
        objects.see(vec![bed.clone(), detection(5.0, [0.5, 0.5], 0.9, [200, 40, 40])]);
        objects.see(vec![bed]);
        assert_eq!(objects.all().len(), 2);
        assert_eq!(objects.all()[0].detection.views, 2);
    }

    #[test]
    fn compatibility_averages_recent_views() {
        let mut objects = ObjectMemory::new(2);
        objects.see(vec![detection(0.0, [1.0, 1.0], 1.0, [0; 3])]);
        let object = objects.iter_mut().next().unwrap();
        assert_eq!((object.vis(0), object.looks), (0.0, 0));
        object.look(&[0.8, 0.0]);
        object.look(&[0.4, 0.2]);
        assert!((object.vis(0) - 0.6).abs() < 1e-6 && (object.vis(1) - 0.1).abs() < 1e-6);
        (0..2).for_each(|_| object.look(&[0.6, 0.1]));
        // Four looks with the mean 0.6; the fifth counts for a quarter.
        object.look(&[1.0, 0.1]);
        assert!((object.vis(0) - 0.7).abs() < 1e-6 && object.looks == 5);
        assert_eq!(object.vis(9), 0.0);
    }

    #[test]
    fn cut_views_weigh_less() {
        let bed = detection(0.0, [2.0, 1.6], 0.6, [40, 60, 190]);
        let vis = |is_cut: bool| {
            let mut objects = ObjectMemory::new(1);
            for (fit, is_cut) in [(0.8, false), (0.0, is_cut)] {
                let seen = DetectedObject { is_cut, ..bed.clone() };
                objects.recognise(&Pose2d::default(), vec![seen], |_, _| fit);
            }
            objects.all()[0].vis(0)
        };
        assert!((vis(false) - 0.4).abs() < 1e-6 && (vis(true) - 0.7).abs() < 1e-6);
    }

    #[test]
    fn looks_belong_to_their_frame() {
        let mut objects = ObjectMemory::new(2);
        let bed = detection(0.0, [2.0, 1.6], 0.6, [40, 60, 190]);
        let chair = detection(5.0, [0.5, 0.5], 0.9, [200, 40, 40]);
        let fit = |detection: &DetectedObject, goal: usize| {
            if detection.high_m < 0.7 && goal == 1 { 0.8 } else { 0.1 }
        };
        let pose = |x: f32| Pose2d::new(&avln_client::Pose::new([x, 0.0, 2.0], 0.0));
        let looks = objects.recognise(&pose(0.0), vec![bed.clone(), chair], fit);
        let seen: Vec<_> = looks.iter().map(|look| (look.object(), look.vis(1), look.vis(7))).collect();
        assert_eq!(seen, [(0, 0.8, 0.0), (1, 0.1, 0.0)]);
        // The chair is too far for a near view, and a second view from the same place is no new look.
        objects.recognise(&pose(0.1), vec![bed.clone()], fit);
        assert_eq!((objects.all()[0].looks, objects.all()[1].looks), (1, 0));
        objects.recognise(&pose(0.3), vec![bed], fit);
        assert_eq!((objects.all()[0].looks, objects.all()[0].viewed_from().len()), (2, 2));
        assert!((objects.all()[0].vis(1) - 0.8).abs() < 1e-6);
        assert!(objects.recognise(&pose(0.6), Vec::new(), fit).is_empty());
    }
}
