//! Heads from SOFA files: small synthetic files, and real files in `../shared/scenes` if present.

use crate::common::{first_wave, lag_us, level_db, listener, opaque_building, point};
use crate::sofa_file::{Table, file};
use avln_acoustics::{Head, HeadError, ImpulseResponse, MeasuredHead, Settings, interaural_delay_s};
use avln_geom::Rng;
use std::path::Path;
use std::sync::Arc;

const RATE_HZ: f64 = 48_000.0;
const TAPS: usize = 256;

/// A synthetic ear by azimuth: delay after Woodworth for a sphere of 8.75 cm, and a gain.
fn ear(azimuth_deg: f64, is_left: bool) -> (f64, f64) {
    let towards = if is_left { azimuth_deg } else { -azimuth_deg }.to_radians().sin();
    let path_m = if towards > 0.0 { -0.0875 * towards } else { 0.0875 * (-towards).asin() };
    (path_m / 343.0, 1.0 + 0.5 * towards)
}

struct Written {
    spherical: bool,
    /// Writes delays to a separate table.
    with_delays: bool,
    swapped: bool,
}

impl Written {
    fn tables(&self) -> Vec<Table> {
        let places: Vec<(f64, f64)> =
            (0..24).flat_map(|around| [-30.0, 0.0, 30.0].map(|up| (15.0 * f64::from(around), up))).collect();
        let mut tables =
            vec![self.places(&places), self.receivers(), table("Data.SamplingRate", &[1], vec![RATE_HZ])];
        let (mut taps, mut delays) = (Vec::new(), Vec::new());
        for (azimuth_deg, elevation_deg) in &places {
            for is_left in [!self.swapped, self.swapped] {
                let level = elevation_deg.to_radians().cos();
                let (delay_s, gain) =
                    ear(azimuth_deg.to_radians().sin().mul_add(level, 0.0).asin().to_degrees(), is_left);
                let samples = 60.0 + delay_s * RATE_HZ;
                let listed = if self.with_delays { samples - 70.3 } else { 0.0 };
                delays.push(listed);
                taps.extend((0..TAPS).map(|tap| gain * pulse(tap as f64 - samples + listed)));
            }
        }
        tables.push(table("Data.IR", &[places.len() as u64, 2, TAPS as u64], taps));
        if self.with_delays {
            tables.push(table("Data.Delay", &[places.len() as u64, 2], delays));
        }
        tables
    }

    fn places(&self, places: &[(f64, f64)]) -> Table {
        let cartesian = |azimuth: f64, up: f64| {
            [up.cos() * azimuth.cos() * 1.5, up.cos() * azimuth.sin() * 1.5, up.sin() * 1.5]
        };
        let row = |(azimuth, up): &(f64, f64)| match self.spherical {
            true => [*azimuth, *up, 1.5],
            false => cartesian(azimuth.to_radians(), up.to_radians()),
        };
        let kind = Some(if self.spherical { "spherical" } else { "cartesian" });
        Table {
            kind,
            ..table("SourcePosition", &[places.len() as u64, 3], places.iter().flat_map(row).collect())
        }
    }

    fn receivers(&self) -> Table {
        let left_m = if self.swapped { -0.09 } else { 0.09 };
        Table {
            kind: Some("cartesian"),
            ..table("ReceiverPosition", &[2, 3, 1], vec![0.0, left_m, 0.0, 0.0, -left_m, 0.0])
        }
    }
}

fn table(name: &'static str, sizes: &[u64], values: Vec<f64>) -> Table {
    Table { name, sizes: sizes.to_vec(), values, kind: None }
}

/// A pulse with frequencies up to 7 kHz, which fits a sample rate of 16 kHz.
fn pulse(samples: f64) -> f64 {
    let time = std::f64::consts::PI * samples * 14_000.0 / RATE_HZ;
    let sinc = if time.abs() < 1e-9 { 1.0 } else { time.sin() / time };
    let window = 0.5 + 0.5 * (std::f64::consts::PI * (samples / 60.0).clamp(-1.0, 1.0)).cos();
    sinc * window * 14_000.0 / RATE_HZ
}

