//! Objects on top of furniture.

use super::*;

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
            (&plants::SMALL_PLANT, 2.2),
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
        let mut piece = beds::CUSHION.any(self.sampler);
        for _ in 0..4 {
            if piece.attributes.color != unlike {
                break;
            }
            piece = beds::CUSHION.any(self.sampler);
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
