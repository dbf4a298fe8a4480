//! Gym equipment.

use super::*;

const KIT: &str = "black grey red blue yellow green purple orange white teal pink brown";

const BODIES: &[Substance] = &[Metal, Plastic, Rubber, Leather, Wood, Fabric];

/// A treadmill, bike, rower, cross trainer, weight bench, rack or tower.
pub(crate) const MACHINE: FurnitureKind =
    FurnitureKind::new("gym_equipment", "", 8, machine).made_of(BODIES, KIT);

/// A ball, mat, kettlebell, step or bag.
pub(crate) const KIT_PIECE: FurnitureKind =
    FurnitureKind::new("gym_equipment", "", 5, kit).made_of(&[Rubber, Plastic, Leather, Fabric, Metal], KIT);

fn machine(k: &mut Draft) -> Words {
    let nouns = "treadmill|exercise bike|weight bench|dumbbell rack|\
                 rowing machine|cross trainer|weight machine|stair climber";
    k.noun = k.by_style(nouns);
    let draw = [treadmill, bike, weight_bench, dumbbell_rack, rower, cross_trainer, tower, steps][k.style];
    draw(k);
    [
        k.by_style("large||large|low|large|large|tall|large"),
        k.by_style("long|wheeled|long|shelved|long|tall|upright|stepped"),
    ]
}

/// Used towards -z.
fn treadmill(k: &mut Draft) {
    k.model.block(about(0.0, 0.5), [0.08, 0.15], about(0.0, 1.5), Paint::RUBBER);
    k.model.pair([0.25, 0.36], [0.0, 0.18], about(0.0, 1.55), k.paint);
    k.model.soft(about(0.0, 0.72), [0.0, 0.3], [-0.8, -0.45], 0.04, k.paint);
    for side in [-1.0, 1.0] {
        k.model.rod(point(side * 0.33, 0.2, -0.62), point(side * 0.33, 1.2, -0.72), 0.035, k.paint);
        let grip = [point(side * 0.33, 1.0, -0.7), point(side * 0.33, 0.98, -0.3)];
        k.model.rod(grip[0], grip[1], 0.022, Paint::DARK_METAL);
    }
    k.model.soft(about(0.0, 0.72), [1.12, 1.36], [-0.8, -0.68], 0.03, k.paint);
    k.model.lid(about(0.0, 0.4), [1.18, 1.3], [-0.68, -0.675], Paint::SCREEN);
}

/// Faces -z.
fn bike(k: &mut Draft) {
    for z in [[-0.5, -0.42], [0.42, 0.5]] {
        k.model.block(about(0.0, 0.5), [0.0, 0.06], z, k.paint);
    }
    k.model.block(about(0.0, 0.06), [0.02, 0.1], about(0.0, 0.9), k.paint);
    k.wheel([-0.05, 0.05], [0.36, -0.25], 0.27, k.paint);
    k.model.soft(about(0.0, 0.14), [0.1, 0.5], [-0.1, 0.2], 0.03, k.paint);
    let at = |y: f32, z: f32| point(0.0, y, z);
    k.model.rod(at(0.4, 0.1), at(0.86, 0.24), 0.035, k.paint);
    k.model.rod(at(0.4, -0.05), at(1.1, -0.3), 0.035, k.paint);
    k.model.soft(about(0.0, 0.2), [0.86, 0.93], [0.12, 0.38], 0.03, Paint::DARK_METAL);
    k.model.rod(point(-0.25, 1.1, -0.28), point(0.25, 1.1, -0.28), 0.025, Paint::DARK_METAL);
    k.model.block(about(0.0, 0.2), [1.12, 1.24], [-0.34, -0.3], Paint::SCREEN);
}

