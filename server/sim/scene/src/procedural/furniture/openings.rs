//! Windows and closed doors, as panels on a wall.

use super::*;

/// A window; its lower edge is on y = 0, its back on z = 0.
pub(in crate::procedural) fn window(width: f32, height: f32) -> Piece {
    let frame = Paint::plain("wood", [240, 238, 232]);
    let pane = Paint::plain("glass", [176, 208, 232]);
    let (bar, half) = (0.06, width / 2.0);
    let mut m = Model::new();
    m.block(about(0.0, width), [0.0, bar], [0.0, 0.035], frame);
    m.block(about(0.0, width), [height - bar, height], [0.0, 0.035], frame);
    m.pair([half - bar, half], [bar, height - bar], [0.0, 0.035], frame);
    m.block(about(0.0, bar * 0.7), [bar, height - bar], [0.0, 0.03], frame);
    let p = |x: f32, y: f32| Point3::new(x, y, 0.012);
    let (x, y) = (half - bar, [bar, height - bar]);
    m.quad([p(-x, y[0]), p(x, y[0]), p(x, y[1]), p(-x, y[1])], pane);
    m.block(about(0.0, width + 0.08), [-0.03, 0.0], [0.0, 0.08], frame);
    let words =
        said(Tint::plain("white"), "glass", size_word(width, 0.8, 1.4, ["small", "wide"]), "rectangular");
    Piece::new("window", m, crate::Attributes { color: String::new(), ..words })
}

/// A closed door.
pub(in crate::procedural) fn door(taste: &mut Taste) -> Piece {
    let tint = taste.tint("door", &["brown", "red", "green", "blue", "black", "white"]);
    let paint = Paint::wood(tint);
    let frame = Paint::plain("wood", [232, 228, 218]);
    let mut m = Model::new();
    m.pair([0.46, 0.52], [0.0, 2.1], [0.0, 0.05], frame);
    m.block(about(0.0, 0.92), [2.04, 2.1], [0.0, 0.05], frame);
    m.block(about(0.0, 0.92), [0.0, 2.04], [0.0, 0.03], paint);
    for y in [[0.2, 0.9], [1.1, 1.85]] {
        for x in [-0.2, 0.2] {
            m.block(about(x, 0.28), y, [0.03, 0.038], paint.times(0.86));
        }
    }
    m.rod(Point3::new(0.38, 1.0, 0.03), Point3::new(0.38, 1.0, 0.09), 0.015, Paint::CHROME);
    m.rod(Point3::new(0.39, 1.0, 0.085), Point3::new(0.28, 1.0, 0.085), 0.012, Paint::CHROME);
    Piece::new("door", m, said(tint, "wooden", "tall", "rectangular"))
}
