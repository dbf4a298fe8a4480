use avln_geom::{Point3, Vector3};

/// Where the light on a scene's surfaces comes from.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Lighting {
    /// Surfaces carry it in their textures and vertex colours, as scans do.
    #[default]
    Painted,
    /// Lamps, in a scene whose triangles are counter-clockwise from the side that one sees. Vertex colours are a rough
    /// light for those who do not follow rays; who does leaves them out.
    Lamps(Vec<Lamp>),
}

/// Something that shines: a bulb, or a piece of a window by day.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    /// Its middle, world frame.
    pub position: Point3<f32>,
    /// Where it shines: all around, or as a flat piece that faces along this unit vector, world frame.
    pub facing: Option<Vector3<f32>>,
    /// Its size, metres: what lies within is a part of it and throws no shadow.
    pub radius_m: f32,
    /// Red, green and blue light that falls on a surface which faces it 1 m away; 1 is as much as the indirect light
    /// in the middle of a room.
    pub strength: [f32; 3],
}

impl Lighting {
    /// What is seen where there is no surface, sRGB: the sky of houses with lamps, nothing at all around a scan.
    pub fn backdrop_rgb(&self) -> [u8; 3] {
        match self {
            Self::Painted => [0; 3],
            Self::Lamps(_) => [135, 176, 222],
        }
    }

    /// The lamps; none where surfaces carry their light.
    pub fn lamps(&self) -> &[Lamp] {
        match self {
            Self::Painted => &[],
            Self::Lamps(lamps) => lamps,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::digest::digest;
    use crate::glb;
    use crate::procedural::{HouseOptions, house};

    #[test]
    fn most_rooms_of_a_house_have_a_lamp_and_every_window_lets_light_in() {
        for seed in 0..6 {
            let scene = house("lamps", seed, &HouseOptions::default());
            let lamps = scene.lighting.lamps();
            let lit = |label: &str| {
                scene.regions.iter().filter(|room| room.label == label).all(|room| {
                    lamps.iter().any(|lamp| lamp.facing.is_none() && room.bounds.contains(&lamp.position))
                })
            };
            assert!(
                ["bedroom", "kitchen", "living room", "bathroom"].iter().all(|label| lit(label)),
                "{seed}"
            );
            for window in scene.objects.iter().filter(|object| object.category == "window") {
                let room = &scene.regions[usize::from(window.region.unwrap())].bounds;
                let near = window.bounds.grown(0.1);
                let mut panes = lamps.iter().filter(|lamp| near.contains(&lamp.position)).peekable();
                assert!(panes.peek().is_some(), "seed {seed}: a window without light");
                for pane in panes.filter(|lamp| lamp.facing.is_some()) {
                    let ahead = pane.position + pane.facing.unwrap() * 0.5;
                    assert!(room.contains(&pane.position) && room.contains(&ahead), "seed {seed}: {pane:?}");
                }
            }
        }
    }

    #[test]
    fn lamps_are_a_part_of_the_house_that_its_file_does_not_hold() {
        let scene = house("lamps", 1, &HouseOptions::small());
        let mut moved = scene.clone();
        let Lighting::Lamps(lamps) = &mut moved.lighting else { panic!("a house has lamps") };
        lamps[0].position.y += 0.01;
        assert_ne!(digest(&moved), digest(&scene));
        let back = glb::from_bytes("lamps", "memory", &glb::export(&scene)).unwrap();
        assert_eq!(back.lighting, Lighting::Painted);
        assert_eq!((scene.lighting.backdrop_rgb(), back.lighting.backdrop_rgb()), ([135, 176, 222], [0; 3]));
    }
}
