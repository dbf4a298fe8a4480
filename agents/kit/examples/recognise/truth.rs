//! Where the instances of a house truly are, as far as pictures show them.

use super::frames::Record;
use avln_client::{DepthImage, Pose};
use avln_kit::perception::{Place, Stand, Thing, View};
use avln_perception::extent;
use std::collections::BTreeMap;

/// Instances of fewer pixels in all pictures together are not looked for.
const LEAST_PX: usize = 300;
/// Farther pixels do not count, metres.
const FAR_M: f32 = 6.0;

/// An instance.
pub(crate) struct Instance {
    pub(crate) id: u16,
    pub(crate) category: u8,
    pub(crate) min: Place,
    pub(crate) max: Place,
    pub(crate) heights_m: [f32; 2],
}

/// Places and heights of the pixels of one instance.
#[derive(Default)]
struct Points {
    category: u8,
    axes: [Vec<f32>; 3],
}

/// The instances that pictures show, by their boxes.
pub(crate) fn instances(view: &View, records: &[&Record], building: usize) -> Vec<Instance> {
    let mut points = BTreeMap::<u16, Points>::new();
    for record in records {
        let depth = depth(record, view.width);
        let stand = stand(record);
        for (pixel, &id) in record.instances.iter().enumerate() {
            let category = record.categories[pixel];
            if id == 0 || usize::from(category) < building || category == u8::MAX {
                continue;
            }
            let seen = view.seen(&stand, &depth, pixel % view.width, pixel / view.width);
            if let Some(seen) = seen.filter(|seen| seen.range_m < FAR_M) {
                let known = points.entry(id).or_default();
                known.category = category;
                let [x, z, up] = &mut known.axes;
                x.push(seen.place.x);
                z.push(seen.place.z);
                up.push(seen.height_m);
            }
        }
    }
    points.into_iter().filter_map(|(id, points)| points.instance(id)).collect()
}

pub(crate) fn depth(record: &Record, side_px: usize) -> DepthImage {
    DepthImage { width: side_px as u32, height: side_px as u32, metres: record.depth_m.clone() }
}

pub(crate) fn stand(record: &Record) -> Stand {
    Stand::new(&Pose { position: record.base_m, heading_rad: record.heading_rad })
}

impl Points {
    fn instance(self, id: u16) -> Option<Instance> {
        if self.axes[0].len() < LEAST_PX {
            return None;
        }
        let [x, z, up] = self.axes.map(extent);
        let ([x0, x1], [z0, z1], heights_m) = (x?, z?, up?);
        let (min, max) = (Place::new(x0, z0), Place::new(x1, z1));
        Some(Instance { id, category: self.category, min, max, heights_m })
    }
}

impl Instance {
    /// How much of both boxes is in both, 0 to 1.
    pub(crate) fn overlap(&self, thing: &Thing) -> f32 {
        /// Flat things are made this thick, metres.
        const THICK_M: f32 = 0.1;
        let axes = [
            ([self.min.x, self.max.x], [thing.min.x, thing.max.x]),
            ([self.min.z, self.max.z], [thing.min.z, thing.max.z]),
            (self.heights_m, [thing.low_m, thing.high_m]),
        ];
        let thick = |[low, high]: [f32; 2]| [low - THICK_M, high + THICK_M];
        let (mut both, mut own, mut other) = (1.0, 1.0, 1.0);
        for (a, b) in axes.map(|(a, b)| (thick(a), thick(b))) {
            both *= (a[1].min(b[1]) - a[0].max(b[0])).max(0.0);
            own *= a[1] - a[0];
            other *= b[1] - b[0];
        }
        both / (own + other - both)
    }

    /// The middle of the box on the floor plan.
    pub(crate) fn center(&self) -> Place {
        self.min.toward(self.max, 0.5)
    }
}
