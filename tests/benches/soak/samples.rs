//! Memory, descriptors and threads of the server over time.

use std::fs;

/// Shortest warm-up, seconds.
const MIN_WARM_UP_S: u64 = 120;
/// Largest median of the last third in relation to the first.
const MAX_GROWTH: f64 = 1.05;
/// Fewest samples for a comparison.
const MIN_SAMPLES: usize = 9;

/// State of the server process.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sample {
    /// Seconds since the start of the soak.
    second: u64,
    /// Resident memory, MiB.
    pub(crate) rss_mib: f64,
    pub(crate) descriptors: usize,
    pub(crate) threads: usize,
}

impl Sample {
    /// Returns the state of a process; `None` without `/proc`.
    pub(crate) fn take(process: u32, second: u64) -> Option<Self> {
        let status = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
        let number = |name: &str| {
            let line = status.lines().find_map(|line| line.strip_prefix(name))?;
            line.split_whitespace().next()?.parse::<usize>().ok()
        };
        let descriptors = fs::read_dir(format!("/proc/{process}/fd")).ok()?.count();
        let rss_mib = number("VmRSS:")? as f64 / 1024.0;
        Some(Self { second, rss_mib, descriptors, threads: number("Threads:")? })
    }
}

/// Samples in order of time.
#[derive(Debug, Default)]
pub(crate) struct Samples(Vec<Sample>);

impl Samples {
    pub(crate) fn push(&mut self, sample: Sample) {
        self.0.push(sample);
    }

    pub(crate) fn last(&self) -> Sample {
        self.0.last().copied().unwrap_or_default()
    }

    /// Prints and compares the first and the last third after the warm-up, a tenth of the time.
    pub(crate) fn are_flat(&self, length_s: u64) -> bool {
        let warm_up_s = (length_s / 10).max(MIN_WARM_UP_S);
        let warm: Vec<_> = self.0.iter().filter(|sample| sample.second > warm_up_s).copied().collect();
        if warm.len() < MIN_SAMPLES {
            println!("flatness: {} samples after {warm_up_s} s of warm-up are too few", warm.len());
            return true;
        }
        println!("after {warm_up_s} s of warm-up: {:+.1} MiB per hour", slope_mib_per_h(&warm));
        let of = |what: fn(&Sample) -> f64| warm.iter().map(what).collect::<Vec<_>>();
        [
            is_flat("memory, MiB", &of(|sample| sample.rss_mib)),
            is_flat("descriptors", &of(|sample| sample.descriptors as f64)),
            is_flat("threads", &of(|sample| sample.threads as f64)),
        ]
        .iter()
        .all(|flat| *flat)
    }
}

fn is_flat(name: &str, values: &[f64]) -> bool {
    let third = values.len() / 3;
    let [first, last] = [&values[..third], &values[values.len() - third..]].map(median);
    let most = values.iter().copied().fold(0.0, f64::max);
    let flat = last <= MAX_GROWTH * first;
    let verdict = if flat { "flat" } else { "NOT FLAT" };
    println!(
        "{name}: median {first:.0} in the first third, {last:.0} in the last, {most:.0} at most: {verdict}"
    );
    flat
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[sorted.len() / 2]
}

/// Slope of the least-squares line through the memory.
fn slope_mib_per_h(samples: &[Sample]) -> f64 {
    let count = samples.len() as f64;
    let hours = |sample: &Sample| sample.second as f64 / 3600.0;
    let mean_h = samples.iter().map(hours).sum::<f64>() / count;
    let mean_mib = samples.iter().map(|sample| sample.rss_mib).sum::<f64>() / count;
    let product = |sample: &Sample| (hours(sample) - mean_h) * (sample.rss_mib - mean_mib);
    let square = |sample: &Sample| (hours(sample) - mean_h).powi(2);
    samples.iter().map(product).sum::<f64>() / samples.iter().map(square).sum::<f64>()
}
