//! Actions, goal orders, end reasons and method types.

use avln_proto::v1;
use std::fmt;
use std::str::FromStr;

/// Agent actions. Every action uses a step of the episode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Action {
    /// Move forward, sliding at walls.
    MoveForward,
    /// Turn left on the spot.
    TurnLeft,
    /// Turn right on the spot.
    TurnRight,
    /// Claim that a target is here.
    Submit,
    /// Claim the last target and end the episode.
    Stop,
}

impl Action {
    /// All actions, in action space order: index 0 is MoveForward, index 4 is Stop.
    pub const ALL: [Self; 5] = [Self::MoveForward, Self::TurnLeft, Self::TurnRight, Self::Submit, Self::Stop];

    pub(crate) fn to_wire(self) -> v1::Action {
        match self {
            Self::MoveForward => v1::Action::MoveForward,
            Self::TurnLeft => v1::Action::TurnLeft,
            Self::TurnRight => v1::Action::TurnRight,
            Self::Submit => v1::Action::Submit,
            Self::Stop => v1::Action::Stop,
        }
    }
}

impl fmt::Display for Action {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self, f)
    }
}

/// Goal order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Order {
    /// Goals count only in mission order.
    Ordered,
    /// Goals count in any order.
    #[default]
    Unordered,
}

/// Error for an unknown goal order.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("order '{0}' does not exist; use ordered or unordered")]
pub struct UnknownOrder(pub String);

impl Order {
    pub(crate) fn to_wire(self) -> v1::Order {
        match self {
            Self::Ordered => v1::Order::Ordered,
            Self::Unordered => v1::Order::Unordered,
        }
    }

    pub(crate) fn from_wire(number: i32) -> Option<Self> {
        match v1::Order::try_from(number) {
            Ok(v1::Order::Ordered) => Some(Self::Ordered),
            Ok(v1::Order::Unordered) => Some(Self::Unordered),
            _ => None,
        }
    }
}

impl FromStr for Order {
    type Err = UnknownOrder;

    fn from_str(word: &str) -> Result<Self, UnknownOrder> {
        match word {
            "ordered" => Ok(Self::Ordered),
            "unordered" => Ok(Self::Unordered),
            other => Err(UnknownOrder(other.to_owned())),
        }
    }
}

impl fmt::Display for Order {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Ordered => "ordered",
            Self::Unordered => "unordered",
        })
    }
}

// A newer server may send numbers that this client does not know, and these must not break a run.
macro_rules! wire_enum {
    ($(#[$meta:meta])* $name:ident { $($(#[$variant_meta:meta])* $variant:ident,)+ }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum $name {
            $($(#[$variant_meta])* $variant,)+
            /// Unknown to this client version.
            Other,
        }

        impl $name {
            pub(crate) fn from_wire(number: i32) -> Self {
                match avln_proto::v1::$name::try_from(number) {
                    $(Ok(avln_proto::v1::$name::$variant) => Self::$variant,)+
                    _ => Self::Other,
                }
            }
        }
    };
}

pub(crate) use wire_enum;

wire_enum! {
    /// Reason for an episode's end.
    #[derive(Hash, PartialOrd, Ord)]
    EndReason {
        /// The agent chose Stop.
        Stopped,
        /// The agent sent a Submit without Submits left, under [`ExtraSubmit::EndsEpisode`](crate::ExtraSubmit::EndsEpisode).
        FinalSubmit,
        /// The step limit was reached.
        StepLimit,
        /// The time budget was used up.
        TimeBudget,
        /// The agent abandoned the episode.
        Abandoned,
        /// The agent disconnected and did not resume in time.
        Disconnected,
        /// The server failed; the episode does not count.
        ServerFault,
    }
}

impl fmt::Display for EndReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Stopped => "stopped",
            Self::FinalSubmit => "final submit",
            Self::StepLimit => "step limit",
            Self::TimeBudget => "time budget",
            Self::Abandoned => "abandoned",
            Self::Disconnected => "disconnected",
            Self::ServerFault => "server fault",
            Self::Other => "another reason",
        })
    }
}

