//! The floor plan: which rooms there are, where they lie and how one walks between them.

mod layout;
mod openings;

use super::rect::Rect;
use avln_geom::Rng;

/// Thickness of every wall, metres.
pub(super) const WALL_M: f32 = 0.12;

/// Height of every ceiling, metres.
pub(super) const CEILING_M: f32 = 2.6;

/// What a room is used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum RoomKind {
    Hallway,
    LivingRoom,
    Kitchen,
    DiningRoom,
    Bedroom,
    Bathroom,
    Office,
    Gym,
}

impl RoomKind {
    pub(super) fn label(self) -> &'static str {
        match self {
            Self::Hallway => "hallway",
            Self::LivingRoom => "living_room",
            Self::Kitchen => "kitchen",
            Self::DiningRoom => "dining_room",
            Self::Bedroom => "bedroom",
            Self::Bathroom => "bathroom",
            Self::Office => "office",
            Self::Gym => "gym",
        }
    }
}

/// A room; `cell` reaches to the middle of its walls.
#[derive(Clone, Copy, Debug)]
pub(super) struct Room {
    pub(super) kind: RoomKind,
    pub(super) cell: Rect,
}

impl Room {
    /// The floor between the walls.
    pub(super) fn interior(&self) -> Rect {
        self.cell.inset(WALL_M / 2.0)
    }
}

/// A hole in the wall between two rooms, from the floor up.
#[derive(Clone, Copy, Debug)]
pub(super) struct Opening {
    /// Indices into [`Plan::rooms`].
    pub(super) rooms: [usize; 2],
    /// Whether the wall runs along x.
    pub(super) along_x: bool,
    /// The middle of the wall on the axis across it.
    pub(super) line_m: f32,
    /// The hole on the axis along the wall.
    pub(super) along: [f32; 2],
    /// Height of the lintel's lower edge.
    pub(super) height_m: f32,
}

/// Rooms and the openings between them.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    pub(super) rooms: Vec<Room>,
    pub(super) openings: Vec<Opening>,
}

impl Plan {
    /// A plan with `count` rooms (at least 1), the middle of the house near the origin.
    pub(super) fn draw(rng: &mut Rng, count: usize) -> Self {
        let kinds = programme(&mut rng.fork("programme"), count.max(1));
        let rooms = layout::lay_out(&mut rng.fork("layout"), &kinds);
        let openings = openings::connect(&mut rng.fork("openings"), &rooms);
        Self { rooms, openings }
    }
}

/// The uses of `count` rooms. Every house of four rooms or more has a hallway and the four basic rooms.
fn programme(rng: &mut Rng, count: usize) -> Vec<RoomKind> {
    use RoomKind::*;
    let mut kinds = match count {
        1..=4 => vec![LivingRoom, Bedroom, Bathroom, Kitchen],
        _ => vec![Hallway, LivingRoom, Kitchen, Bedroom, Bathroom],
    };
    kinds.truncate(count);
    while kinds.len() < count {
        let mut extra = [DiningRoom, Office, Bedroom, Gym, Bathroom];
        rng.shuffle(&mut extra);
        kinds.extend(extra.iter().take(count - kinds.len()));
    }
    kinds
}