fn weight_bench(k: &mut Draft) {
    k.model.soft(about(0.0, 0.32), [0.36, 0.48], about(0.1, 1.2), 0.04, k.paint);
    k.model.soft(about(0.0, 0.3), [0.02, 0.36], about(0.4, 0.3), 0.03, k.paint);
    k.model.pair([0.36, 0.42], [0.0, 0.98], [-0.5, -0.44], Paint::STEEL);
    k.model.block(about(0.0, 0.84), [0.0, 0.06], [-0.52, -0.42], Paint::STEEL);
    k.model.block(about(0.0, 0.1), [0.1, 0.36], about(-0.3, 0.1), k.paint);
    k.model.rod(point(-0.6, 1.0, -0.47), point(0.6, 1.0, -0.47), 0.016, Paint::CHROME);
    for side in [-0.55_f32, 0.55] {
        k.wheel(about(side, 0.07), [1.0, -0.47], 0.19, k.paint);
    }
}

fn dumbbell_rack(k: &mut Draft) {
    k.model.pair([0.42, 0.48], [0.0, 0.8], about(0.0, 0.36), k.paint);
    for y in [0.25, 0.62] {
        k.model.block(about(0.0, 0.84), [y, y + 0.03], about(0.0, 0.36), k.paint);
        for i in 0..3 {
            let x = (i as f32 - 1.0) * 0.26;
            let base = y + 0.09;
            k.model.rod(point(x, base, -0.12), point(x, base, 0.12), 0.015, Paint::CHROME);
            for z in [-0.13, 0.09] {
                k.model.prism_z(&circle([x, base], 0.06, 6), [z, z + 0.06], k.paint.times(0.92));
            }
        }
    }
}

/// Faces -z.
fn rower(k: &mut Draft) {
    k.model.block(about(0.0, 0.1), [0.22, 0.32], [-0.7, 1.0], k.paint);
    k.model.block(about(0.0, 0.5), [0.0, 0.24], [0.88, 0.96], k.paint);
    k.model.block(about(0.0, 0.5), [0.0, 0.1], [-0.72, -0.62], k.paint);
    k.wheel(about(0.0, 0.14), [0.36, -0.66], 0.26, k.paint);
    k.model.soft(about(0.0, 0.32), [0.34, 0.42], about(0.35, 0.28), 0.03, Paint::DARK_METAL);
    k.model.rod(point(-0.22, 0.5, -0.4), point(0.22, 0.5, -0.4), 0.02, Paint::DARK_METAL);
    k.model.pair([0.08, 0.2], [0.18, 0.4], [-0.42, -0.36], k.paint);
}

/// Faces -z.
fn cross_trainer(k: &mut Draft) {
    k.model.block(about(0.0, 0.5), [0.0, 0.06], [0.62, 0.7], k.paint);
    k.model.block(about(0.0, 0.1), [0.0, 0.08], about(0.0, 1.3), k.paint);
    k.wheel(about(0.0, 0.2), [0.36, -0.45], 0.3, k.paint);
    k.model.block(about(0.0, 0.12), [0.3, 1.3], [-0.56, -0.46], k.paint);
    k.model.soft(about(0.0, 0.3), [1.3, 1.5], [-0.58, -0.5], 0.02, k.paint);
    for side in [-1.0, 1.0] {
        let at = |y: f32, z: f32| point(side * 0.24, y, z);
        k.model.rod(at(0.25, -0.3), at(1.55, -0.2), 0.025, k.paint);
        k.model.rod(at(0.3, -0.4), at(0.22, 0.5), 0.03, k.paint);
        k.model.block(about(side * 0.24, 0.14), [0.24, 0.28], about(0.3, 0.34), Paint::RUBBER);
    }
}

