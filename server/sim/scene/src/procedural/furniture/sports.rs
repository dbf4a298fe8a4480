//! Gym equipment.

use super::*;

const KIT: &[&str] = &["black", "grey", "red", "blue", "yellow", "green", "purple", "orange"];

/// A treadmill; one walks towards -z.
pub(in crate::procedural) fn treadmill(taste: &mut Taste) -> Piece {
    let tint = taste.tint("gym_equipment", &["black", "grey", "white"]);
    let paint = Paint::metal(tint);
    let mut m = Model::new();
    m.block(about(0.0, 0.5), [0.08, 0.15], about(0.0, 1.5), Paint::plain("rubber", [40, 40, 44]));
    m.pair([0.25, 0.36], [0.0, 0.18], about(0.0, 1.55), paint);
    m.soft(about(0.0, 0.7), [0.0, 0.28], [-0.8, -0.5], 0.04, paint);
    for side in [-1.0, 1.0] {
        m.rod(Point3::new(side * 0.33, 0.2, -0.62), Point3::new(side * 0.33, 1.2, -0.72), 0.03, paint);
        m.rod(
            Point3::new(side * 0.33, 1.0, -0.7),
            Point3::new(side * 0.33, 0.98, -0.3),
            0.022,
            Paint::DARK_METAL,
        );
    }
    m.soft(about(0.0, 0.72), [1.12, 1.34], [-0.8, -0.68], 0.03, paint);
    m.block(about(0.0, 0.4), [1.16, 1.3], [-0.68, -0.675], Paint::SCREEN);
    Piece::new("gym_equipment", m, said(tint, "metal", "large", ""))
}

/// An exercise bike that faces -z.
pub(in crate::procedural) fn exercise_bike(taste: &mut Taste) -> Piece {
    let tint = taste.tint("gym_equipment", KIT);
    let paint = Paint::metal(tint);
    let mut m = Model::new();
    m.block(about(0.0, 0.5), [0.0, 0.06], [-0.5, -0.42], paint);
    m.block(about(0.0, 0.5), [0.0, 0.06], [0.42, 0.5], paint);
    m.block(about(0.0, 0.06), [0.02, 0.1], about(0.0, 0.9), paint);
    wheel(&mut m, -0.25, 0.36, 0.27, paint);
    m.soft(about(0.0, 0.14), [0.1, 0.5], [-0.1, 0.2], 0.03, paint);
    let at = |y: f32, z: f32| Point3::new(0.0, y, z);
    m.rod(at(0.4, 0.1), at(0.86, 0.24), 0.035, paint);
    m.rod(at(0.4, -0.05), at(1.1, -0.3), 0.035, paint);
    m.soft(about(0.0, 0.2), [0.86, 0.93], [0.12, 0.38], 0.03, Paint::plain("leather", [38, 38, 42]));
    m.rod(Point3::new(-0.25, 1.1, -0.28), Point3::new(0.25, 1.1, -0.28), 0.025, Paint::DARK_METAL);
    m.block(about(0.0, 0.2), [1.12, 1.24], [-0.34, -0.3], Paint::SCREEN);
    m.rod(Point3::new(-0.18, 0.2, 0.05), Point3::new(0.18, 0.42, 0.05), 0.02, Paint::STEEL);
    Piece::new("gym_equipment", m, said(tint, "metal", "", ""))
}

/// A flywheel across x at (y, z).
fn wheel(m: &mut Model, z: f32, y: f32, radius: f32, paint: Paint) {
    let mut disc = Model::new();
    disc.lathe([0.0, 0.0], &[[radius, -0.04], [radius, 0.04]], 16, paint);
    for corner in &mut disc.corners {
        let (p, n) = (corner.position, corner.normal);
        corner.position = Point3::new(p.y, y - p.x, z + p.z);
        corner.normal = Vector3::new(n.y, -n.x, n.z);
    }
    m.add(&disc, 0, Vector3::zeros());
}

/// A bench with a barbell on its stand.
pub(in crate::procedural) fn weight_bench(taste: &mut Taste) -> Piece {
    let tint = taste.tint("gym_equipment", KIT);
    let pad = Paint::leather(tint);
    let mut m = Model::new();
    m.soft(about(0.0, 0.32), [0.36, 0.48], about(0.1, 1.2), 0.04, pad);
    m.soft(about(0.0, 0.5), [0.02, 0.36], about(0.3, 0.5), 0.03, pad.times(0.9));
    m.pair([0.36, 0.42], [0.0, 0.98], [-0.5, -0.44], Paint::STEEL);
    m.block(about(0.0, 0.84), [0.0, 0.06], [-0.52, -0.42], Paint::STEEL);
    m.block(about(0.0, 0.1), [0.1, 0.36], about(-0.3, 0.1), Paint::STEEL);
    m.rod(Point3::new(-0.6, 1.0, -0.47), Point3::new(0.6, 1.0, -0.47), 0.016, Paint::CHROME);
    for side in [-0.55_f32, 0.55] {
        let mut plate = Model::new();
        wheel(&mut plate, -0.47, 1.0, 0.18, pad.times(0.95));
        m.add(&plate, 0, Vector3::new(side, 0.0, 0.0));
    }
    Piece::new("gym_equipment", m, said(tint, "leather", "", ""))
}

/// A rack with pairs of dumbbells.
pub(in crate::procedural) fn dumbbell_rack(taste: &mut Taste) -> Piece {
    let tint = taste.tint("gym_equipment", KIT);
    let paint = Paint::metal(tint);
    let mut m = Model::new();
    m.pair([0.42, 0.48], [0.0, 0.8], about(0.0, 0.36), paint);
    for y in [0.25, 0.62] {
        m.block(about(0.0, 0.84), [y, y + 0.03], about(0.0, 0.36), paint);
        for i in 0..4 {
            let x = (i as f32 - 1.5) * 0.19;
            let base = y + 0.09;
            m.rod(Point3::new(x, base, -0.12), Point3::new(x, base, 0.12), 0.015, Paint::CHROME);
            for z in [-0.13, 0.09] {
                m.soft(about(x, 0.12), [base - 0.06, base + 0.06], [z, z + 0.06], 0.02, paint);
            }
        }
    }
    Piece::new("gym_equipment", m, said(tint, "metal", "small", ""))
}
