use crate::{Detector, ForwardAndTurn, Frontier, Snapshot, SoundFollower};
use avln_client::{Agent, Sensors};
use clap::ValueEnum;

/// The agents of this crate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub enum Baseline {
    /// Walks ahead and turns where it is blocked; senses its pose alone.
    ForwardAndTurn,
    /// Goes to the nearest place that it has not seen; knows no goal.
    Frontier,
    /// Goes where it hears something, and submits there; sees nothing.
    SoundFollower,
    /// Explores until it sees something of a goal's category, and submits there; hears nothing.
    Detector,
    /// Remembers few views that show all things, and chooses between them and the unknown; hears nothing.
    Snapshot,
}

impl Baseline {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::ForwardAndTurn, Self::Frontier, Self::SoundFollower, Self::Detector, Self::Snapshot];

    /// Its name on boards and command lines.
    pub fn name(self) -> &'static str {
        match self {
            Self::ForwardAndTurn => "forward-and-turn",
            Self::Frontier => "frontier",
            Self::SoundFollower => "sound-follower",
            Self::Detector => "detector",
            Self::Snapshot => "snapshot",
        }
    }

    /// An agent of this kind that has played nothing yet.
    pub fn agent(self) -> Box<dyn Agent + Send> {
        match self {
            Self::ForwardAndTurn => Box::<ForwardAndTurn>::default(),
            Self::Frontier => Box::<Frontier>::default(),
            Self::SoundFollower => Box::<SoundFollower>::default(),
            Self::Detector => Box::<Detector>::default(),
            Self::Snapshot => Box::<Snapshot>::default(),
        }
    }

    /// What it senses of all that a phase offers, in pictures of `side` pixels.
    pub fn sensors(self, side: u32) -> Sensors {
        let sees = !matches!(self, Self::ForwardAndTurn | Self::SoundFollower);
        let rgb = matches!(self, Self::Detector | Self::Snapshot);
        Sensors { rgb, depth: sees, audio: self.hears(), ..Sensors::square(side) }
    }

    /// Whether it hears.
    pub fn hears(self) -> bool {
        self == Self::SoundFollower
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_the_command_line() {
        for baseline in Baseline::ALL {
            assert_eq!(Baseline::from_str(baseline.name(), false), Ok(baseline));
        }
    }
}
