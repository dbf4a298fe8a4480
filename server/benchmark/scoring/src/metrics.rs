use avln_episode::{Point3, Rules};
use avln_truth::{EpisodeTruth, Record};
use serde::{Deserialize, Serialize};

/// What one episode was worth. Shares and rates lie in [0, 1]; `osr >= isr` and `spl <= sr` always hold.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    /// Goals of the mission.
    pub goals: u32,
    /// Goals that were found.
    pub found: u32,
    /// Success: 1 when every goal was found, else 0.
    pub sr: f64,
    /// Share of the goals that were found.
    pub isr: f64,
    /// Share of the goals whose success region was ever entered, or that were found.
    pub osr: f64,
    /// 1 when `osr` is 1, else 0.
    pub osr_all: f64,
    /// `sr × reference / max(reference, path)` (Anderson et al. 2018).
    pub spl: f64,
    /// `isr × reference / max(reference, path)`.
    pub soft_spl: f64,
    /// `sr × fewest actions / max(fewest actions, actions)` (Chen et al. 2020).
    pub sna: f64,
    /// Actions taken, of all five kinds.
    pub steps: u32,
    /// Length of the walk of the base in space, metres.
    pub path_m: f64,
    /// Length of the reference tour, metres.
    pub reference_m: f64,
    /// Actions in which an obstacle held the body back.
    pub collisions: u32,
    /// Submits and Stops that completed no goal.
    pub wrong_submits: u32,
    /// Those of them at an instance of the right category that is not the target.
    #[serde(default)]
    pub wrong_instance_submits: u32,
    /// For each goal, the number of the step that found it, counted from 1.
    pub steps_to_goal: Vec<Option<u32>>,
    /// For each goal, the walk from the last pose to its success region, metres; `None` when unreachable.
    pub final_distance_m: Vec<Option<f64>>,
}

impl Metrics {
    /// Every number that an episode has one of, with its name in files and URLs.
    pub fn named(&self) -> [(&'static str, f64); 15] {
        [
            ("goals", f64::from(self.goals)),
            ("found", f64::from(self.found)),
            ("sr", self.sr),
            ("isr", self.isr),
            ("osr", self.osr),
            ("osr_all", self.osr_all),
            ("spl", self.spl),
            ("soft_spl", self.soft_spl),
            ("sna", self.sna),
            ("steps", f64::from(self.steps)),
            ("path_m", self.path_m),
            ("reference_m", self.reference_m),
            ("collisions", f64::from(self.collisions)),
            ("wrong_submits", f64::from(self.wrong_submits)),
            ("wrong_instance_submits", f64::from(self.wrong_instance_submits)),
        ]
    }
}

/// Turns the facts of an episode into its metrics. An episode without goals scores 0.
///
/// An episode that ended by [`avln_episode::EndReason::ServerFault`] has metrics too, which must enter no mean.
pub fn score(truth: &EpisodeTruth, record: &Record, rules: &Rules) -> Metrics {
    let goals = truth.targets.len();
    let steps_to_goal = record.found_at(goals);
    let found = steps_to_goal.iter().flatten().count();
    let entered =
        (0..goals).filter(|&goal| steps_to_goal[goal].is_some() || entered_region(record, goal)).count();
    let (sr, isr) = (all(found, goals), share(found, goals));
    let path_m = path_length_m(record);
    let on_path = efficiency(truth.reference_m, path_m);
    let fewest = fewest_actions(truth.reference_m, rules.forward_m, goals);
    Metrics {
        goals: goals as u32,
        found: found as u32,
        sr,
        isr,
        osr: share(entered, goals),
        osr_all: all(entered, goals),
        spl: sr * on_path,
        soft_spl: isr * on_path,
        sna: sr * efficiency(fewest, record.steps.len() as f64),
        steps: record.steps.len() as u32,
        path_m,
        reference_m: truth.reference_m,
        collisions: record.steps.iter().filter(|step| step.collided).count() as u32,
        wrong_submits: record.submits.iter().filter(|submit| submit.completed.is_none()).count() as u32,
        wrong_instance_submits: record.submits.iter().filter(|submit| submit.wrong_instance.is_some()).count()
            as u32,
        steps_to_goal,
        final_distance_m: (0..goals)
            .map(|goal| record.final_distance_m.get(goal).copied().flatten())
            .collect(),
    }
}

fn share(count: usize, goals: usize) -> f64 {
    if goals == 0 { 0.0 } else { count as f64 / goals as f64 }
}

fn all(count: usize, goals: usize) -> f64 {
    if goals > 0 && count == goals { 1.0 } else { 0.0 }
}

fn entered_region(record: &Record, goal: usize) -> bool {
    let bit = u8::try_from(1_u64.checked_shl(goal as u32).unwrap_or(0)).unwrap_or(0);
    let at_start = record.in_region_at_start.get(goal).copied().unwrap_or(false);
    at_start || record.steps.iter().any(|step| step.in_region & bit != 0)
}

/// Sum of the straight lines between one pose of the base and the next, metres, computed in f64.
fn path_length_m(record: &Record) -> f64 {
    let mut at = record.start.position;
    let mut length_m = 0.0;
    for step in &record.steps {
        length_m += distance_m(&at, &step.pose.position);
        at = step.pose.position;
    }
    length_m
}

fn distance_m(a: &Point3<f32>, b: &Point3<f32>) -> f64 {
    let squared = |axis: usize| {
        let difference = f64::from(b[axis]) - f64::from(a[axis]);
        difference * difference
    };
    (squared(0) + squared(1) + squared(2)).sqrt()
}

/// `least / max(least, spent)` in [0, 1]: 1 when nothing was needed and nothing spent, 0 when `least` is no length.
fn efficiency(least: f64, spent: f64) -> f64 {
    if !least.is_finite() || least < 0.0 {
        return 0.0;
    }
    let most = least.max(spent);
    if most > 0.0 { least / most } else { 1.0 }
}

/// A count of actions that no success can undercut: forward steps along the reference tour and one claim a goal.
fn fewest_actions(reference_m: f64, forward_m: f32, goals: usize) -> f64 {
    // The margin keeps a tour of exactly n forward steps at n when its length is a rounded sum.
    (reference_m / f64::from(forward_m) - 1e-6).ceil().max(0.0) + goals as f64
}
