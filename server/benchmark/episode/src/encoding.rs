use serde::{Deserialize, Serialize};

/// How the numbers of a sensor travel to the agent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Encoding {
    /// As they are.
    #[default]
    Raw,
    /// Few bits for what a prediction leaves over; the same numbers.
    Packed,
    /// A PNG file; the same numbers.
    Png,
    /// A QOI file; the same numbers.
    Qoi,
    /// Depth in whole millimetres.
    Millimetres,
    /// Depth in whole millimetres, packed.
    PackedMillimetres,
    /// Sound as 16-bit whole numbers.
    Int16,
}

impl Encoding {
    /// Whether the numbers arrive bit for bit.
    pub fn is_lossless(self) -> bool {
        match self {
            Self::Raw | Self::Packed | Self::Png | Self::Qoi => true,
            Self::Millimetres | Self::PackedMillimetres | Self::Int16 => false,
        }
    }

    /// The words for people.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Raw => "raw",
            Self::Packed => "packed",
            Self::Png => "PNG",
            Self::Qoi => "QOI",
            Self::Millimetres => "whole millimetres",
            Self::PackedMillimetres => "whole millimetres, packed",
            Self::Int16 => "16-bit samples",
        }
    }
}

/// How the numbers of each sensor travel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Encodings {
    /// Colours.
    pub rgb: Encoding,
    /// Distances.
    pub depth: Encoding,
    /// Sound.
    pub audio: Encoding,
}

impl Encodings {
    /// Whether all numbers arrive bit for bit.
    pub fn are_lossless(&self) -> bool {
        [self.rgb, self.depth, self.audio].into_iter().all(Encoding::is_lossless)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Sensors;

    #[test]
    fn sensors_that_were_stored_without_encodings_are_raw() {
        let stored = r#"{"rgb":true,"depth":false,"audio":true,"width":64,"height":64,"hfov_rad":1.5}"#;
        let sensors: Sensors = serde_json::from_str(stored).unwrap();
        assert_eq!(sensors.encodings, Encodings::default());
        assert!(sensors.encodings.are_lossless());
        let rounded = Encodings { depth: Encoding::Millimetres, ..Encodings::default() };
        let again: Encodings = serde_json::from_str(&serde_json::to_string(&rounded).unwrap()).unwrap();
        assert_eq!(again, rounded);
        assert!(!again.are_lossless());
    }
}
