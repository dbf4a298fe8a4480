//! Single pieces by room kind, the smaller parts of non-rectangular rooms, objects on top of furniture, and objects on walls and
//! ceilings: windows, front door, pictures, towels, coats, lamps.

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

const PICTURE: Extra = (&displays::PICTURE, 2.60, Picture);
const PLANT: Extra = (&decor::FLOOR_PLANT, 1.00, Stand(Corner, 0.0));
const CLOCK: Extra = (&displays::CLOCK, 0.35, Hang(1.8));
const LAMP: Extra = (&lights::FLOOR_LAMP, 0.20, Stand(Corner, 0.0));
const SCONCE: Extra = (&lights::SCONCE, 0.12, Hang(1.75));
const MIRROR: Extra = (&displays::MIRROR, 0.25, Hang(1.5));
const CHAIR: Extra = (&seats::CHAIR, 3.60, Stand(Anywhere, 0.3));
const ARMCHAIR: Extra = (&seats::ARMCHAIR, 0.90, Stand(Anywhere, 0.4));
const STOOL: Extra = (&seats::STOOL, 0.80, Stand(Anywhere, 0.0));
const FOOTSTOOL: Extra = (&seats::FOOTSTOOL, 0.6, Stand(Anywhere, 0.2));
const CABINET: Extra = (&storage::SIDEBOARD, 0.7, Stand(Anywhere, 0.5));
const TABLE: Extra = (&tables::SIDE_TABLE, 2.40, Stand(Anywhere, 0.2));
const SHELF: Extra = (&storage::WALL_SHELF, 1.10, Hang(1.5));
const CONSOLE: Extra = (&tables::CONSOLE, 1.50, Stand(Anywhere, 0.4));
const BOOKCASE: Extra = (&storage::BOOKCASE, 1.0, Stand(Corner, 0.5));
const BENCH: Extra = (&seats::SEATING, 0.60, Stand(Anywhere, 0.3));
const BASKET: Extra = (&decor::BASKET, 0.35, Stand(Corner, 0.0));
const BIN: Extra = (&decor::BIN, 0.3, Stand(Corner, 0.0));
const STATUE: Extra = (&decor::STATUE, 0.15, Stand(Corner, 0.0));
const TOWEL: Extra = (&textiles::TOWEL, 0.80, Towel);
const COAT: Extra = (&textiles::HANGING, 0.10, Coat);
const RADIATOR: Extra = (&fixtures::RADIATOR, 0.25, Stand(Anywhere, 0.0));
const BOARD: Extra = (&displays::BOARD, 0.5, Hang(1.5));

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
                    self.on_top(&textiles::CUSHION, &bench, [-0.8, 0.0]);
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
            self.put(&storage::BOOKCASE, Wish::Anywhere, 0.4);
        }
        self.put(&decor::FLOOR_PLANT, Wish::Corner, 0.0);
    }

    pub(super) fn work_corner(&mut self) {
        if self.maybe(0.5) {
            self.desk();
        }
        self.put(&storage::BOOKCASE, Wish::Anywhere, 0.4);
        self.put(&storage::TALL_CABINET, Wish::Anywhere, 0.4);
    }

    /// Adds storage for tableware.
    pub(super) fn pantry(&mut self) {
        let kind = if self.maybe(0.5) { &storage::SIDEBOARD } else { &storage::TALL_CABINET };
        if let Some(cabinet) = self.put(kind, Wish::Anywhere, 0.5)
            && cabinet.height_m() < 1.1
        {
            self.clutter(&cabinet, 2);
        }
        self.put(&decor::FLOOR_PLANT, Wish::Corner, 0.0);
    }
}

