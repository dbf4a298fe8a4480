use super::super::shot::{Hfov, Pose, Size, eye};
use avln_geom::angle;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

const FIELDS: [&str; 5] = ["position", "rotation", "hfov_deg", "width", "height"];

/// One picture that is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Wanted {
    pub(super) pose: Pose,
    pub(super) size: Size,
    pub(super) hfov: Hfov,
}

impl Wanted {
    /// The picture that an entry of the file of poses asks for.
    ///
    /// # Errors
    /// A sentence that names the field.
    pub(super) fn from_json(entry: &Value) -> Result<Self, String> {
        let fields = entry.as_object().ok_or("it is no object")?;
        if let Some(name) = fields.keys().find(|name| !FIELDS.contains(&name.as_str())) {
            return Err(format!("the field '{name}' is unknown; there are {}", FIELDS.join(", ")));
        }
        let position = required(fields, "position")?;
        let rotation = required(fields, "rotation")?;
        let world_from_camera = angle::rotation(rotation).ok_or_else(|| {
            format!("rotation {rotation:?} has no direction; write x, y, z, w of a unit quaternion")
        })?;
        let [width, height] = [optional(fields, "width", 256)?, optional(fields, "height", 256)?];
        Ok(Self {
            pose: Pose { eye: eye(position)?, world_from_camera },
            size: Size::new(width, height)?,
            hfov: Hfov::new(optional(fields, "hfov_deg", 90.0)?)?,
        })
    }
}

fn required<T: DeserializeOwned>(fields: &Map<String, Value>, name: &str) -> Result<T, String> {
    let value = fields.get(name).ok_or_else(|| format!("the field '{name}' is missing"))?;
    T::deserialize(value).map_err(|error| format!("{name}: {error}"))
}

fn optional<T: DeserializeOwned>(fields: &Map<String, Value>, name: &str, otherwise: T) -> Result<T, String> {
    if fields.contains_key(name) { required(fields, name) } else { Ok(otherwise) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_geom::Vector3;
    use serde_json::json;

    #[test]
    fn a_pose_needs_a_place_and_a_rotation_and_the_rest_has_defaults() {
        let entry = json!({"position": [1, 2.5, -3], "rotation": [0, 2, 0, 2]});
        let wanted = Wanted::from_json(&entry).expect("a pose");
        assert_eq!((wanted.size.width, wanted.size.height, wanted.hfov.degrees), (256, 256, 90.0));
        let spoken: Pose = "1,2.5,-3,90".parse().expect("a pose");
        assert_eq!(wanted.pose.eye, spoken.eye);
        let ahead = |pose: &Pose| pose.world_from_camera * -Vector3::z();
        assert!((ahead(&wanted.pose) - ahead(&spoken)).norm() < 1e-6);
        let entry =
            json!({"position": [0, 0, 0], "rotation": [0, 0, 0, 1], "hfov_deg": 60, "width": 7, "height": 9});
        let wanted = Wanted::from_json(&entry).expect("a pose");
        assert_eq!((wanted.size.width, wanted.size.height, wanted.hfov.degrees), (7, 9, 60.0));
    }

    #[test]
    fn what_is_wrong_with_a_pose_is_named() {
        let good = json!({"position": [0, 0, 0], "rotation": [0, 0, 0, 1]});
        assert!(Wanted::from_json(&good).is_ok());
        for (field, value) in [
            ("position", json!([0, 0])),
            ("position", json!([0, 0, "x"])),
            ("position", json!([0, 0, 1e7])),
            ("rotation", json!([0, 0, 0, 0])),
            ("rotation", json!([0, 0, 0])),
            ("hfov_deg", json!("wide")),
            ("hfov", json!(90)),
            ("width", json!(0)),
            ("width", json!(-1)),
            ("height", json!(4097)),
            ("height", json!(1.5)),
            ("pitch", json!(0)),
        ] {
            let mut bad = good.clone();
            bad[field] = value.clone();
            let refused = Wanted::from_json(&bad).expect_err("a bad field");
            assert!(refused.contains(field), "{field} {value}: {refused}");
        }
        for (missing, entry) in
            [("position", json!({"rotation": [0, 0, 0, 1]})), ("rotation", json!({"position": [0, 0, 0]}))]
        {
            assert!(Wanted::from_json(&entry).is_err_and(|refused| refused.contains(missing)));
        }
        for hfov_deg in [0.0, 180.0, -5.0] {
            let mut bad = good.clone();
            bad["hfov_deg"] = json!(hfov_deg);
            assert!(Wanted::from_json(&bad).is_err_and(|refused| refused.contains("hfov")), "{hfov_deg}");
        }
        assert!(Wanted::from_json(&json!([1, 2])).is_err());
    }
}
