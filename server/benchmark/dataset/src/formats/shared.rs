//! What the formats of the field have in common.

use super::{FormatsError, json::Cursor};
use avln_geom::Pose;
use std::collections::BTreeSet;

/// The episodes of a file; none where it is an index. Two of one id in one scene are refused.
pub(super) fn episodes<'a>(root: &Cursor<'a>) -> Result<Vec<Cursor<'a>>, FormatsError> {
    let episodes = root.get("episodes")?.list()?;
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

/// The start of an episode: the base, and a quaternion x, y, z, w.
pub(super) fn start(episode: &Cursor) -> Result<Pose, FormatsError> {
    let rotation = episode.get("start_rotation")?.rotation()?;
    Ok(Pose::new(episode.get("start_position")?.point()?, rotation.heading_rad))
}

/// A viewpoint: a bare place, an `agent_state`, or a `position`.
pub(super) fn viewpoint(view: &Cursor) -> Result<Pose, FormatsError> {
    if view.is_list() {
        return Ok(Pose::new(view.point()?, 0.0));
    }
    match view.find("agent_state") {
        Some(state) => state.pose(),
        None => view.pose(),
    }
}
