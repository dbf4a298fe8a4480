//! Smallest difference in SR that a comparison of two runs detects.

/// Share of episodes in which exactly one of two similar methods succeeds, from the episodes of `docs/results.csv`.
const DISCORDANCE: f64 = 0.25;
/// Correlation of success between episodes in a scene, from the same episodes.
const SCENE_CORRELATION: f64 = 0.1;
/// Squared sum of the normal quantiles for a two-sided 95 % level (1.96) and 80 % power (0.84).
const SQUARED_QUANTILES: f64 = 7.84;

/// Returns the mean number of episodes that two runs share in a phase with `episodes` episodes. `sample` is a run's number of
/// episodes and the number among these that all runs share; `None` for all episodes.
pub fn common_episodes(episodes: u32, sample: Option<(u32, u32)>) -> f64 {
    let Some((drawn, anchors)) = sample.filter(|(_, anchors)| *anchors < episodes) else {
        return f64::from(episodes);
    };
    let [all, drawn, anchors] = [episodes, drawn.clamp(anchors, episodes), anchors].map(f64::from);
    anchors + (drawn - anchors) * (drawn - anchors) / (all - anchors)
}

/// Returns the smallest difference in SR that a paired comparison detects at the 95 % level with 80 % power; `None` if it is
/// above a quarter, or for fewer than two common episodes. Episodes in the same scene count less.
pub fn smallest_difference(common_episodes: f64, scenes: u32) -> Option<f64> {
    if common_episodes < 2.0 || scenes == 0 {
        return None;
    }
    let others_in_scene = (common_episodes / f64::from(scenes) - 1.0).max(0.0);
    let independent = common_episodes / (1.0 + SCENE_CORRELATION * others_in_scene);
    let difference = (SQUARED_QUANTILES * DISCORDANCE / (independent + SQUARED_QUANTILES)).sqrt();
    // The difference in SR is at most the share of episodes with different success.
    (difference <= DISCORDANCE).then_some(difference)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(common: f64, scenes: u32) -> Option<f64> {
        smallest_difference(common, scenes).map(|share| (1000.0 * share).round() / 10.0)
    }

    #[test]
    fn differences_shrink_with_episodes_and_scenes() {
        let cases = [
            (200.0, 25, Some(12.5)),
            (100.0, 25, Some(15.2)),
            (1000.0, 100, Some(6.1)),
            (16.0, 4, None),
            (1.0, 1, None),
            (100.0, 0, None),
        ];
        for (common, scenes, expected) in cases {
            assert_eq!(points(common, scenes), expected, "{common} episodes, {scenes} scenes");
        }
        assert!(points(100.0, 100) < points(100.0, 10));
    }

    #[test]
    fn samples_share_anchors_and_chance_episodes() {
        assert_eq!(common_episodes(400, None), 400.0);
        assert_eq!(common_episodes(400, Some((100, 100))), 100.0);
        assert_eq!(common_episodes(400, Some((100, 0))), 25.0);
        assert_eq!(common_episodes(420, Some((100, 20))), 36.0);
        assert_eq!(common_episodes(4, Some((4, 4))), 4.0);
    }
}
