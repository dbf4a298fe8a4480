//! Living rooms, libraries, game rooms, hallways, offices and gyms.

use super::*;

impl Decorator<'_> {
    pub(super) fn living_room(&mut self) {
        if let Some(sofa) = self.sofa_group(2.15) {
            self.television(Wish::Facing(sofa.side.opposite(), sofa.along()));
            for hand in [1.0, -1.0] {
                let table = tables::SIDE_TABLE.any(self.sampler);
                if let Some(table) = self.beside(&table, &sofa, hand) {
                    self.lamp_on(&table, 0.0);
                }
                if self.maybe(0.5) {
                    break;
                }
            }
        }
        if self.maybe(0.55)
            && let Some(hearth) = self.put(&fixtures::FIREPLACE, Wish::Middle, 0.7)
            && hearth.height_m() < 1.35
            && hearth.footprint()[1] < 0.45
        {
            let wish = Wish::Facing(hearth.side, hearth.along());
            self.picture_sized([0.7, 0.55], wish, 1.75);
        }
        for _ in 0..self.count(1, 3) {
            self.armchair(Wish::Anywhere);
        }
        if self.area_m2() > 20.0 && self.maybe(0.8) {
            self.sofa_group(1.7);
        }
        if self.maybe(0.6) {
            self.put(&storage::BOOKCASE, Wish::Corner, 0.6);
        }
    }

    /// Adds a sofa with cushions, a low table and a rug in front.
    fn sofa_group(&mut self, width: f32) -> Option<Spot> {
        let width = width + self.sampler.rng.range(-0.3, 0.25);
        let mut sofa = seats::SOFA.sized(self.sampler, [width, 0.0, 0.0]);
        let mut spot = self.stand(&sofa, Wish::Middle, 1.3);
        if spot.is_none() {
            sofa = seats::SOFA.sized(self.sampler, [1.5, 0.0, 0.0]);
            spot = self.stand(&sofa, Wish::Anywhere, 0.6);
        }
        let spot = spot?;
        let (width, depth) = (sofa.size().x, sofa.size().z);
        let x = width / 2.0 - 0.45;
        let all = [-x, x, -x + 0.42, x - 0.42];
        let count = self.count(2, if width > 1.9 { 4 } else { 2 });
        let back = match sofa.attributes.shape.as_str() {
            "tufted" => 0.31,
            "framed" | "open" => 0.21,
            _ => 0.35,
        };
        self.lean_cushions(&spot, &sofa.attributes.color, &all[..count], [0.455, back - depth / 2.0]);
        let table = tables::COFFEE_TABLE.any(self.sampler);
        let center = spot.before(0.42 + table.size().z / 2.0);
        if let Some(table) = self.stand_at(&table, spot.side, center) {
            self.clutter(&table, 2);
        }
        if self.maybe(0.65) {
            self.lay_rug([2.1, 1.5], spot.side, center);
        }
        Some(spot)
    }

    /// Adds an armchair, often with a cushion.
    pub(super) fn armchair(&mut self, wish: Wish) -> Option<Spot> {
        let chair = seats::ARMCHAIR.any(self.sampler);
        let spot = self.stand(&chair, wish, 0.5)?;
        let deep = !["round", "open"].contains(&chair.attributes.shape.as_str());
        if deep && self.maybe(0.8) {
            let back = if chair.attributes.shape == "tufted" { 0.31 } else { 0.35 };
            self.lean_cushions(&spot, &chair.attributes.color, &[0.0], [0.455, back - chair.size().z / 2.0]);
        }
        Some(spot)
    }

    /// Adds a television on a stand or on the wall, preferably at `wish`.
    pub(super) fn television(&mut self, wish: Wish) {
        let width = self.sampler.rng.range(0.95, 1.25);
        let Some(stand) = self.put_sized(&storage::TV_STAND, [width + 0.3, 0.0, 0.0], wish, 0.6) else {
            let tv = displays::WALL_TV.sized(self.sampler, [width, 0.0, 0.0]);
            if self.hang(&tv, 1.05, wish).is_none() && !matches!(wish, Wish::Anywhere) {
                self.television(Wish::Anywhere);
            }
            return;
        };
        let above = self.maybe(0.4);
        let tv = displays::WALL_TV.sized(self.sampler, [width, 0.0, 0.0]);
        if !above || self.hang(&tv, 0.95, Wish::Facing(stand.side, stand.along())).is_none() {
            let tv = displays::TV.sized(self.sampler, [width, 0.0, 0.0]);
            self.piece_on_top(&tv, &stand, [0.0, -0.2]);
        }
    }

    pub(super) fn library(&mut self) {
        for _ in 0..self.count(2, 4) {
            self.put(&storage::BOOKCASE, Wish::Anywhere, 0.6);
        }
        for _ in 0..self.count(1, 2) {
            if let Some(chair) = self.armchair(Wish::Corner) {
                let table = tables::SIDE_TABLE.any(self.sampler);
                if let Some(table) = self.beside(&table, &chair, 1.0) {
                    self.clutter(&table, 1);
                }
            }
        }
        self.desk();
        self.put(&lights::FLOOR_LAMP, Wish::Corner, 0.0);
    }

    pub(super) fn game_room(&mut self) {
        if let Some(sofa) = self.sofa_group(1.9) {
            self.television(Wish::Facing(sofa.side.opposite(), sofa.along()));
        }
        self.dining_set(4);
        if self.maybe(0.5) {
            self.put(&kitchen::ISLAND, Wish::Anywhere, 0.8);
        }
        self.put(&seats::BAR_STOOL, Wish::Anywhere, 0.0);
        self.put(&storage::SIDEBOARD, Wish::Anywhere, 0.6);
    }

    pub(super) fn hallway(&mut self) {
        if self.maybe(0.45) {
            self.put_sized(&seats::SEATING, [0.0, 0.0, 0.34], Wish::Anywhere, 0.0);
        }
        let coats = self.count(0, 1);
        self.coats(coats);
        let narrow = [0.9, 0.0, 0.28];
        let console = match self.maybe(0.5) {
            true => self.put_sized(&tables::CONSOLE, narrow, Wish::Anywhere, 0.0),
            false => self.put_sized(&storage::SIDEBOARD, narrow, Wish::Anywhere, 0.0),
        };
        if let Some(console) = console {
            self.clutter(&console, 2);
            self.mirror([0.55, 0.8], Wish::Facing(console.side, console.along()));
        }
        let room = self.space.room;
        let side = if room.size()[0] > room.size()[1] { Side::North } else { Side::West };
        self.lay_rug([1.8, 0.7], side, room.center());
    }

    /// Adds curtains at a window, a blind in the upper part, or a radiator below.
    pub(super) fn dress_window(
        &mut self,
        side: Side,
        middle: f32,
        [width, sill, head]: [f32; 3],
        curtained: bool,
    ) {
        if curtained && self.maybe(0.36) {
            let low = if self.maybe(0.5) { 0.06 } else { sill - 0.12 };
            let curtain = openings::CURTAIN.sized(self.sampler, [0.28, head + 0.12 - low, 0.0]);
            for hand in [-1.0, 1.0] {
                self.fix_if_free(&curtain, side, middle + hand * (width / 2.0 + 0.22), low, true);
            }
        } else if self.maybe(0.2) {
            let height = (head - sill) * self.rng.range(0.3, 0.6);
            let blind = openings::BLIND.sized(self.sampler, [width + 0.02, height, 0.0]);
            self.fix_over(&blind, side, middle, head + 0.02 - height);
        }
        if sill > 0.8 && self.maybe(0.3) {
            let radiator = fixtures::RADIATOR.sized(self.sampler, [(width * 0.8).max(0.6), 0.0, 0.0]);
            self.stand(&radiator, Wish::Facing(side, middle), 0.0);
        }
    }

    /// Adds a picture with an approximate size, centre at `eye_m`.
    pub(super) fn picture_sized(
        &mut self,
        [width, height]: [f32; 2],
        wish: Wish,
        eye_m: f32,
    ) -> Option<Spot> {
        let picture = displays::PICTURE.sized(self.sampler, [width, height, 0.0]);
        self.hang(&picture, eye_m - picture.size().y / 2.0, wish)
    }

    pub(super) fn mirror(&mut self, [width, height]: [f32; 2], wish: Wish) {
        let mirror = displays::MIRROR.sized(self.sampler, [width, height, 0.0]);
        self.hang(&mirror, 1.5 - mirror.size().y / 2.0, wish);
    }

    pub(super) fn bin(&mut self) {
        self.put(&decor::BIN, Wish::Corner, 0.0);
    }
}

