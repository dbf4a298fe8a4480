//! Measured heads in SOFA files (AES69).

use avln_geom::Vector3;
use sofar::hdf::{self, DataObject, ParsedHdf};
use std::ops::RangeInclusive;

const DIRECTIONS: RangeInclusive<usize> = 2..=50_000;
const TAPS: RangeInclusive<usize> = 8..=16_384;

/// Permitted sample rates, hertz: the file must cover the whole audible range.
const RATES_HZ: RangeInclusive<f64> = 16_000.0..=400_000.0;

/// Longest separate delay, seconds.
const MAX_DELAY_S: f64 = 0.1;

/// Head file errors.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum HeadError {
    /// A different format, or a damaged file.
    #[error("it is damaged or no SOFA file; choose a SimpleFreeFieldHRIR file")]
    NoSofa,
    /// A missing table.
    #[error("table {0} is missing; choose a SimpleFreeFieldHRIR file")]
    Missing(&'static str),
    /// A table with the wrong shape.
    #[error("{0} has {1}; 2 ears, 2 to 50000 directions (M x 3) and 8 to 16384 taps are supported")]
    Shape(&'static str, String),
    /// Sample rate out of range, hertz.
    #[error("its sample rate is {0} Hz; 16000 to 400000 Hz are supported")]
    Rate(f64),
    /// Silent responses.
    #[error("both ears are silent; choose a SimpleFreeFieldHRIR file")]
    Silent,
}

pub(super) struct Measurements {
    pub(super) rate_hz: f64,
    /// Unit vectors to the source: x ahead, y left, z up.
    pub(super) directions: Vec<Vector3<f64>>,
    /// Per direction: left ear, right ear.
    pub(super) ears: Vec<[EarMeasurement; 2]>,
}

pub(super) struct EarMeasurement {
    pub(super) taps: Vec<f32>,
    /// Delay before the first tap, seconds.
    pub(super) delay_s: f64,
}

/// A file table, row by row.
struct Table {
    values: Vec<f64>,
    sizes: Vec<usize>,
    /// Coordinate type: `cartesian` or `spherical`.
    kind: Option<String>,
}

impl Measurements {
    pub(super) fn read(bytes: &[u8]) -> Result<Self, HeadError> {
        let file = hdf::parse_with_children(bytes).map_err(|_| HeadError::NoSofa)?;
        if attribute(&file.root, "Conventions").as_deref() != Some("SOFA") {
            return Err(HeadError::NoSofa);
        }
        let responses = Table::of(&file, "Data.IR")?;
        let [count, ears, taps] = responses.sizes[..] else {
            return Err(HeadError::Shape("Data.IR", format!("{:?}", responses.sizes)));
        };
        if !DIRECTIONS.contains(&count) || ears != 2 || !TAPS.contains(&taps) {
            return Err(HeadError::Shape("Data.IR", format!("{count} x {ears} x {taps}")));
        }
        let rate_hz = Table::of(&file, "Data.SamplingRate")?.values[0];
        if !RATES_HZ.contains(&rate_hz) {
            return Err(HeadError::Rate(rate_hz));
        }
        let directions = directions(&Table::of(&file, "SourcePosition")?, count)?;
        let delays = delays_s(&file, count, rate_hz)?;
        let left = left_ear(&file)?;
        let ear = |direction: usize, ear: usize| {
            let row = &responses.values[(2 * direction + ear) * taps..][..taps];
            EarMeasurement {
                taps: row.iter().map(|tap| *tap as f32).collect(),
                delay_s: delays[direction][ear],
            }
        };
        let both = (0..count).map(|direction| [ear(direction, left), ear(direction, 1 - left)]);
        check_view(&file)?;
        Ok(Self { rate_hz, directions, ears: both.collect() })
    }
}

impl Table {
    /// Reads the table `name`: at least one number, all finite.
    fn of(file: &ParsedHdf<'_>, name: &'static str) -> Result<Self, HeadError> {
        let object = file.get_child(name).and_then(Result::ok).ok_or(HeadError::Missing(name))?;
        let values = numbers(&object).filter(|values| !values.is_empty()).ok_or(HeadError::Missing(name))?;
        let sizes: Vec<usize> = object.ds.dimension_size.iter().map(|size| *size as usize).collect();
        if sizes.iter().product::<usize>() != values.len() {
            return Err(HeadError::Shape(name, format!("{} numbers in {sizes:?}", values.len())));
        }
        if !values.iter().all(|value| value.is_finite()) {
            return Err(HeadError::Shape(name, "numbers that are not finite".to_owned()));
        }
        Ok(Self { values, sizes, kind: attribute(&object, "Type") })
    }

    /// Position in row `index`, metres.
    fn place(&self, index: usize) -> Vector3<f64> {
        let [a, b, c] = [0, 1, 2].map(|axis| self.values[3 * index + axis]);
        if self.kind.as_deref() != Some("spherical") {
            return Vector3::new(a, b, c);
        }
        unit_vector(a.to_radians(), b.to_radians()) * c
    }
}

/// Unit vector: x ahead, y left, z up.
pub(super) fn unit_vector(azimuth_rad: f64, elevation_rad: f64) -> Vector3<f64> {
    let level = libm::cos(elevation_rad);
    Vector3::new(level * libm::cos(azimuth_rad), level * libm::sin(azimuth_rad), libm::sin(elevation_rad))
}

fn attribute(object: &DataObject, name: &str) -> Option<String> {
    let found = object.parsed_attributes.iter().find(|attribute| attribute.name == name)?;
    Some(found.value.as_deref()?.trim_matches(['\0', ' ']).to_owned())
}

/// Returns floats; `None` for other types.
fn numbers(object: &DataObject) -> Option<Vec<f64>> {
    const FLOAT: u8 = 1;
    let data = &object.data;
    match (object.dt.class_and_version & 0x0f, object.dt.size) {
        (FLOAT, 4) => Some(data.as_chunks().0.iter().map(|b| f64::from(f32::from_le_bytes(*b))).collect()),
        (FLOAT, 8) => Some(data.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect()),
        _ => None,
    }
}

fn directions(places: &Table, count: usize) -> Result<Vec<Vector3<f64>>, HeadError> {
    let wrong = |what: String| HeadError::Shape("SourcePosition", what);
    if places.sizes != [count, 3] {
        return Err(wrong(format!("{:?}", places.sizes)));
    }
    let unit = |index| {
        let direction = places.place(index).try_normalize(1e-6);
        direction.ok_or_else(|| wrong(format!("a source at the head's centre, number {index}")))
    };
    (0..count).map(unit).collect()
}

/// Per direction: delays at both ears, in file order.
fn delays_s(file: &ParsedHdf<'_>, count: usize, rate_hz: f64) -> Result<Vec<[f64; 2]>, HeadError> {
    let Ok(delays) = Table::of(file, "Data.Delay") else { return Ok(vec![[0.0; 2]; count]) };
    let most = MAX_DELAY_S * rate_hz;
    let in_range = delays.values.iter().all(|delay| delay.abs() <= most);
    let row = |direction: usize| match delays.sizes[..] {
        [1, 2] => Some([delays.values[0], delays.values[1]]),
        [rows, 2] if rows == count => Some([delays.values[2 * direction], delays.values[2 * direction + 1]]),
        _ => None,
    };
    let rows: Option<Vec<[f64; 2]>> = (0..count).map(row).collect();
    match rows.filter(|_| in_range) {
        Some(rows) => Ok(rows.into_iter().map(|row| row.map(|samples| samples / rate_hz)).collect()),
        None => Err(HeadError::Shape("Data.Delay", format!("{:?} of at most {most} samples", delays.sizes))),
    }
}

/// Receiver index for the left ear.
fn left_ear(file: &ParsedHdf<'_>) -> Result<usize, HeadError> {
    let Ok(receivers) = Table::of(file, "ReceiverPosition") else { return Ok(0) };
    if receivers.values.len() < 6 {
        return Err(HeadError::Shape("ReceiverPosition", format!("{:?}", receivers.sizes)));
    }
    Ok(usize::from(receivers.place(0).y < receivers.place(1).y))
}

/// Rejects heads that do not face the x axis.
fn check_view(file: &ParsedHdf<'_>) -> Result<(), HeadError> {
    let Ok(view) = Table::of(file, "ListenerView") else { return Ok(()) };
    if view.values.len() >= 3 && view.place(0).x > 0.99 * view.place(0).norm() {
        return Ok(());
    }
    Err(HeadError::Shape("ListenerView", "a view that is not along +x".to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An HDF5 superblock that announces a file of `bytes` bytes.
    fn superblock(bytes: u64) -> Vec<u8> {
        let addresses = [0, u64::MAX, bytes, 48].map(u64::to_le_bytes).concat();
        [&b"\x89HDF\r\n\x1a\n\x02\x08\x08\x00"[..], &addresses].concat()
    }

    #[test]
    fn contradictory_files_are_errors_without_a_panic() {
        // Not `MeasuredHead::from_sofa`, which also catches panics.
        for bytes in [0, 43, 45, u64::MAX] {
            let read = Measurements::read(&superblock(bytes));
            assert_eq!(read.err(), Some(HeadError::NoSofa), "{bytes} bytes announced");
        }
    }
}
