use super::FormatsError;
use avln_geom::{Aabb, Point3, Pose, angle};
use serde_json::{Map, Value};

/// Most entries of one list, more than any published data set has in one file.
const MAX_ENTRIES: usize = 2_000_000;
/// How far the length of a quaternion may be from 1.
const QUATERNION_SLACK: f64 = 0.01;

/// A value of a file with the way to it, so that errors can say where they are.
#[derive(Clone, Debug)]
pub(super) struct Cursor<'a> {
    file: &'a str,
    path: String,
    value: &'a Value,
}

impl<'a> Cursor<'a> {
    /// The whole of `file`.
    pub(super) fn root(file: &'a str, value: &'a Value) -> Self {
        Self { file, path: String::new(), value }
    }

    /// An error at this place.
    pub(super) fn error(&self, cause: impl Into<String>) -> FormatsError {
        let place = if self.path.is_empty() { "the top".to_owned() } else { self.path.clone() };
        FormatsError::Malformed { file: self.file.to_owned(), place, cause: cause.into() }
    }

    fn wanted(&self, what: &str) -> FormatsError {
        self.error(format!("expected {what}, found {}", kind(self.value)))
    }

    fn child(&self, name: &str, value: &'a Value) -> Self {
        let dot = if self.path.is_empty() || name.starts_with('[') { "" } else { "." };
        Self { file: self.file, path: format!("{}{dot}{name}", self.path), value }
    }

    /// The value of a key; `None` where it is missing or null.
    pub(super) fn find(&self, key: &str) -> Option<Self> {
        let value = self.value.get(key).filter(|value| !value.is_null())?;
        Some(self.child(key, value))
    }

    /// The value of a key that must be there.
    pub(super) fn get(&self, key: &str) -> Result<Self, FormatsError> {
        self.find(key).ok_or_else(|| self.error(format!("`{key}` is missing")))
    }

    pub(super) fn is_object(&self) -> bool {
        self.value.is_object()
    }

    pub(super) fn is_list(&self) -> bool {
        self.value.is_array()
    }

    /// The entries of a list.
    pub(super) fn list(&self) -> Result<Vec<Self>, FormatsError> {
        let entries = self.value.as_array().ok_or_else(|| self.wanted("a list"))?;
        if entries.len() > MAX_ENTRIES {
            return Err(self.error(format!("{} entries, at most {MAX_ENTRIES} are read", entries.len())));
        }
        let child = |(index, value)| self.child(&format!("[{index}]"), value);
        Ok(entries.iter().enumerate().map(child).collect())
    }

    /// The entries of an object, by key.
    pub(super) fn entries(&self) -> Result<Vec<(&'a str, Self)>, FormatsError> {
        let entries: &Map<String, Value> = self.value.as_object().ok_or_else(|| self.wanted("an object"))?;
        Ok(entries.iter().map(|(key, value)| (key.as_str(), self.child(key, value))).collect())
    }

