//! Windows and closed doors, as panels on a wall.

use super::parts::*;
use super::*;
use Substance::*;
use avln_scene::Lamp;

const DOOR: Make = Make {
    category: "door",
    noun: "",
    styles: 4,
    substances: &[Wood, Wood, Metal, Plastic, Glass],
    colors: &[
        "brown", "red", "green", "blue", "black", "white", "grey", "teal", "yellow", "orange", "purple",
        "pink",
    ],
    draw: panelled_door,
};

/// A closed door.
pub(crate) fn door(taste: &mut Taste) -> Piece {
    DOOR.any(taste)
}

/// A window; lower edge at y = 0, back at z = 0.
pub(crate) fn window(width: f32, height: f32) -> Piece {
    let frame = Paint::plain("wood", [240, 238, 232]);
    let pane = Paint::plain("glass", [176, 208, 232]).with(Pattern::Sheen);
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
    m.lamps = daylight([width, height]);
    let size = size_word(width, 0.8, 1.4, ["small", "wide"]).to_owned();
    let (material, shape) = ("glass".to_owned(), "rectangular".to_owned());
    Piece::new("window", m, Attributes { material, size, shape, ..Attributes::default() })
}

/// The light that comes in through a window: lamps side by side just inside.
fn daylight([width, height]: [f32; 2]) -> Vec<Lamp> {
    const WIDEST_M: f32 = 0.8;
    const STRENGTH_PER_M2: f32 = 2.2;
    const SKYLIGHT: [f32; 3] = [0.96, 0.98, 1.0];
    let count = (width / WIDEST_M).ceil().max(1.0);
    let piece = width / count;
    let lamp = |index: usize| Lamp {
        position: Point3::new((index as f32 + 0.5) * piece - width / 2.0, height / 2.0, 0.1),
        facing: Some(Vector3::z()),
        radius_m: 0.25,
        strength: SKYLIGHT.map(|channel| channel * STRENGTH_PER_M2 * piece * height),
    };
    (0..count as usize).map(lamp).collect()
}

fn panelled_door(k: &mut Draft) -> Words {
    let p = k.p;
    let frame = p.times(0.9);
    k.m.pair([0.46, 0.52], [0.0, 2.1], [0.0, 0.05], frame);
    k.m.block(about(0.0, 0.92), [2.04, 2.1], [0.0, 0.05], frame);
    k.m.block(about(0.0, 0.92), [0.0, 2.04], [0.0, 0.03], p);
    let z = [0.03, 0.038];
    match k.style {
        0 => {
            for y in [[0.2, 0.9], [1.1, 1.85]] {
                for x in [-0.2, 0.2] {
                    k.m.lid(about(x, 0.28), y, z, p.times(0.9));
                }
            }
        }
        1 => k.m.lid(about(0.0, 0.5), [1.2, 1.8], z, Paint::PANE),
        2 => {
            for i in 0..5 {
                k.m.lid(about(0.0, 0.7), about(0.35 + 0.34 * i as f32, 0.22), z, p.times(0.92));
            }
        }
        _ => k.m.prism_z(&arch(0.6, 0.2, 1.8), z, p.times(0.92)),
    }
    k.m.rod(Point3::new(0.38, 1.0, 0.03), Point3::new(0.38, 1.0, 0.09), 0.015, Paint::CHROME);
    k.m.rod(Point3::new(0.39, 1.0, 0.085), Point3::new(0.28, 1.0, 0.085), 0.012, Paint::CHROME);
    ["", ["panelled", "glazed", "panelled", "arched"][k.style]]
}