fn settings(bytes: &[u8]) -> Settings {
    let head = MeasuredHead::from_sofa(bytes).expect("a head");
    Settings { head: Head::Measured(Arc::new(head)), ..first_wave() }
}

/// Response at the origin to a source `azimuth_deg` to the left at 2 m.
fn heard(settings: &Settings, azimuth_deg: f32, heading_deg: f32) -> ImpulseResponse {
    let (sin, cos) = (azimuth_deg + heading_deg).to_radians().sin_cos();
    let source = opaque_building(&[], settings.clone()).source(&point(-2.0 * sin, 1.0, -2.0 * cos));
    source.impulse_response(&listener(0.0, 0.0, heading_deg))
}

#[test]
fn measured_heads_match_their_file() {
    let settings =
        settings(&file("SOFA", &Written { spherical: true, with_delays: false, swapped: false }.tables()));
    for (azimuth_deg, heading_deg) in
        [(0.0, 0.0), (30.0, 0.0), (45.0, 100.0), (90.0, 0.0), (-60.0, 20.0), (135.0, -90.0)]
    {
        let response = heard(&settings, azimuth_deg, heading_deg);
        let ((left_s, left), (right_s, right)) =
            (ear(azimuth_deg.into(), true), ear(azimuth_deg.into(), false));
        let lead_s = interaural_delay_s(&response).expect("sound in both ears");
        assert!((lead_s - (right_s - left_s)).abs() < 2e-6, "{azimuth_deg}: {lead_s} s");
        for frequency_hz in [300.0, 1000.0, 4000.0] {
            let ild_db = level_db(&response.left, frequency_hz) - level_db(&response.right, frequency_hz);
            let expected_db = 20.0 * (left / right).log10();
            assert!((ild_db - expected_db).abs() < 0.3, "{azimuth_deg}: {ild_db}, not {expected_db} dB");
        }
    }
    // Between two measured directions.
    let lead_s = interaural_delay_s(&heard(&settings, 37.0, 0.0)).expect("sound in both ears");
    let (left_s, right_s) = (ear(37.0, true).0, ear(37.0, false).0);
    assert!((lead_s - (right_s - left_s)).abs() < 15e-6, "{lead_s} s");
}

#[test]
fn measured_heads_have_the_free_field_level() {
    let settings =
        settings(&file("SOFA", &Written { spherical: true, with_delays: false, swapped: false }.tables()));
    // Gains around the head are 1 + sin / 2: mean square 1.125 at elevation 0, less above and below.
    let response = heard(&settings, 0.0, 0.0);
    let level = level_db(&response.left, 500.0);
    assert!((level + 6.02 + 0.45).abs() < 0.2, "{level} dB");
}

#[test]
fn table_variants_give_the_same_head() {
    let plain =
        settings(&file("SOFA", &Written { spherical: true, with_delays: false, swapped: false }.tables()));
    for (spherical, with_delays, swapped) in [(false, false, false), (true, true, false), (true, false, true)]
    {
        let other = settings(&file("SOFA", &Written { spherical, with_delays, swapped }.tables()));
        for azimuth_deg in [0.0, 40.0, -100.0] {
            let (one, two) = (heard(&plain, azimuth_deg, 0.0), heard(&other, azimuth_deg, 0.0));
            for (a, b) in one.left.iter().zip(&two.left).chain(one.right.iter().zip(&two.right)) {
                assert!((a - b).abs() < 2e-4, "{spherical} {with_delays} {swapped} {azimuth_deg}: {a} {b}");
            }
        }
    }
}

