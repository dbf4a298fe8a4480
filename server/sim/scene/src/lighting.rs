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
