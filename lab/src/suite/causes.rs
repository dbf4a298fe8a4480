use avln_episode::{Action, Order, Rules};
use avln_truth::{EpisodeTruth, Record, SubmitFacts};
use serde::{Deserialize, Serialize};

/// Why a Submit completed nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// At the target of a later goal of an ordered mission.
    WrongOrder,
    /// At a target that had been found.
    FoundBefore,
    /// At another instance of a wanted category.
    WrongInstance,
    /// Within twice the success radius of a wanted target, or nearer without sight of it.
    TooFar,
    /// Nowhere near anything that is wanted.
    WrongCategory,
}

impl Cause {
    /// All of them, in the order of tables.
    pub const ALL: [Self; 5] =
        [Self::WrongInstance, Self::WrongCategory, Self::TooFar, Self::WrongOrder, Self::FoundBefore];

    /// Words for tables.
    pub fn words(self) -> &'static str {
        match self {
            Self::WrongOrder => "wrong order",
            Self::FoundBefore => "found before",
            Self::WrongInstance => "wrong instance",
            Self::TooFar => "too far",
            Self::WrongCategory => "wrong category",
        }
    }
}

/// The causes of an episode's Submits that completed nothing, one by one. A Stop gives up what is left and is none of them.
pub(super) fn causes(truth: &EpisodeTruth, record: &Record, rules: &Rules) -> Vec<Cause> {
    let mut found = vec![false; truth.targets.len()];
    let mut causes = Vec::new();
    for submit in &record.submits {
        match submit.completed.or(submit.skipped) {
            Some(goal) => found.get_mut(usize::from(goal)).into_iter().for_each(|found| *found = true),
            None => causes.extend(cause(truth, record, rules, submit, &found)),
        }
    }
    causes
}

fn cause(
    truth: &EpisodeTruth,
    record: &Record,
    rules: &Rules,
    submit: &SubmitFacts,
    found: &[bool],
) -> Option<Cause> {
    let step = record.steps.get((submit.step as usize).checked_sub(1)?)?;
    if step.action != Action::Submit {
        return None;
    }
    let is_in = |goal: &usize| step.in_region >> goal & 1 == 1;
    let open: Vec<usize> = (0..found.len()).filter(|&goal| !found[goal]).collect();
    let claimable = if truth.order == Order::Ordered { &open[..open.len().min(1)] } else { &open[..] };
    let mut eye = step.pose.position;
    eye.y += rules.camera_height_m;
    let is_close =
        |goal: &usize| truth.targets[*goal].bounds.distance_m(&eye) <= 2.0 * rules.success_radius_m;
    Some(if open.iter().any(is_in) {
        Cause::WrongOrder
    } else if (0..found.len()).filter(|&goal| found[goal]).any(|goal| is_in(&goal)) {
        Cause::FoundBefore
    } else if submit.wrong_instance.is_some() {
        Cause::WrongInstance
    } else if claimable.iter().any(is_close) {
        Cause::TooFar
    } else {
        Cause::WrongCategory
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_episode::{EndReason, Modality, Pose};
    use avln_geom::{Aabb, Point3};
    use avln_truth::{StepFacts, Target};

    fn target(x: f32) -> Target {
        let corner = |x| Point3::new(x, 0.5, 0.0);
        Target {
            instance: 1,
            category: "chair".to_owned(),
            modality: Modality::Category,
            bounds: Aabb::new(corner(x), corner(x + 1.0)),
            source: corner(x),
            floor_y_m: 0.0,
            region: vec![],
            viewpoints: vec![],
            start_distance_m: 1.0,
        }
    }

    /// Causes of Submits at places x, in regions by bits, each with what it completed and whether at a wrong instance.
    fn of(submits: &[(f32, u8, Option<u8>, bool)]) -> Vec<Cause> {
        let truth = EpisodeTruth {
            episode: "e".to_owned(),
            scene: "s".to_owned(),
            seed: 1,
            start: Pose::new(Point3::origin(), 0.0),
            order: Order::Ordered,
            targets: vec![target(0.0), target(20.0)],
            reference_m: 1.0,
            reference_path: vec![],
        };
        let step = |&(x, in_region, _, _): &(f32, u8, Option<u8>, bool)| StepFacts {
            action: Action::Submit,
            pose: Pose::new(Point3::new(x, 0.0, 0.0), 0.0),
            collided: false,
            in_region,
            sounding: None,
            state_hash: 0,
        };
        let facts = |(step, &(_, _, completed, wrong)): (u32, &(f32, u8, Option<u8>, bool))| SubmitFacts {
            step,
            completed,
            skipped: None,
            wrong_instance: wrong.then_some(0),
        };
        let record = Record {
            rules: "r".to_owned(),
            start: Pose::new(Point3::origin(), 0.0),
            steps: submits.iter().map(step).collect(),
            submits: (1..).zip(submits).map(facts).collect(),
            in_region_at_start: vec![false; 2],
            final_distance_m: vec![None; 2],
            end: EndReason::FinalSubmit,
        };
        causes(&truth, &record, &Rules::paper())
    }

    #[test]
    fn each_cause_is_told_from_facts() {
        assert_eq!(of(&[(20.0, 2, None, false)]), [Cause::WrongOrder]);
        assert_eq!(of(&[(0.0, 1, Some(0), false), (0.0, 1, None, false)]), [Cause::FoundBefore]);
        assert_eq!(of(&[(9.0, 0, None, true)]), [Cause::WrongInstance]);
        assert_eq!(
            of(&[(-3.5, 0, None, false), (9.0, 0, None, false)]),
            [Cause::TooFar, Cause::WrongCategory]
        );
    }
}