/// A method's type, declared with [`RunOptions::method_type`](crate::RunOptions::method_type).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum MethodType {
    /// Without learnt parts.
    TrainingFree,
    /// Learnt perception, such as a network trained on training houses; the decisions are not learnt.
    LearntPerception,
    /// Foundation models: large detectors, encoders or language models trained on other data.
    FoundationModels,
    /// A policy learnt by imitation of demonstrations.
    Imitation,
    /// A policy learnt by reinforcement learning.
    Rl,
}

/// Error for an unknown method type.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "method type '{0}' does not exist; use training-free, learnt-perception, foundation-models, imitation or rl"
)]
pub struct UnknownMethodType(pub String);

impl MethodType {
    /// All types.
    pub const ALL: [Self; 5] =
        [Self::TrainingFree, Self::LearntPerception, Self::FoundationModels, Self::Imitation, Self::Rl];

    /// Returns the name used on the command line and in data: `learnt-perception`.
    pub fn name(self) -> &'static str {
        match self {
            Self::TrainingFree => "training-free",
            Self::LearntPerception => "learnt-perception",
            Self::FoundationModels => "foundation-models",
            Self::Imitation => "imitation",
            Self::Rl => "rl",
        }
    }

    pub(crate) fn to_wire(self) -> v1::MethodType {
        match self {
            Self::TrainingFree => v1::MethodType::TrainingFree,
            Self::LearntPerception => v1::MethodType::LearntPerception,
            Self::FoundationModels => v1::MethodType::FoundationModels,
            Self::Imitation => v1::MethodType::Imitation,
            Self::Rl => v1::MethodType::Rl,
        }
    }

    pub(crate) fn from_wire(declared: v1::MethodType) -> Option<Self> {
        Self::ALL.into_iter().find(|known| known.to_wire() == declared)
    }
}

impl FromStr for MethodType {
    type Err = UnknownMethodType;

    fn from_str(word: &str) -> Result<Self, UnknownMethodType> {
        let found = Self::ALL.into_iter().find(|known| known.name() == word);
        found.ok_or_else(|| UnknownMethodType(word.to_owned()))
    }
}

impl fmt::Display for MethodType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::LearntPerception => "learnt perception",
            Self::FoundationModels => "foundation models",
            Self::Rl => "RL",
            Self::TrainingFree | Self::Imitation => self.name(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wire_number_is_action_index_plus_one() {
        for (index, action) in Action::ALL.into_iter().enumerate() {
            assert_eq!(action.to_wire() as usize, index + 1);
        }
    }

    #[test]
    fn orders_round_trip_as_text_and_wire() {
        for order in [Order::Ordered, Order::Unordered] {
            assert_eq!(order.to_string().parse(), Ok(order));
            assert_eq!(Order::from_wire(order.to_wire() as i32), Some(order));
        }
        assert_eq!("any".parse::<Order>(), Err(UnknownOrder("any".into())));
        assert_eq!(Order::from_wire(0), None);
    }

    #[test]
    fn newer_end_reason_is_other() {
        assert_eq!(EndReason::from_wire(v1::EndReason::StepLimit as i32), EndReason::StepLimit);
        assert_eq!(EndReason::from_wire(77), EndReason::Other);
    }

    #[test]
    fn names_and_wire_numbers_round_trip() {
        for known in MethodType::ALL {
            assert_eq!(known.name().parse(), Ok(known));
            assert_eq!(MethodType::from_wire(known.to_wire()), Some(known));
        }
        assert_eq!(MethodType::from_wire(v1::MethodType::Unspecified), None);
        let error = "magic".parse::<MethodType>().unwrap_err().to_string();
        for known in MethodType::ALL {
            assert!(error.contains(known.name()), "{error}");
        }
    }
}
