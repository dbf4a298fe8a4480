//! Conversions between benchmark types and messages. All messages of this crate are built here, from `avln-episode` types and
//! public values of the host.

mod observation;
mod run;
mod sensors;
mod task;

pub(crate) use observation::{ObservationFormat, observation, tensor_specs};
pub(crate) use run::{phase, public_metrics, quota, run, run_end, scope, seconds, server_info};
pub(crate) use sensors::{check_client, sensors};
pub(crate) use task::{digests, mission, task_spec, time_limits};

use avln_episode::{Action, EndReason, FeedbackRule, Order};
use avln_proto::v1;

pub(crate) fn order(order: Order) -> v1::Order {
    match order {
        Order::Ordered => v1::Order::Ordered,
        Order::Unordered => v1::Order::Unordered,
    }
}

pub(crate) fn end_reason(reason: EndReason) -> v1::EndReason {
    match reason {
        EndReason::Stopped => v1::EndReason::Stopped,
        EndReason::FinalSubmit => v1::EndReason::FinalSubmit,
        EndReason::StepLimit => v1::EndReason::StepLimit,
        EndReason::TimeBudget => v1::EndReason::TimeBudget,
        EndReason::Abandoned => v1::EndReason::Abandoned,
        EndReason::Disconnected => v1::EndReason::Disconnected,
        EndReason::ServerFault => v1::EndReason::ServerFault,
    }
}

pub(crate) fn feedback_rule(rule: FeedbackRule) -> v1::FeedbackRule {
    match rule {
        FeedbackRule::None => v1::FeedbackRule::None,
        FeedbackRule::Accepted => v1::FeedbackRule::Accepted,
        FeedbackRule::Verdict => v1::FeedbackRule::Verdict,
    }
}

/// Returns the action for a wire number: index plus one.
pub(crate) fn action(number: i32) -> Option<Action> {
    let index = u32::try_from(number).ok()?.checked_sub(1)?;
    Action::try_from(index).ok()
}

/// Returns an action's wire number.
pub(crate) fn action_number(action: Action) -> i32 {
    action.index() as i32 + 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn actions_are_their_index_plus_one() {
        for (index, known) in Action::ALL.into_iter().enumerate() {
            assert_eq!(action(index as i32 + 1), Some(known));
            assert_eq!(action_number(known), index as i32 + 1);
        }
        assert_eq!(action(v1::Action::Stop as i32), Some(Action::Stop));
        for wrong in [i32::MIN, -1, 0, 6, i32::MAX] {
            assert_eq!(action(wrong), None, "{wrong}");
        }
    }
}