impl Decorator<'_> {
    pub(super) fn office(&mut self) {
        self.desk();
        if self.area_m2() > 14.0 {
            self.desk();
        }
        for _ in 0..self.count(1, 2) {
            self.put(&storage::BOOKCASE, Wish::Corner, 0.6);
        }
        if self.maybe(0.5) {
            self.put(&storage::TALL_CABINET, Wish::Anywhere, 0.6);
        }
        if self.maybe(0.5) {
            self.armchair(Wish::Corner);
        }
        let board = displays::BOARD.any(self.sampler);
        self.hang(&board, 1.5 - board.size().y / 2.0, Wish::Middle);
        self.bin();
    }

    /// Adds a desk with a monitor, a lamp and a chair.
    pub(super) fn desk(&mut self) {
        let Some(desk) = self.put(&tables::DESK, Wish::Middle, 0.9) else { return };
        let monitor = displays::MONITOR.any(self.sampler);
        self.piece_on_top(&monitor, &desk, [0.0, -0.5]);
        if self.maybe(0.6) {
            self.on_top(&lights::TABLE_LAMP, &desk, [-1.0, -0.6]);
        }
        let kind = if self.maybe(0.75) { &seats::OFFICE_CHAIR } else { &seats::CHAIR };
        let chair = kind.any(self.sampler);
        let distance = chair.size().z / 2.0 + 0.05;
        self.stand_at(&chair, desk.side.opposite(), desk.before(distance));
        self.clutter(&desk, 1);
    }

    pub(super) fn gym(&mut self) {
        let machines = (self.area_m2() / 5.0).clamp(2.0, 4.0) as usize;
        for _ in 0..machines {
            self.put(&sports::MACHINE, Wish::Anywhere, 0.6);
        }
        for _ in 0..self.count(1, 2) {
            self.put(&sports::KIT_PIECE, Wish::Corner, 0.0);
        }
        if self.maybe(0.6) {
            self.put(&seats::SEATING, Wish::Anywhere, 0.4);
        }
        if self.maybe(0.5) {
            let tv = displays::WALL_TV.sized(self.sampler, [0.9, 0.0, 0.0]);
            self.hang(&tv, 1.3, Wish::Middle);
        }
        self.mirror([0.9, 1.4], Wish::Middle);
        self.towels(1);
    }
}
