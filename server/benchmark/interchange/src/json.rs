//! JSON values with their paths, for errors; gzip.

use crate::{ForeignEpisode, InterchangeError, scene_name};
use avln_geom::{Aabb, Point3, Pose, angle};
use flate2::{Compression, GzBuilder, read::MultiGzDecoder};
use serde_json::{Map, Value};
use std::{
    collections::BTreeSet,
    io::{Read, Write},
};

/// Most bytes per file after decompression.
const MAX_BYTES: u64 = 1 << 30;
const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];
/// Most list entries; published data sets have fewer per file.
const MAX_ENTRIES: usize = 2_000_000;
/// Largest deviation from unit length in a quaternion.
const QUATERNION_SLACK: f64 = 0.01;

/// Parses JSON, gzip or plain.
pub(crate) fn unpack(file: &str, bytes: &[u8]) -> Result<Value, InterchangeError> {
    unpack_within(file, bytes, MAX_BYTES)
}

fn unpack_within(file: &str, bytes: &[u8], limit: u64) -> Result<Value, InterchangeError> {
    let malformed = |place: &str, cause: String| InterchangeError::malformed(file, place, &cause);
    let mut plain = Vec::new();
    let text = if bytes.starts_with(&GZIP_MAGIC) {
        // A byte more than the limit: a small file can expand without end.
        let mut reader = MultiGzDecoder::new(bytes).take(limit + 1);
        let read = reader.read_to_end(&mut plain);
        read.map_err(|error| malformed("the gzip stream", format!("{error}; copy the file again")))?;
        &plain[..]
    } else {
        bytes
    };
    if text.len() as u64 > limit {
        return Err(malformed("the end", format!("more than {limit} bytes; split the file by scene")));
    }
    serde_json::from_slice(text).map_err(|error| {
        let place = format!("line {}, column {}", error.line(), error.column());
        malformed(&place, format!("invalid JSON: {error}"))
    })
}

pub(crate) fn pack(bytes: &[u8]) -> Result<Vec<u8>, std::io::Error> {
    // Without a time stamp: the same bytes give the same file.
    let mut writer = GzBuilder::new().mtime(0).write(Vec::new(), Compression::default());
    writer.write_all(bytes)?;
    writer.finish()
}

/// JSON value with the path, for errors.
#[derive(Clone, Debug)]
pub(crate) struct Cursor<'a> {
    file: &'a str,
    path: String,
    value: &'a Value,
}

impl<'a> Cursor<'a> {
    pub(crate) fn root(file: &'a str, value: &'a Value) -> Self {
        Self { file, path: String::new(), value }
    }

    pub(crate) fn error(&self, cause: impl Into<String>) -> InterchangeError {
        let place = if self.path.is_empty() { "the top" } else { &self.path };
        InterchangeError::malformed(self.file, place, &cause.into())
    }

    fn unexpected(&self, expected: &str) -> InterchangeError {
        self.error(format!("expected {expected}, found {}", kind(self.value)))
    }

    fn child(&self, name: &str, value: &'a Value) -> Self {
        let dot = if self.path.is_empty() || name.starts_with('[') { "" } else { "." };
        Self { file: self.file, path: format!("{}{dot}{name}", self.path), value }
    }

    pub(crate) fn find(&self, key: &str) -> Option<Self> {
        let value = self.value.get(key).filter(|value| !value.is_null())?;
        Some(self.child(key, value))
    }

    pub(crate) fn get(&self, key: &str) -> Result<Self, InterchangeError> {
        self.find(key).ok_or_else(|| self.error(format!("`{key}` is missing")))
    }

    pub(crate) fn is_object(&self) -> bool {
        self.value.is_object()
    }

    pub(crate) fn is_list(&self) -> bool {
        self.value.is_array()
    }

    pub(crate) fn list(&self) -> Result<Vec<Self>, InterchangeError> {
        let entries = self.value.as_array().ok_or_else(|| self.unexpected("a list"))?;
        if entries.len() > MAX_ENTRIES {
            return Err(self.error(format!("{} entries, the limit is {MAX_ENTRIES}", entries.len())));
        }
        let child = |(index, value)| self.child(&format!("[{index}]"), value);
        Ok(entries.iter().enumerate().map(child).collect())
    }

    pub(crate) fn entries(&self) -> Result<Vec<(&'a str, Self)>, InterchangeError> {
        let entries: &Map<String, Value> =
            self.value.as_object().ok_or_else(|| self.unexpected("an object"))?;
        Ok(entries.iter().map(|(key, value)| (key.as_str(), self.child(key, value))).collect())
    }