impl Decorator<'_> {
    /// Places a piece on top of another; `place` is -1 to 1 over width and depth. Returns false without room.
    pub(super) fn on_top(&mut self, kind: &FurnitureKind, spot: &Spot, place: [f32; 2]) -> bool {
        let piece = kind.any(self.sampler);
        self.piece_on_top(&piece, spot, place)
    }

    pub(super) fn piece_on_top(&mut self, piece: &Piece, spot: &Spot, place: [f32; 2]) -> bool {
        const EDGE_M: f32 = 0.03;
        let (own, size) = (piece.model.bounds(), piece.size());
        let [width, depth] = spot.footprint();
        let share = if spot.round { 0.5 } else { 1.0 };
        let play =
            [width - size.x - 2.0 * EDGE_M, depth - size.z - 2.0 * EDGE_M].map(|play| play / 2.0 * share);
        if play[0] < 0.0 || play[1] < -EDGE_M {
            return false;
        }
        let [x, z] = turned(
            spot.side.quarter(),
            [place[0] * play[0] - own.center().x, place[1] * play[1].max(0.0) - own.center().z],
        );
        let [cx, cz] = spot.center();
        let origin = Vector3::new(cx + x, spot.bounds.max.y - own.min.y, cz + z);
        self.add_if_free(&without_base(piece), spot.side, origin)
    }

    /// Adds a piece unless it intersects another on the same top.
    fn add_if_free(&mut self, piece: &Piece, side: Side, origin: Vector3<f32>) -> bool {
        let bounds = piece.model.moved(side.quarter(), origin).bounds();
        // The tolerance allows touching pieces.
        let meets = self.laid.iter().any(|other| other.grown(-0.002).intersects(&bounds));
        if !meets {
            self.laid.push(bounds);
            self.add(piece, side, origin);
        }
        !meets
    }

    /// Adds small objects on a table, chest or cabinet.
    pub(super) fn clutter(&mut self, spot: &Spot, most: usize) {
        const THINGS: [(&FurnitureKind, f32); 7] = [
            (&decor::VASE, 2.0),
            (&decor::BOOKS, 2.0),
            (&decor::SMALL_PLANT, 2.2),
            (&decor::STATUE, 1.0),
            (&lights::TABLE_LAMP, 0.8),
            (&textiles::FOLDED, 0.3),
            (&textiles::TOWEL_PILE, 0.2),
        ];
        let wanted = self.count(0, most);
        for _ in 0..wanted {
            let chosen = self.sampler.weighted(&THINGS.map(|(_, weight)| weight));
            let place = [self.rng.range(-1.0, 1.0), self.rng.range(-0.8, 0.3)];
            self.on_top(THINGS[chosen].0, spot, place);
        }
    }

    pub(super) fn lamp_on(&mut self, table: &Spot, place: f32) {
        self.on_top(&lights::TABLE_LAMP, table, [place, -0.3]);
    }

    /// Adds leaning cushions in the frame of `spot`: lower edge at height `seat_m`, `back_m` behind the
    /// centre.
    pub(super) fn lean_cushions(
        &mut self,
        spot: &Spot,
        unlike: &str,
        at: &[f32],
        [seat_m, back_m]: [f32; 2],
    ) {
        let matching = self.maybe(0.5);
        let mut piece = self.cushion(unlike);
        for &x in at {
            let leaning = Piece { model: piece.model.leaning(), ..piece.clone() };
            let own = leaning.model.bounds();
            let [dx, dz] = turned(spot.side.quarter(), [x - own.center().x, back_m - own.min.z]);
            let origin = Vector3::new(spot.origin.x + dx, seat_m - own.min.y, spot.origin.z + dz);
            self.add_if_free(&leaning, spot.side, origin);
            if !matching {
                piece = self.cushion(unlike);
            }
        }
    }

    /// Draws a cushion with a colour other than `unlike`.
    pub(super) fn cushion(&mut self, unlike: &str) -> Piece {
        let mut piece = textiles::CUSHION.any(self.sampler);
        for _ in 0..4 {
            if piece.attributes.color != unlike {
                break;
            }
            piece = textiles::CUSHION.any(self.sampler);
        }
        piece
    }

    /// Adds a flat piece on a bed or bench, `place` metres from the centre in the other's frame.
    pub(super) fn lay_flat(&mut self, kind: &FurnitureKind, spot: &Spot, place: [f32; 2], height_m: f32) {
        let piece = kind.any(self.sampler);
        let [x, z] = turned(spot.side.quarter(), place);
        let origin = Vector3::new(spot.origin.x + x, height_m, spot.origin.z + z);
        self.add_if_free(&piece, spot.side, origin);
    }
}

