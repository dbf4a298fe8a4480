//! Additions for training in process. No server uses them.

use super::Referee;
use avln_episode::Action;
use avln_world::InstanceId;

impl Referee {
    /// Adds Submits to those of the rules. For training only: scores of such episodes are not comparable.
    #[must_use]
    pub fn with_added_submits(self, added_submits: u32) -> Self {
        Self { added_submits, ..self }
    }

    /// Stores the instances in images, for training.
    #[must_use]
    pub fn with_instances(self) -> Self {
        Self { instances: Some(Vec::new()), ..self }
    }

    /// Returns the instances in the last image, row-major; `None` without [`Self::with_instances`], empty without an image.
    /// Hidden from agents.
    pub fn instances(&self) -> Option<&[InstanceId]> {
        self.instances.as_deref()
    }

    /// Returns the goal that a Submit or Stop would complete now. Hidden from agents.
    pub fn completes(&self, action: Action) -> Option<usize> {
        match action {
            Action::Submit if self.is_ignored() => None,
            Action::Submit | Action::Stop => self.matching_goal(action),
            _ => None,
        }
    }
}