    pub(crate) fn text(&self) -> Result<&'a str, InterchangeError> {
        self.value.as_str().ok_or_else(|| self.unexpected("a string"))
    }

    pub(crate) fn whole(&self) -> Result<i64, InterchangeError> {
        let parsed = self.value.as_str().and_then(|text| text.trim().parse().ok());
        self.value.as_i64().or(parsed).ok_or_else(|| self.unexpected("an integer"))
    }

    pub(crate) fn id(&self) -> Result<String, InterchangeError> {
        match self.value {
            Value::String(text) if !text.is_empty() => Ok(text.clone()),
            Value::Number(number) => Ok(number.to_string()),
            _ => Err(self.unexpected("an id")),
        }
    }

    /// Returns a number that is finite as an `f32`.
    pub(crate) fn number(&self) -> Result<f64, InterchangeError> {
        let number = self.value.as_f64().ok_or_else(|| self.unexpected("a number"))?;
        if (number as f32).is_finite() {
            Ok(number)
        } else {
            Err(self.error(format!("{number} is not finite")))
        }
    }

    fn numbers<const N: usize>(&self) -> Result<[f64; N], InterchangeError> {
        let list = self.list()?;
        if list.len() != N {
            return Err(self.error(format!("expected {N} numbers, found {}", list.len())));
        }
        let mut numbers = [0.0; N];
        for (number, entry) in numbers.iter_mut().zip(&list) {
            *number = entry.number()?;
        }
        Ok(numbers)
    }

    /// Returns a point `[x, y, z]`, metres, Y up.
    pub(crate) fn point(&self) -> Result<Point3<f32>, InterchangeError> {
        let [x, y, z] = self.numbers()?;
        Ok(Point3::new(x as f32, y as f32, z as f32))
    }

    /// Returns the direction for a quaternion `[x, y, z, w]`.
    pub(crate) fn rotation(&self) -> Result<Rotation, InterchangeError> {
        let [x, y, z, w] = self.numbers()?;
        let length = x.mul_add(x, y.mul_add(y, z.mul_add(z, w * w)));
        if (length.sqrt() - 1.0).abs() > QUATERNION_SLACK {
            return Err(self.error(format!("quaternion of length {:.3}, expected 1", length.sqrt())));
        }
        // The rotated -Z axis.
        let forward = [-2.0 * (x * z + w * y), -2.0 * (y * z - w * x), -(1.0 - 2.0 * (x * x + y * y))];
        let [right, up, back] = forward.map(|value| value as f32);
        let level = (right * right + back * back).sqrt();
        Ok(Rotation { heading_rad: angle::atan2(-right, -back), pitch_rad: angle::atan2(up, level) })
    }

    pub(crate) fn pose(&self) -> Result<Pose, InterchangeError> {
        let rotation =
            self.find("rotation").map(|rotation| rotation.rotation()).transpose()?.unwrap_or_default();
        Ok(Pose::new(self.get("position")?.point()?, rotation.heading_rad))
    }

    pub(crate) fn bounds(&self, low: &str, high: &str) -> Result<Option<Aabb>, InterchangeError> {
        let (Some(low), Some(high)) = (self.find(low), self.find(high)) else { return Ok(None) };
        Ok(Some(Aabb::new(low.point()?, high.point()?)))
    }

    /// Returns the episodes; none for an index. Ids must be unique per scene.
    pub(crate) fn episodes(&self) -> Result<Vec<Self>, InterchangeError> {
        let episodes = self.get("episodes")?.list()?;
        let mut ids = BTreeSet::new();
        for episode in &episodes {
            let id = episode.get("episode_id")?.id()?;
            let scene = episode.get("scene_id")?.text()?;
            if !ids.insert((scene, id.clone())) {
                return Err(episode.error(format!("episode_id {id} occurs twice in {scene}")));
            }
        }
        Ok(episodes)
    }

    /// Returns an episode without goals.
    pub(crate) fn episode(&self) -> Result<ForeignEpisode, InterchangeError> {
        let scene_path = self.get("scene_id")?.text()?.to_owned();
        let rotation = self.get("start_rotation")?.rotation()?;
        Ok(ForeignEpisode {
            id: self.get("episode_id")?.id()?,
            scene: scene_name(&scene_path),
            scene_path,
            start: Pose::new(self.get("start_position")?.point()?, rotation.heading_rad),
            goals: Vec::new(),
            stated_m: [None; 2],
        })
    }

    /// Returns viewpoints: points, objects with `agent_state`, or poses.
    pub(crate) fn viewpoints(&self) -> Result<Vec<Pose>, InterchangeError> {
        let list = self.find("view_points").map(|list| list.list()).transpose()?.unwrap_or_default();
        list.iter().map(Self::viewpoint).collect()
    }

    fn viewpoint(&self) -> Result<Pose, InterchangeError> {
        if self.is_list() {
            return Ok(Pose::new(self.point()?, 0.0));
        }
        match self.find("agent_state") {
            Some(state) => state.pose(),
            None => self.pose(),
        }
    }

    /// Returns the horizontal field of view in radians; `default_deg` if missing.
    pub(crate) fn hfov_rad(&self, default_deg: f64) -> Result<f32, InterchangeError> {
        let hfov_deg = self.find("hfov").map(|hfov| hfov.number()).transpose()?.unwrap_or(default_deg);
        if !(1.0..=179.0).contains(&hfov_deg) {
            return Err(self.error(format!("hfov {hfov_deg}, expected 1 to 179 degrees")));
        }
        Ok(hfov_deg.to_radians() as f32)
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Rotation {
    /// As in [`Pose`].
    pub(crate) heading_rad: f32,
    /// Radians; positive is up.
    pub(crate) pitch_rad: f32,
}

fn kind(value: &Value) -> String {
    match value {
        Value::Null => "null".to_owned(),
        Value::Bool(value) => format!("{value}"),
        Value::Number(number) => format!("the number {number}"),
        Value::String(text) => format!("the string {:?}", text.chars().take(40).collect::<String>()),
        Value::Array(list) => format!("a list of {}", list.len()),
        Value::Object(_) => "an object".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;
    use std::f32::consts::FRAC_PI_2;

    #[test]
    fn errors_name_file_place_and_cause() {
        let value = json!({"episodes": [{"start": [1.0, "two", 3.0]}], "big": [1e300, 0, 0]});
        let root = Cursor::root("val.json", &value);
        let start = root.get("episodes").unwrap().list().unwrap()[0].get("start").unwrap();
        let message = start.point().unwrap_err().to_string();
        assert!(message.contains("val.json") && message.contains("episodes[0].start[1]"), "{message}");
        assert!(message.contains("expected a number, found the string \"two\""), "{message}");
        let message = root.get("big").unwrap().point().unwrap_err().to_string();
        assert!(message.contains("big[0]") && message.contains("finite"), "{message}");
        let message = root.get("nothing").unwrap_err().to_string();
        assert!(message.contains("the top") && message.contains("`nothing` is missing"), "{message}");
    }

    #[test]
    fn quaternions_are_x_y_z_w() {
        let rotation = |value: Value| Cursor::root("f", &value).rotation().map_err(|error| error.to_string());
        assert_eq!(rotation(json!([0, 0, 0, 1])).unwrap(), Rotation::default());
        let half = std::f64::consts::FRAC_1_SQRT_2;
        // A quarter turn about +Y is a left turn; a quarter turn about +X looks up.
        let left = rotation(json!([0, half, 0, half])).unwrap();
        assert!((left.heading_rad - FRAC_PI_2).abs() < 1e-5 && left.pitch_rad.abs() < 1e-5, "{left:?}");
        let up = rotation(json!([half, 0, 0, half])).unwrap();
        assert!((up.pitch_rad - FRAC_PI_2).abs() < 1e-3, "{up:?}");
        assert!(rotation(json!([0, 0, 0, 2])).unwrap_err().contains("length 2"));
        assert!(rotation(json!([0, 0, 1])).unwrap_err().contains("expected 4 numbers"));
    }

    #[test]
    fn ids_and_integers_accept_strings_and_numbers() {
        let value = json!({"a": 7, "b": "13", "c": []});
        let root = Cursor::root("f", &value);
        assert_eq!(root.get("a").unwrap().id().unwrap(), "7");
        assert_eq!(root.get("b").unwrap().whole().unwrap(), 13);
        assert!(root.get("c").unwrap().id().is_err() && root.get("c").unwrap().whole().is_err());
    }

    #[test]
    fn gzip_and_plain_files_are_read() {
        let packed = pack(br#"{"episodes": []}"#).unwrap();
        assert_eq!(pack(br#"{"episodes": []}"#).unwrap(), packed);
        assert_eq!(unpack("a", &packed).unwrap(), unpack("b", br#"{"episodes": []}"#).unwrap());
    }

    #[test]
    fn truncated_and_large_files_are_rejected() {
        let packed = pack(&[b'['; 4000]).unwrap();
        let message = |bytes: &[u8]| unpack("val.json.gz", bytes).unwrap_err().to_string();
        assert!(message(&packed[..packed.len() / 2]).contains("val.json.gz"));
        assert!(message(&packed[..packed.len() / 2]).contains("gzip"));
        assert!(message(b"{\"episodes\": [").contains("line 1"));
        let bomb = pack(&[b' '; 100_000]).unwrap();
        assert!(unpack_within("b", &bomb, 1000).unwrap_err().to_string().contains("more than 1000 bytes"));
    }
}
