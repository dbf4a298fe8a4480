//! Metrics for Prometheus, in the text format 0.0.4.

use crate::{Arena, fault_count};
use avln_grpc::{Histogram, Snapshot};
use avln_store::Census;
pub(crate) use prometheus_client::encoding::prometheus_text::CONTENT_TYPE;
use prometheus_client::{
    collector::Collector,
    encoding::{DescriptorEncoder, EncodeCounterValue, EncodeGaugeValue, NoLabelSet, prometheus_text},
    metrics::{MetricType, exemplar::Exemplar},
    registry::Registry,
};
use std::fmt;

/// Values of a scrape. Metrics name no team, method, run or scene.
#[derive(Debug)]
struct Scrape {
    census: Census,
    snapshot: Snapshot,
    is_draining: bool,
    scene_bytes: usize,
    hanging: usize,
    given_up: u64,
    faults: u64,
}

pub(crate) fn metrics_text(arena: &Arena, census: Census) -> Result<String, fmt::Error> {
    let (control, watchdog) = (arena.control(), arena.control().watchdog());
    let scrape = Scrape {
        census,
        snapshot: control.snapshot(),
        is_draining: control.draining().is_some(),
        scene_bytes: arena.scene_bytes(),
        hanging: watchdog.hanging(),
        given_up: watchdog.given_up(),
        faults: fault_count(),
    };
    text_of(scrape)
}

fn text_of(scrape: Scrape) -> Result<String, fmt::Error> {
    let mut registry = Registry::default();
    registry.register_collector(Box::new(scrape));
    let mut text = String::new();
    prometheus_text::encode(&mut text, &registry)?;
    Ok(text)
}

impl Collector for Scrape {
    fn encode(&self, mut encoder: DescriptorEncoder) -> fmt::Result {
        let version = [("version", env!("CARGO_PKG_VERSION"))];
        encoder
            .encode_descriptor("avln", "Server version.", None, MetricType::Info)?
            .encode_info(&version)?;
        gauge(&mut encoder, "avln_draining", "1 if the server is draining.", &u32::from(self.is_draining))?;
        self.encode_stored(&mut encoder)?;
        self.encode_live(&mut encoder)?;
        gauge(&mut encoder, "avln_scene_bytes", "Memory of prepared scenes.", &self.scene_bytes)?;
        gauge(&mut encoder, "avln_hanging", "Abandoned threads that still simulate.", &self.hanging)?;
        let given_up = "Abandoned simulations since the server start.";
        counter(&mut encoder, "avln_given_up", given_up, &self.given_up)?;
        let faults = "Server faults, such as database failures, since the server start.";
        counter(&mut encoder, "avln_faults", faults, &self.faults)
    }
}

impl Scrape {
    fn encode_stored(&self, encoder: &mut DescriptorEncoder) -> fmt::Result {
        let help = "Runs in the database by state.";
        let mut runs = encoder.encode_descriptor("avln_runs", help, None, MetricType::Gauge)?;
        for (state, count) in &self.census.runs {
            runs.encode_family(&[("state", state.as_str())])?.encode_gauge(count)?;
        }
        let help = "Episodes in the database by state and end reason.";
        let mut episodes = encoder.encode_descriptor("avln_episodes", help, None, MetricType::Gauge)?;
        for (state, end, count) in &self.census.episodes {
            let labels = [("state", state.as_str()), ("end", end.as_deref().unwrap_or(""))];
            episodes.encode_family(&labels)?.encode_gauge(count)?;
        }
        Ok(())
    }

    fn encode_live(&self, encoder: &mut DescriptorEncoder) -> fmt::Result {
        let Snapshot { slots, steps, parts, ends, .. } = &self.snapshot;
        let mut runs: Vec<&str> = slots.iter().map(|slot| slot.run.as_str()).collect();
        runs.dedup();
        gauge(encoder, "avln_sessions", "Runs with an open episode.", &runs.len())?;
        gauge(encoder, "avln_open_episodes", "Slots with an episode.", &slots.len())?;
        counter(encoder, "avln_steps", "Steps since the server start.", steps)?;
        let help = "Ended episodes since the server start, by end reason.";
        let mut ended = encoder.encode_descriptor("avln_episodes_ended", help, None, MetricType::Counter)?;
        for (end, count) in ends {
            ended.encode_family(&[("end", *end)])?.encode_counter(count, NO_EXEMPLAR)?;
        }
        let help = "Step time by part.";
        let mut times = encoder.encode_descriptor("avln_step_seconds", help, None, MetricType::Histogram)?;
        for (part, histogram) in parts {
            let buckets: Vec<(f64, u64)> = Histogram::LIMITS_S.into_iter().zip(histogram.counts).collect();
            times.encode_family(&[("part", *part)])?.encode_histogram::<NoLabelSet>(
                histogram.sum_s,
                histogram.counts.iter().sum(),
                &buckets,
                None,
            )?;
        }
        Ok(())
    }
}

const NO_EXEMPLAR: Option<&Exemplar<NoLabelSet, f64>> = None;

fn gauge(
    encoder: &mut DescriptorEncoder,
    name: &str,
    help: &str,
    value: &impl EncodeGaugeValue,
) -> fmt::Result {
    encoder.encode_descriptor(name, help, None, MetricType::Gauge)?.encode_gauge(value)
}

/// Encodes a counter; the format appends `_total` to the name.
fn counter(
    encoder: &mut DescriptorEncoder,
    name: &str,
    help: &str,
    value: &impl EncodeCounterValue,
) -> fmt::Result {
    encoder.encode_descriptor(name, help, None, MetricType::Counter)?.encode_counter(value, NO_EXEMPLAR)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buckets_are_cumulative() {
        let mut histogram = Histogram::default();
        (histogram.counts[0], histogram.counts[3], histogram.counts[15]) = (1, 2, 4);
        histogram.sum_s = 250.5;
        let snapshot = Snapshot { parts: vec![("queue", histogram)], ..Snapshot::default() };
        let census = Census { runs: vec![("a\"b".to_owned(), 7)], episodes: vec![] };
        let text = text_of(Scrape {
            census,
            snapshot,
            is_draining: true,
            scene_bytes: 5,
            hanging: 0,
            given_up: 3,
            faults: 0,
        });
        let text = text.expect("metrics");
        for line in [
            "avln_step_seconds_bucket{part=\"queue\",le=\"0.0001\"} 1",
            "avln_step_seconds_bucket{part=\"queue\",le=\"0.001\"} 3",
            "avln_step_seconds_bucket{part=\"queue\",le=\"60\"} 3",
            "avln_step_seconds_bucket{part=\"queue\",le=\"+Inf\"} 7",
            "avln_step_seconds_sum{part=\"queue\"} 250.5",
            "avln_step_seconds_count{part=\"queue\"} 7",
            "avln_runs{state=\"a\\\"b\"} 7",
            "avln_draining 1",
            "avln_given_up_total 3",
        ] {
            assert!(text.lines().any(|written| written == line), "{line} is missing in {text}");
        }
        assert!(text.contains("avln_info{version="), "{text}");
        let end = "le=\"+Inf\"} 7\navln_step_seconds_sum{part=\"queue\"} 250.5\navln_step_seconds_count{part=\"queue\"} 7\n";
        assert!(text.contains(end), "the last bucket precedes sum and count: {text}");
        assert_eq!(text.matches("le=\"+Inf\"").count(), 1, "{text}");
    }
}