/// A tower with a seat and a weight stack.
fn tower(k: &mut Draft) {
    k.model.pair([0.4, 0.47], [0.0, 2.0], [-0.5, -0.43], k.paint);
    k.model.block(about(0.0, 0.94), [1.94, 2.0], [-0.5, -0.43], k.paint);
    k.model.block(about(0.0, 0.94), [0.0, 0.07], [-0.5, -0.3], k.paint);
    k.model.soft(about(0.0, 0.3), [0.2, 1.0], [-0.5, -0.34], 0.02, Paint::DARK_METAL);
    k.model.block(about(0.0, 0.08), [0.0, 0.4], [0.3, 0.38], k.paint);
    k.model.block(about(0.0, 0.1), [0.0, 0.06], [-0.3, 0.5], k.paint);
    k.model.soft(about(0.0, 0.36), [0.4, 0.5], [0.05, 0.5], 0.03, k.paint);
    k.model.soft(about(0.0, 0.32), [0.5, 1.0], [-0.05, 0.04], 0.03, k.paint);
    k.model.rod(point(-0.45, 1.7, -0.2), point(0.45, 1.7, -0.2), 0.02, Paint::CHROME);
    k.model.rod(point(0.0, 1.96, -0.46), point(0.0, 1.7, -0.2), 0.012, Paint::CHROME);
}

fn steps(k: &mut Draft) {
    for i in 0..4 {
        let z = 0.5 - 0.28 * i as f32;
        k.model.soft(about(0.0, 0.56), [0.0, 0.2 * (i + 1) as f32], [z - 0.28, z], 0.012, k.paint);
    }
    for side in [-1.0, 1.0] {
        let at = |y: f32, z: f32| point(side * 0.32, y, z);
        k.model.rod(at(0.0, -0.5), at(1.5, -0.6), 0.03, k.paint);
        k.model.rod(at(0.8, 0.4), at(1.45, -0.6), 0.025, Paint::DARK_METAL);
        k.model.rod(at(0.0, 0.4), at(0.85, 0.4), 0.03, k.paint);
    }
    k.model.block(about(0.0, 0.6), [1.35, 1.55], [-0.64, -0.58], Paint::SCREEN);
}

fn kit(k: &mut Draft) -> Words {
    k.noun = k.by_style("exercise ball|exercise mat|kettlebell|step platform|punching bag");
    let mut size = k.by_style("|small|small|low|tall");
    match k.style {
        0 => {
            let r = k.len(0.26, 0.36);
            k.turned(&[[0.35, 0.0], [0.8, 0.2], [1.0, 0.5], [1.0, 1.0], [0.8, 1.6], [0.35, 1.95]], r, r, 16);
            size = size_word(r, 0.29, 0.33, ["small", "large"]);
        }
        1 => {
            k.model.prism_x(&circle([0.0, 0.07], 0.07, 12), about(0.0, 0.62), k.paint);
            k.model.lid(about(0.0, 0.05), [0.0, 0.141], [0.06, 0.072], k.paint.times(0.8));
        }
        2 => {
            k.turned(&[[0.5, 0.0], [0.95, 0.25], [1.0, 0.5], [0.7, 0.9], [0.3, 1.0]], 0.11, 0.2, 12);
            let at = |x: f32, y: f32| point(x, y, 0.0);
            k.model.rod(at(-0.06, 0.17), at(-0.06, 0.28), 0.016, k.paint);
            k.model.rod(at(0.06, 0.17), at(0.06, 0.28), 0.016, k.paint);
            k.model.rod(at(-0.07, 0.28), at(0.07, 0.28), 0.016, k.paint);
        }
        3 => {
            k.model.soft(about(0.0, 0.8), [0.08, 0.18], about(0.0, 0.34), 0.02, k.paint);
            k.model.pair([0.26, 0.38], [0.0, 0.08], about(0.0, 0.3), k.paint.times(0.9));
        }
        _ => {
            let foot = [[0.26, 0.0], [0.26, 0.08], [0.05, 0.2], [0.05, 0.6]];
            k.model.lathe([0.0, 0.0], &foot, 12, Paint::DARK_METAL);
            k.model.lathe([0.0, 0.0], &[[0.15, 0.6], [0.19, 0.66], [0.19, 1.6], [0.12, 1.72]], 14, k.paint);
        }
    }
    [size, k.by_style("round|rolled|round|rectangular|cylindrical")]
}