    pub(super) fn text(&self) -> Result<&'a str, FormatsError> {
        self.value.as_str().ok_or_else(|| self.wanted("a text"))
    }

    /// A whole number, or a text that is one.
    pub(super) fn whole(&self) -> Result<i64, FormatsError> {
        let said = self.value.as_str().and_then(|text| text.trim().parse().ok());
        self.value.as_i64().or(said).ok_or_else(|| self.wanted("a whole number"))
    }

    /// An id: a text, or a whole number.
    pub(super) fn id(&self) -> Result<String, FormatsError> {
        match self.value {
            Value::String(text) if !text.is_empty() => Ok(text.clone()),
            Value::Number(number) => Ok(number.to_string()),
            _ => Err(self.wanted("an id")),
        }
    }

    /// A number that is finite as an `f32`.
    pub(super) fn number(&self) -> Result<f64, FormatsError> {
        let number = self.value.as_f64().ok_or_else(|| self.wanted("a number"))?;
        if (number as f32).is_finite() {
            Ok(number)
        } else {
            Err(self.error(format!("{number} is no finite number")))
        }
    }

    fn numbers<const N: usize>(&self) -> Result<[f64; N], FormatsError> {
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

    /// A place `[x, y, z]`, metres, Y up.
    pub(super) fn point(&self) -> Result<Point3<f32>, FormatsError> {
        let [x, y, z] = self.numbers()?;
        Ok(Point3::new(x as f32, y as f32, z as f32))
    }

    /// Heading, pitch and so on of a quaternion `[x, y, z, w]`.
    pub(super) fn rotation(&self) -> Result<Rotation, FormatsError> {
        let [x, y, z, w] = self.numbers()?;
        let length = x.mul_add(x, y.mul_add(y, z.mul_add(z, w * w)));
        if (length.sqrt() - 1.0).abs() > QUATERNION_SLACK {
            return Err(self.error(format!("quaternion of length {:.3}, expected 1", length.sqrt())));
        }
        let ahead = [-2.0 * (x * z + w * y), -2.0 * (y * z - w * x), -(1.0 - 2.0 * (x * x + y * y))];
        let [right, up, back] = ahead.map(|value| value as f32);
        let level = (right * right + back * back).sqrt();
        Ok(Rotation { heading_rad: angle::atan2(-right, -back), pitch_rad: angle::atan2(up, level) })
    }

    /// The pose of a body: `position` and `rotation` of this object.
    pub(super) fn pose(&self) -> Result<Pose, FormatsError> {
        let rotation = match self.find("rotation") {
            Some(rotation) => rotation.rotation()?,
            None => Rotation::default(),
        };
        Ok(Pose::new(self.get("position")?.point()?, rotation.heading_rad))
    }

    /// A box from the corners `low` and `high` of this object.
    pub(super) fn bounds(&self, low: &str, high: &str) -> Result<Option<Aabb>, FormatsError> {
        let (Some(low), Some(high)) = (self.find(low), self.find(high)) else { return Ok(None) };
        Ok(Some(Aabb::new(low.point()?, high.point()?)))
    }
}

/// Where something looks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Rotation {
    /// As in [`Pose`].
    pub(super) heading_rad: f32,
    /// Positive is up.
    pub(super) pitch_rad: f32,
}

fn kind(value: &Value) -> String {
    match value {
        Value::Null => "nothing".to_owned(),
        Value::Bool(value) => format!("{value}"),
        Value::Number(number) => format!("the number {number}"),
        Value::String(text) => format!("the text {:?}", text.chars().take(40).collect::<String>()),
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
        let said = start.point().unwrap_err().to_string();
        assert!(said.contains("val.json") && said.contains("episodes[0].start[1]"), "{said}");
        assert!(said.contains("expected a number, found the text \"two\""), "{said}");
        let said = root.get("big").unwrap().point().unwrap_err().to_string();
        assert!(said.contains("big[0]") && said.contains("finite"), "{said}");
        let said = root.get("nothing").unwrap_err().to_string();
        assert!(said.contains("the top") && said.contains("`nothing` is missing"), "{said}");
    }

    #[test]
    fn quaternions_are_x_y_z_w() {
        let rotation = |value: Value| Cursor::root("f", &value).rotation().map_err(|error| error.to_string());
        assert_eq!(rotation(json!([0, 0, 0, 1])).unwrap(), Rotation::default());
        let half = std::f64::consts::FRAC_1_SQRT_2;
        // A quarter turn about +Y is a left turn; one about +X looks up.
        let left = rotation(json!([0, half, 0, half])).unwrap();
        assert!((left.heading_rad - FRAC_PI_2).abs() < 1e-5 && left.pitch_rad.abs() < 1e-5, "{left:?}");
        let up = rotation(json!([half, 0, 0, half])).unwrap();
        assert!((up.pitch_rad - FRAC_PI_2).abs() < 1e-3, "{up:?}");
        assert!(rotation(json!([0, 0, 0, 2])).unwrap_err().contains("length 2"));
        assert!(rotation(json!([0, 0, 1])).unwrap_err().contains("expected 4 numbers"));
    }

    #[test]
    fn ids_may_be_numbers_and_numbers_texts() {
        let value = json!({"a": 7, "b": "13", "c": []});
        let root = Cursor::root("f", &value);
        assert_eq!(root.get("a").unwrap().id().unwrap(), "7");
        assert_eq!(root.get("b").unwrap().whole().unwrap(), 13);
        assert!(root.get("c").unwrap().id().is_err() && root.get("c").unwrap().whole().is_err());
    }
}
