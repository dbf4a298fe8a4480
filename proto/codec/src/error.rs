use avln_proto::v1::{Encoding, SensorKind};

/// Numbers that cannot be packed, or bytes that cannot be unpacked.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CodecError {
    /// A sensor's numbers do not come in this encoding.
    #[error("{} is not an encoding of {}; use one that `offered` lists", encoding.as_str_name(), kind.as_str_name())]
    NotOffered {
        /// The sensor.
        kind: SensorKind,
        /// The encoding.
        encoding: Encoding,
    },
    /// There are not as many numbers as were agreed.
    #[error("{what} of {found} {unit}, agreed were {expected}")]
    Length {
        /// What has a length.
        what: &'static str,
        /// What is counted.
        unit: &'static str,
        /// How many there are.
        found: usize,
        /// How many there must be.
        expected: usize,
    },
    /// The bytes are not what their encoding says.
    #[error("the bytes are no {}: {detail}", encoding.as_str_name())]
    Broken {
        /// What they should be.
        encoding: Encoding,
        /// What is wrong with them.
        detail: String,
    },
}

impl CodecError {
    pub(crate) fn broken(encoding: Encoding, detail: impl ToString) -> Self {
        Self::Broken { encoding, detail: detail.to_string() }
    }

    /// Refuses any other number of `unit` than was agreed.
    pub(crate) fn check_length(
        what: &'static str,
        unit: &'static str,
        found: usize,
        expected: usize,
    ) -> Result<(), Self> {
        if found == expected { Ok(()) } else { Err(Self::Length { what, unit, found, expected }) }
    }
}
