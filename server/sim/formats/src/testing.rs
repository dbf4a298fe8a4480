//! A small scan in all PLY formats and as OBJ, and damage for it.

use avln_geom::Rng;
use std::fmt::Write as _;
use std::path::Path;

/// Quads for a floor (thing 0), 6 x 5 m, a table (thing 1) and a red sofa (thing 2); Z up, counter-clockwise from outside.
pub(crate) fn quads() -> Vec<([[f32; 3]; 4], i32)> {
    let mut quads = vec![([[0.0, 0.0, 0.0], [6.0, 0.0, 0.0], [6.0, 5.0, 0.0], [0.0, 5.0, 0.0]], 0)];
    quads.extend(sides([1.0, 1.0, 0.0], [2.0, 1.5, 0.7]).map(|side| (side, 1)));
    quads.extend(sides([3.0, 3.0, 0.0], [5.0, 4.0, 0.9]).map(|side| (side, 2)));
    quads
}

/// A box's six sides.
fn sides([x0, y0, z0]: [f32; 3], [x1, y1, z1]: [f32; 3]) -> [[[f32; 3]; 4]; 6] {
    [
        [[x0, y0, z1], [x1, y0, z1], [x1, y1, z1], [x0, y1, z1]],
        [[x0, y1, z0], [x1, y1, z0], [x1, y0, z0], [x0, y0, z0]],
        [[x0, y0, z0], [x1, y0, z0], [x1, y0, z1], [x0, y0, z1]],
        [[x1, y1, z0], [x0, y1, z0], [x0, y1, z1], [x1, y1, z1]],
        [[x0, y1, z0], [x0, y0, z0], [x0, y0, z1], [x0, y1, z1]],
        [[x1, y0, z0], [x1, y1, z0], [x1, y1, z1], [x1, y0, z1]],
    ]
}

fn color_of(thing: i32) -> [u8; 3] {
    [[200, 200, 200], [120, 80, 40], [220, 20, 20]][thing as usize]
}

/// The scan as a PLY file in a given format, with colours and `object_id` on faces.
pub(crate) fn ply(format: &str) -> Vec<u8> {
    let quads = quads();
    let mut file = format!(
        "ply\nformat {format} 1.0\ncomment made by hand\nelement vertex {}\nproperty uchar red\nproperty uchar green\n\
         property uchar blue\nproperty float x\nproperty double y\nproperty float z\nelement face {}\n\
         property int object_id\nproperty list uchar int vertex_indices\nend_header\n",
        4 * quads.len(),
        quads.len()
    )
    .into_bytes();
    for (corners, thing) in &quads {
        for [x, y, z] in corners {
            let [r, g, b] = color_of(*thing);
            match format {
                "ascii" => file.extend(format!("{r} {g} {b} {x} {y} {z}\n").bytes()),
                "binary_big_endian" => {
                    file.extend([r, g, b]);
                    file.extend(x.to_be_bytes());
                    file.extend(f64::from(*y).to_be_bytes());
                    file.extend(z.to_be_bytes());
                }
                _ => {
                    file.extend([r, g, b]);
                    file.extend(x.to_le_bytes());
                    file.extend(f64::from(*y).to_le_bytes());
                    file.extend(z.to_le_bytes());
                }
            }
        }
    }
    for (index, (_, thing)) in quads.iter().enumerate() {
        let corners: [i32; 4] = std::array::from_fn(|corner| (4 * index + corner) as i32);
        match format {
            "ascii" => {
                let [a, b, c, d] = corners;
                file.extend(format!("{thing} 4 {a} {b} {c} {d}\n").bytes());
            }
            "binary_big_endian" => {
                file.extend(thing.to_be_bytes());
                file.push(4);
                corners.iter().for_each(|corner| file.extend(corner.to_be_bytes()));
            }
            _ => {
                file.extend(thing.to_le_bytes());
                file.push(4);
                corners.iter().for_each(|corner| file.extend(corner.to_le_bytes()));
            }
        }
    }
    file
}

/// The scan as an OBJ file, Z up, one object per thing.
pub(crate) fn obj() -> String {
    let names = ["floor", "table_1", "sofa_1"];
    let mut text = "# made by hand\nmtllib scan.mtl\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n".to_owned();
    let mut last = -1;
    for (corners, thing) in quads() {
        if thing != last {
            let _ = writeln!(text, "o {}\nusemtl {}", names[thing as usize], names[thing as usize]);
            last = thing;
        }
        corners.iter().for_each(|[x, y, z]| {
            let _ = writeln!(text, "v {x} {y} {z}");
        });
        text.push_str("f -4/1 -3/2 -2/3 -1/4\n");
    }
    text
}

/// Writes `content` as `name` into `folder`, making folders on the way.
pub(crate) fn write(folder: &Path, name: &str, content: impl AsRef<[u8]>) {
    let path = folder.join(name);
    std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder is made");
    std::fs::write(path, content).expect("a file is written");
}

/// Calls `try_it` with `rounds` damaged copies: bytes are flipped, replaced by parser traps, moved or cut off.
pub(crate) fn damaged(file: &[u8], seed: u64, rounds: usize, mut try_it: impl FnMut(&[u8])) {
    const TRAPS: [&[u8]; 12] = [
        b"-1",
        b"nan",
        b"inf",
        b"1e39",
        b"4294967295",
        b"99999999999999999999",
        b"\n",
        b" ",
        b"\0\0\0\0",
        b"\xff\xff\xff\xff",
        b"\xff\xff\xff\x7f",
        b"/",
    ];
    let mut rng = Rng::new(seed);
    for _ in 0..rounds {
        let mut bytes = file.to_vec();
        for _ in 0..=rng.below(3) {
            let at = rng.below(bytes.len().max(1)).min(bytes.len());
            match rng.below(5) {
                0 => bytes.truncate(at),
                1 if at < bytes.len() => bytes[at] ^= 1 << rng.below(8),
                2 => {
                    let trap = TRAPS[rng.below(TRAPS.len())];
                    let end = (at + trap.len()).min(bytes.len());
                    bytes.splice(at..end, trap.iter().copied());
                }
                3 => {
                    let trap = TRAPS[rng.below(TRAPS.len())];
                    bytes.splice(at..at, trap.iter().copied());
                }
                _ => {
                    let end = (at + rng.below(40)).min(bytes.len());
                    bytes.drain(at..end);
                }
            }
        }
        try_it(&bytes);
    }
}