#[test]
fn unusable_files_fail_with_the_table_name() {
    let whole = Written { spherical: true, with_delays: true, swapped: false };
    let refused = |bytes: &[u8]| MeasuredHead::from_sofa(bytes).expect_err("no head");
    assert_eq!(refused(&[]), HeadError::NoSofa);
    assert_eq!(refused(b"RIFF, which is another format"), HeadError::NoSofa);
    assert_eq!(refused(&file("CF-1.0", &whole.tables())), HeadError::NoSofa);
    let bytes = file("SOFA", &whole.tables());
    for share in [1, 10, 50, 99] {
        assert_eq!(refused(&bytes[..bytes.len() * share / 100]), HeadError::NoSofa);
    }
    for name in ["Data.IR", "SourcePosition", "Data.SamplingRate"] {
        let mut tables = whole.tables();
        tables.retain(|table| table.name != name);
        assert_eq!(refused(&file("SOFA", &tables)), HeadError::Missing(name));
    }
    let changed = |name: &str, change: fn(&mut Table)| {
        let mut tables = whole.tables();
        tables.iter_mut().filter(|table| table.name == name).for_each(change);
        refused(&file("SOFA", &tables))
    };
    assert_eq!(changed("Data.SamplingRate", |table| table.values[0] = 8000.0), HeadError::Rate(8000.0));
    assert_eq!(changed("Data.IR", |table| table.values.fill(0.0)), HeadError::Silent);
    for (name, change) in [
        ("Data.IR", (|table| table.values[7] = f64::NAN) as fn(&mut Table)),
        ("Data.IR", |table| table.sizes = vec![48, 3, 256]),
        ("SourcePosition", |table| table.values[2] = 0.0),
        ("SourcePosition", |table| table.sizes = vec![3, 72]),
        ("Data.Delay", |table| table.values[0] = 1e9),
    ] {
        let error = changed(name, change);
        assert!(matches!(&error, HeadError::Shape(found, _) if *found == name), "{error}");
    }
}

#[test]
fn damaged_files_never_panic() {
    let bytes = file("SOFA", &Written { spherical: true, with_delays: true, swapped: false }.tables());
    let mut rng = Rng::new(5);
    let tables_at = bytes.len() - 1500;
    for _ in 0..150 {
        let mut damaged = bytes.clone();
        for _ in 0..=rng.below(3) {
            let at = if rng.below(4) == 0 { rng.below(60) } else { tables_at + rng.below(1500) };
            damaged[at] = [0, 255, rng.below(256) as u8][rng.below(3)];
        }
        let _ = MeasuredHead::from_sofa(&damaged);
    }
}

#[test]
fn manikin_cues_match_the_source_direction() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../../../shared/scenes/sofa/MIT_KEMAR_normal_pinna.sofa");
    let Ok(bytes) = std::fs::read(path) else {
        // Not `println!`, which the test harness hides.
        let _ = std::io::Write::write_fmt(
            &mut std::io::stderr(),
            format_args!(
                "skipped: manikin_cues_match_the_source_direction; put scenes into ../shared/scenes\n"
            ),
        );
        return;
    };
    let settings = settings(&bytes);
    for (azimuth_deg, least_us, most_us) in
        [(0.0, -30.0, 30.0), (30.0, 230.0, 400.0), (90.0, 600.0, 800.0), (-60.0, -680.0, -450.0)]
    {
        let response = heard(&settings, azimuth_deg, 0.0);
        let lead_us = interaural_delay_s(&response).expect("sound in both ears") * 1e6;
        assert!((least_us..=most_us).contains(&lead_us), "{azimuth_deg}: {lead_us} us");
        if azimuth_deg != 0.0 {
            let sign = f64::from(azimuth_deg.signum());
            assert!(sign * lag_us(&response, 2000.0, 4000.0) < -200.0, "{azimuth_deg}");
            for frequency_hz in [1000.0, 2000.0, 4000.0] {
                let ild_db = level_db(&response.left, frequency_hz) - level_db(&response.right, frequency_hz);
                assert!(sign * ild_db > 1.0, "{azimuth_deg}, {frequency_hz} Hz: {ild_db} dB");
            }
        }
    }
}
