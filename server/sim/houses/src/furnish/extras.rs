//! Single pieces by room kind, and the smaller parts of non-rectangular rooms.

use super::*;

/// Placement of a single piece.
#[derive(Clone, Copy)]
enum Way {
    /// Back to a wall, free floor in front, metres.
    Stand(Wish, f32),
    /// On a wall, with the centre at this height, metres.
    Hang(f32),
    /// A picture at eye height.
    Picture,
    Towel,
    Coat,
}

use Way::*;
use Wish::*;

/// A furniture kind, weight and placement.
type Extra = (&'static FurnitureKind, f32, Way);

const PICTURE: Extra = (&pictures::PICTURE, 2.60, Picture);
const PLANT: Extra = (&plants::FLOOR_PLANT, 1.00, Stand(Corner, 0.0));
const CLOCK: Extra = (&pictures::CLOCK, 0.35, Hang(1.8));
const LAMP: Extra = (&lights::FLOOR_LAMP, 0.20, Stand(Corner, 0.0));
const SCONCE: Extra = (&lights::SCONCE, 0.12, Hang(1.75));
const MIRROR: Extra = (&pictures::MIRROR, 0.25, Hang(1.5));
const CHAIR: Extra = (&seats::CHAIR, 3.60, Stand(Anywhere, 0.3));
const ARMCHAIR: Extra = (&seats::ARMCHAIR, 0.90, Stand(Anywhere, 0.4));
const STOOL: Extra = (&stools::STOOL, 0.80, Stand(Anywhere, 0.0));
const FOOTSTOOL: Extra = (&stools::FOOTSTOOL, 0.6, Stand(Anywhere, 0.2));
const CABINET: Extra = (&cabinets::SIDEBOARD, 0.7, Stand(Anywhere, 0.5));
const TABLE: Extra = (&tables::SIDE_TABLE, 2.40, Stand(Anywhere, 0.2));
const SHELF: Extra = (&shelves::WALL_SHELF, 1.10, Hang(1.5));
const CONSOLE: Extra = (&tables::CONSOLE, 1.50, Stand(Anywhere, 0.4));
const BOOKCASE: Extra = (&shelves::BOOKCASE, 1.0, Stand(Corner, 0.5));
const BENCH: Extra = (&stools::SEATING, 0.60, Stand(Anywhere, 0.3));
const BASKET: Extra = (&decor::BASKET, 0.35, Stand(Corner, 0.0));
const BIN: Extra = (&decor::BIN, 0.3, Stand(Corner, 0.0));
const STATUE: Extra = (&decor::STATUE, 0.15, Stand(Corner, 0.0));
const TOWEL: Extra = (&textiles::TOWEL, 0.80, Towel);
const COAT: Extra = (&textiles::HANGING, 0.10, Coat);
const RADIATOR: Extra = (&hearths::RADIATOR, 0.25, Stand(Anywhere, 0.0));
const BOARD: Extra = (&pictures::BOARD, 0.5, Hang(1.5));

/// Permitted extras per room kind.
fn choice(kind: RoomKind) -> &'static [Extra] {
    match kind {
        RoomKind::Hallway | RoomKind::Entryway => {
            &[PICTURE, PLANT, CHAIR, BENCH, SCONCE, COAT, MIRROR, RADIATOR, CLOCK]
        }
        RoomKind::LivingRoom | RoomKind::GameRoom => &[
            PICTURE, PLANT, LAMP, ARMCHAIR, CONSOLE, BOOKCASE, BENCH, FOOTSTOOL, CABINET, TABLE, SHELF,
            CLOCK, STATUE, BASKET, CHAIR, SCONCE,
        ],
        RoomKind::Library => &[PICTURE, PLANT, ARMCHAIR, FOOTSTOOL, TABLE, CLOCK, STATUE, CHAIR],
        RoomKind::Kitchen => &[PICTURE, STOOL, CHAIR, BIN, CLOCK, SHELF, PLANT, TOWEL, CABINET],
        RoomKind::DiningRoom => &[PICTURE, PLANT, CHAIR, CABINET, CONSOLE, CLOCK, MIRROR, SCONCE, STATUE],
        RoomKind::Bedroom => &[
            PICTURE, PLANT, CHAIR, MIRROR, BOOKCASE, BENCH, FOOTSTOOL, BASKET, COAT, SHELF, TABLE, LAMP,
            RADIATOR, STOOL,
        ],
        RoomKind::Bathroom => &[TOWEL, PLANT, STOOL, BIN, BASKET, PICTURE, SHELF, RADIATOR, SCONCE, COAT],
        RoomKind::Closet => &[COAT, BASKET, STOOL, MIRROR, SHELF],
        RoomKind::Office => &[PICTURE, PLANT, CHAIR, CLOCK, SHELF, BIN, LAMP, BOARD, CABINET],
        RoomKind::Gym => &[PICTURE, TOWEL, MIRROR, STOOL, CLOCK, PLANT],
        RoomKind::Laundry | RoomKind::Utility | RoomKind::Garage => {
            &[BASKET, STOOL, CHAIR, BIN, SHELF, CABINET, COAT, CLOCK, BOARD, RADIATOR]
        }
        RoomKind::Stairs => &[PICTURE],
    }
}

