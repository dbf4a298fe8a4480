//! Sofas.

use super::parts::*;
use super::*;
use Substance::*;

/// A sofa as wide as wished.
pub(crate) const SOFA: Make = Make {
    category: "sofa",
    noun: "",
    styles: 8,
    substances: &[Fabric, Leather, Velvet, Corduroy, Striped, Checked, Denim, Wicker],
    colors: taste::CLOTH,
    draw: sofa,
};

/// Upholstery style.
pub(super) struct Upholstery {
    arm: f32,
    arm_top: f32,
    feet: f32,
    bevel: f32,
    /// Arms are rolled cylinders.
    rolled: bool,
    /// True for a single back with deep stitching.
    tufted: bool,
    pub(super) shape: &'static str,
}

impl Upholstery {
    pub(super) fn of(k: &mut Draft, _: usize) -> Self {
        let base = Self {
            arm: k.len(0.12, 0.18),
            arm_top: k.len(0.54, 0.66),
            feet: k.len(0.05, 0.09),
            bevel: 0.03,
            rolled: false,
            tufted: false,
            shape: "",
        };
        match k.style {
            0 => Self { bevel: 0.05, ..base },
            1 => Self { bevel: 0.012, arm: 0.1, shape: "square", ..base },
            2 => Self { feet: 0.15, arm: 0.09, shape: "straight", ..base },
            3 => Self { rolled: true, arm: 0.2, arm_top: 0.62, shape: "rounded", ..base },
            6 => Self { rolled: true, tufted: true, arm: 0.2, arm_top: 0.68, shape: "tufted", ..base },
            _ => Self { bevel: 0.08, arm: 0.24, arm_top: 0.58, feet: 0.03, shape: "curved", ..base },
        }
    }
}

/// Base, seat cushions, back and arms.
pub(super) fn upholstered(k: &mut Draft, [w, top, d]: [f32; 3], seats: usize, look: &Upholstery) {
    let p = k.p;
    let (back, front, feet) = (-d / 2.0, d / 2.0, look.feet);
    legs(&mut k.m, [w, d], feet, 0.05, 0.06, k.trim);
    k.m.rim(about(0.0, w - 0.04), [feet, 0.28], [back + 0.02, front - 0.02], p.times(0.95));
    k.m.soft(about(0.0, w), [feet, top], [back, back + 0.2], look.bevel, p);
    let inner = [-w / 2.0 + look.arm, w / 2.0 - look.arm];
    let step = (inner[1] - inner[0]) / seats as f32;
    for seat in 0..seats {
        let x = [inner[0] + step * seat as f32 + 0.005, inner[0] + step * (seat + 1) as f32 - 0.005];
        k.m.soft(x, [0.28, 0.45], [back + 0.18, front], 0.04, p.times(1.03));
        if !look.tufted && seats < 3 {
            k.m.soft(x, [0.45, top - 0.04], [back + 0.18, back + 0.34], 0.05, p.times(1.02));
        }
    }
    if !look.tufted && seats > 2 {
        k.m.soft(inner, [0.45, top - 0.04], [back + 0.18, back + 0.34], 0.05, p.times(1.02));
    }
    if look.tufted {
        let quilt = p.with(Pattern::Quilt);
        k.m.soft(inner, [0.45, top - 0.02], [back + 0.18, back + 0.3], 0.05, quilt);
    }
    let side = [w / 2.0 - look.arm, w / 2.0];
    for x in [side, [-side[1], -side[0]]] {
        let (z, high) = ([back + 0.02, front - 0.01], look.arm_top);
        if look.rolled {
            k.m.block(x, [feet, high - 0.1], z, p);
            let center = (x[0] + x[1]) / 2.0;
            k.m.prism_z(&circle([center, high - 0.1], look.arm / 2.0 + 0.01, 10), z, p);
        } else {
            k.m.soft(x, [feet, high], z, look.bevel, p);
        }
    }
}

fn sofa(k: &mut Draft) -> Words {
    let (w, top, d) = (k.width(1.5, 2.4), k.len(0.76, 0.94), k.len(0.84, 0.96));
    let seats = if w > 1.85 { 3 } else { 2 };
    let look = Upholstery::of(k, seats);
    let shape = match k.style {
        4 => daybed(k, [w, top, d]),
        5 => framed(k, [w, top, d], seats),
        _ => {
            upholstered(k, [w, top, d], seats, &look);
            look.shape
        }
    };
    [size_word(w, 1.65, 2.05, ["small", "large"]), shape]
}

/// A padded bench with a single arm and a low back over one half.
fn daybed(k: &mut Draft, [w, top, d]: [f32; 3]) -> &'static str {
    legs(&mut k.m, [w, d], 0.14, 0.06, 0.04, k.trim);
    k.pad(about(0.0, w), [0.14, 0.3], about(0.0, d));
    k.m.soft(about(0.0, w - 0.02), [0.3, 0.45], about(0.0, d - 0.02), 0.04, k.p.times(1.03));
    k.pad([-w / 2.0, -w / 2.0 + 0.16], [0.3, top], about(0.0, d));
    k.pad([-w / 2.0 + 0.16, w * 0.25], [0.43, top - 0.06], [-d / 2.0, -d / 2.0 + 0.2]);
    "open"
}

/// Loose cushions in a frame of bars.
fn framed(k: &mut Draft, [w, top, d]: [f32; 3], seats: usize) -> &'static str {
    let (frame, back) = (k.trim, -d / 2.0);
    for x in [[-w / 2.0, -w / 2.0 + 0.07], [w / 2.0 - 0.07, w / 2.0]] {
        k.m.block(x, [0.0, 0.6], [back, back + 0.07], frame);
        k.m.block(x, [0.0, 0.6], [d / 2.0 - 0.07, d / 2.0], frame);
        k.m.block(x, [0.56, 0.61], about(0.0, d), frame);
    }
    k.m.block(about(0.0, w - 0.1), [0.2, 0.27], about(0.0, d - 0.1), frame);
    let step = (w - 0.16) / seats as f32;
    for seat in 0..seats {
        let x = about(-w / 2.0 + 0.08 + step * (seat as f32 + 0.5), step - 0.01);
        k.pad(x, [0.27, 0.45], [back + 0.16, d / 2.0 - 0.01]);
        k.pad(x, [0.43, top], [back + 0.02, back + 0.2]);
    }
    "framed"
}