/// Removes the underside, which the top hides.
fn without_base(piece: &Piece) -> Piece {
    let base_m = piece.model.bounds().min.y;
    let model = piece.model.without(|face| face.is_underside(base_m + 0.001));
    Piece { model, ..piece.clone() }
}

impl Decorator<'_> {
    /// Adds the house's closed front door.
    pub(super) fn entrance(&mut self) {
        let here = |door: &Window| door.room == self.index && door.is_on(&self.space.room);
        if let Some(place) = self.plan.entrance.filter(here) {
            let door = openings::door(self.sampler);
            self.fix(&door, place.side, (place.along[0] + place.along[1]) / 2.0, 0.0);
            self.space.add_door(place.side, place.along, place.y[1]);
            self.doors += 1;
        }
    }

    /// Adds windows, some with curtains.
    pub(super) fn windows(&mut self, kind: RoomKind) {
        let (plan, part) = (self.plan, self.space.room);
        for side in Side::ALL {
            plan.windows_on(self.index, &part, side).for_each(|window| self.window(kind, window));
        }
    }

    fn window(&mut self, kind: RoomKind, window: &Window) {
        let width = window.along[1] - window.along[0];
        let (middle, [sill, head]) = ((window.along[0] + window.along[1]) / 2.0, window.y);
        let patch = Patch { along: about(middle, width + 0.1), y: [sill - 0.03, head] };
        self.fix(&openings::window(width, head - sill), window.side, middle, sill - 0.03);
        self.space.take_wall(window.side, patch);
        use RoomKind::*;
        let curtained = matches!(kind, LivingRoom | Bedroom | DiningRoom | Office | Library | GameRoom);
        if kind != Stairs {
            self.dress_window(window.side, middle, [width, sill, head], curtained);
        }
    }

    /// Fixes a piece to a free wall area; `take` marks the area as used.
    pub(super) fn fix_if_free(&mut self, piece: &Piece, side: Side, middle: f32, base_m: f32, take: bool) {
        let size = piece.size();
        let patch = Patch { along: about(middle, size.x), y: [base_m, base_m + size.y] };
        if self.space.wall_is_free(side, &patch) {
            self.fix(piece, side, middle, base_m);
            if take {
                self.space.take_wall(side, patch);
            }
        }
    }

    /// Fixes a piece in front of a flat piece on the wall.
    pub(super) fn fix_over(&mut self, piece: &Piece, side: Side, middle: f32, base_m: f32) {
        const FRONT_M: f32 = 0.04;
        let size = piece.size();
        let rect = side.band(&self.space.room, about(middle, size.x), [FRONT_M, FRONT_M + size.z]);
        if self.space.room.holds(&rect) {
            let covered = self.covered.len();
            self.set(piece, side, &rect, base_m);
            self.covered.truncate(covered);
        }
    }

    /// Hangs a shallow piece, lower edge at `base_m`.
    pub(super) fn hang(&mut self, piece: &Piece, base_m: f32, wish: Wish) -> Option<Spot> {
        const MARGIN_M: f32 = 0.07;
        let size = piece.size();
        let places = self.wall_places(size.x + 2.0 * MARGIN_M, wish);
        let (side, middle) = places.into_iter().find_map(|WallPlace { side, start_m, .. }| {
            let along = [start_m, start_m + size.x + 2.0 * MARGIN_M];
            let patch = Patch { along, y: [base_m - MARGIN_M, base_m + size.y + MARGIN_M] };
            self.space.wall_is_free(side, &patch).then_some((side, (along[0] + along[1]) / 2.0))
        })?;
        let y = [base_m, base_m + size.y];
        self.space.take_wall(side, Patch { along: about(middle, size.x), y });
        Some(self.fix(piece, side, middle, base_m))
    }

    /// Hangs a deep piece, which also uses floor if it hangs low.
    pub(super) fn hang_deep(&mut self, piece: &Piece, base_m: f32, side: Side, middle: f32) -> Option<Spot> {
        let size = piece.size();
        let rect = side.band(&self.space.room, about(middle, size.x), [0.0, size.z]);
        let claim = Claim { rect, y: [base_m, base_m + size.y], front: None };
        let patch = Patch { along: about(middle, size.x), y: claim.y };
        if !self.space.room.holds(&rect) || !self.space.wall_is_free(side, &patch) {
            return None;
        }
        self.space.take(&claim);
        Some(self.fix(piece, side, middle, base_m))
    }

    /// Fixes a piece to a wall without checks.
    pub(super) fn fix(&mut self, piece: &Piece, side: Side, middle: f32, base_m: f32) -> Spot {
        let size = piece.size();
        let rect = side.band(&self.space.room, about(middle, size.x), [0.002, size.z + 0.002]);
        // Pieces on a wall do not darken the floor.
        let covered = self.covered.len();
        let spot = self.set(piece, side, &rect, base_m);
        self.covered.truncate(covered);
        spot
    }

    /// Hangs a deep piece at a free wall above free floor.
    pub(super) fn hang_somewhere(&mut self, piece: &Piece, base_m: f32) -> Option<Spot> {
        let size = piece.size();
        let places = self.wall_places(size.x, Wish::Anywhere);
        let place = places.into_iter().find(|&WallPlace { side, start_m, .. }| {
            let claim = self.claim_at_wall(side, [start_m, start_m + size.x], size, 0.0);
            self.space.fits(&Claim { y: [base_m, base_m + size.y], ..claim })
        })?;
        self.hang_deep(piece, base_m, place.side, place.start_m + size.x / 2.0)
    }

    /// Adds equal pictures in a row at eye height.
    pub(super) fn pictures(&mut self, count: usize) {
        let format =
            [[0.45, 0.6], [0.6, 0.45], [0.9, 0.6], [0.5, 0.5], [0.7, 0.95], [1.1, 0.7], [0.35, 0.45]];
        let [width, height] = format[self.rng.below(format.len())];
        let mut wish = Wish::Middle;
        for _ in 0..count {
            if let Some(spot) = self.picture_sized([width, height], wish, 1.5) {
                wish = Wish::Facing(spot.side, spot.along() + width + 0.2);
            }
        }
    }

    pub(super) fn towels(&mut self, count: usize) {
        for _ in 0..count {
            let towel = textiles::TOWEL.any(self.sampler);
            let base = 1.42 - towel.size().y / 2.0;
            self.hang(&towel, base, Wish::Anywhere);
        }
    }

    pub(super) fn coats(&mut self, count: usize) {
        for _ in 0..count {
            let coat = textiles::HANGING.any(self.sampler);
            self.hang_somewhere(&coat, 1.78 - coat.size().y);
        }
    }

    /// Adds pictures and a lamp over the stairs.
    pub(super) fn stairwell(&mut self) {
        if !self.plan.begins_stairs(self.index) {
            let count = self.count(1, 3);
            self.pictures(count);
            self.ceiling_lamps();
        }
    }

    /// Adds ceiling lamps, one per 16 square metres.
    pub(super) fn ceiling_lamps(&mut self) {
        let lamp = lights::PENDANT.any(self.sampler);
        let room = self.space.room;
        let [x, z] = room.center();
        let count = ((self.area_m2() / 16.0) as usize).clamp(1, 3);
        for i in 0..count {
            let share = (i as f32 + 0.5) / count as f32 - 0.5;
            let [dx, dz] = if room.size()[0] > room.size()[1] { [share, 0.0] } else { [0.0, share] };
            let place = Vector3::new(x + dx * room.size()[0], CEILING_M, z + dz * room.size()[1]);
            self.add(&lamp, Side::North, place);
        }
    }
}