impl Decorator<'_> {
    /// Adds single pieces by floor area, at least `least`.
    pub(super) fn extras(&mut self, kind: RoomKind, least: f32) {
        let choice = choice(kind);
        let weights: Vec<f32> = choice.iter().map(|(_, weight, _)| *weight).collect();
        let wanted = (least + self.area_m2() * 0.26).min(11.0) as usize;
        for _ in 0..wanted {
            let (furniture, _, way) = choice[self.sampler.weighted(&weights)];
            self.extra(furniture, way);
        }
    }

    fn extra(&mut self, kind: &'static FurnitureKind, way: Way) {
        match way {
            Stand(wish, front_m) => {
                let spot = self.put(kind, wish, front_m);
                let low =
                    spot.filter(|spot| matches!(kind.category, "table" | "cabinet") && spot.height_m() < 1.1);
                if let Some(spot) = low {
                    self.clutter(&spot, 2);
                }
                if let Some(bench) = spot.filter(|_| kind.category == "seating")
                    && self.maybe(0.6)
                {
                    self.on_top(&beds::CUSHION, &bench, [-0.8, 0.0]);
                }
            }
            Hang(middle_m) => {
                let piece = kind.any(self.sampler);
                let base_m = middle_m - piece.size().y / 2.0;
                if piece.size().z > 0.12 {
                    self.hang_somewhere(&piece, base_m);
                } else {
                    self.hang(&piece, base_m, Middle);
                }
            }
            Picture => {
                let count = [1, 1, 1, 2, 2, 3][self.rng.below(6)];
                self.pictures(count);
            }
            Towel => self.towels(1),
            Coat => self.coats(1),
        }
    }
}

impl Decorator<'_> {
    /// Adds a reading corner: an armchair, a lamp or small table, a shelf.
    pub(super) fn corner(&mut self) {
        if let Some(chair) = self.armchair(Wish::Corner) {
            let table = tables::SIDE_TABLE.any(self.sampler);
            match [1.0, -1.0].into_iter().find_map(|hand| self.beside(&table, &chair, hand)) {
                Some(table) => self.lamp_on(&table, 0.0),
                None => drop(self.put(&lights::FLOOR_LAMP, Wish::Corner, 0.0)),
            }
        }
        if self.maybe(0.5) {
            self.put(&shelves::BOOKCASE, Wish::Anywhere, 0.4);
        }
        self.put(&plants::FLOOR_PLANT, Wish::Corner, 0.0);
    }

    pub(super) fn work_corner(&mut self) {
        if self.maybe(0.5) {
            self.desk();
        }
        self.put(&shelves::BOOKCASE, Wish::Anywhere, 0.4);
        self.put(&cabinets::TALL_CABINET, Wish::Anywhere, 0.4);
    }

    /// Adds storage for tableware.
    pub(super) fn pantry(&mut self) {
        let kind = if self.maybe(0.5) { &cabinets::SIDEBOARD } else { &cabinets::TALL_CABINET };
        if let Some(cabinet) = self.put(kind, Wish::Anywhere, 0.5)
            && cabinet.height_m() < 1.1
        {
            self.clutter(&cabinet, 2);
        }
        self.put(&plants::FLOOR_PLANT, Wish::Corner, 0.0);
    }
}
