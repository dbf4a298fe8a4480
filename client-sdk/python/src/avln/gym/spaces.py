"""Observations and missions as arrays of fixed shapes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces

from avln.action import Order
from avln.mission import Modality
from avln.observation import Feedback

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from avln.mission import Goal, Mission
    from avln.observation import Observation
    from avln.task import Sensors, TaskSpec

MAX_GOALS = 4
"""Most goals per mission; missing goals are zeros."""
GOAL_TEXT_BYTES = 256
"""UTF-8 bytes per goal text, truncated or padded with zeros."""
_FARTHEST_M = 10_000.0
_LOUDEST = 1e6


class ObservationSpace:
    """The layout of observations: entries and their spaces.

    | key | type and shape | content |
    | --- | --- | --- |
    | `rgb` | u8 [height, width, 3] | colours, first row on top |
    | `depth` | f32 [height, width] | metres on the optical axis; 0: no surface in range |
    | `audio` | f32 [2, samples] | sound pressure of the step, left ear first |
    | `pose` | f32 [4] | x right, y up, z back in metres, heading in radians, left positive |
    | `remaining` | i32 [2] | remaining steps, remaining Submits; at 0, claim the last goal with Stop |
    | `feedback` | 0 to 3 | `avln.Feedback` of the last step |
    | `order` | 0 or 1 | 1: goals count only in the given order |
    | `goal_modality` | 0 to 3, [4] | `avln.Modality` per goal; 0: no goal |
    | `goal_text` | u8 [4, 256] | UTF-8 of category or description |
    | `goal_image` | u8 [4, side, side, 3] | image per goal, scaled to `side`; zeros: no image |
    """

    def __init__(
        self, task: TaskSpec, sensors: Sensors, keys: Sequence[str] | None = None, goal_side: int = 128
    ) -> None:
        """Creates a layout with the entries `keys`, by default all entries of the sensors.

        Raises:
            ValueError: if a key is unknown.
        """
        self._goal_side = goal_side
        known = _known(task, sensors, goal_side)
        wanted = list(known) if keys is None else list(keys)
        unknown = [key for key in wanted if key not in known]
        if unknown:
            raise ValueError(f"select observations: unknown keys {unknown}; use {', '.join(sorted(known))}")
        self.space = spaces.Dict({key: known[key] for key in wanted})
        """Observation space with finite bounds."""

    def mission(self, mission: Mission) -> dict[str, Any]:
        """Returns the entries that are constant during an episode."""
        goals = mission.goals[:MAX_GOALS]
        missing = MAX_GOALS - len(goals)
        modalities = [int(goal.modality) for goal in goals] + [0] * missing
        entries = {
            "order": np.int64(mission.order is Order.ORDERED),
            "goal_modality": np.array(modalities, np.int64),
        }
        if "goal_text" in self.space.spaces:
            entries["goal_text"] = np.stack([_text(goal) for goal in goals] + [_text(None)] * missing)
        if "goal_image" in self.space.spaces:
            pictures = [_picture(goal, self._goal_side) for goal in goals]
            entries["goal_image"] = np.stack(pictures + [_picture(None, self._goal_side)] * missing)
        return entries

    def observation(self, seen: Observation, mission: dict[str, Any]) -> dict[str, Any]:
        """Converts an observation and copies the `mission` entries; sensor arrays may be read-only."""
        pose = seen.pose
        entries = {
            "rgb": seen.rgb,
            "depth": seen.depth,
            "audio": seen.audio,
            "pose": np.array([pose.x_m, pose.y_m, pose.z_m, pose.heading_rad], np.float32),
            "remaining": np.array([seen.remaining_steps, seen.remaining_submits], np.int32),
            "feedback": np.int64(seen.feedback),
        }
        entries.update((key, value.copy()) for key, value in mission.items())
        return {key: entries[key] for key in self.space.spaces}


def _known(task: TaskSpec, sensors: Sensors, goal_side: int) -> dict[str, spaces.Space[Any]]:
    picture = (task.height, task.width)
    known: dict[str, spaces.Space[Any]] = {}
    if sensors.rgb:
        known["rgb"] = spaces.Box(0, 255, (*picture, 3), np.uint8)
    if sensors.depth:
        known["depth"] = spaces.Box(0.0, task.depth_max_m, picture, np.float32)
    if sensors.audio:
        known["audio"] = spaces.Box(-_LOUDEST, _LOUDEST, (2, task.audio_samples), np.float32)
    farthest = np.array([_FARTHEST_M] * 3 + [math.pi + 1e-3], np.float32)
    known["pose"] = spaces.Box(-farthest, farthest, dtype=np.float32)
    known["remaining"] = spaces.Box(0, max(task.max_steps, MAX_GOALS), (2,), np.int32)
    known["feedback"] = spaces.Discrete(len(Feedback))
    known["order"] = spaces.Discrete(2)
    known["goal_modality"] = spaces.MultiDiscrete([len(Modality) + 1] * MAX_GOALS)
    known["goal_text"] = spaces.Box(0, 255, (MAX_GOALS, GOAL_TEXT_BYTES), np.uint8)
    known["goal_image"] = spaces.Box(0, 255, (MAX_GOALS, goal_side, goal_side, 3), np.uint8)
    return known


def _text(goal: Goal | None) -> NDArray[np.uint8]:
    words = "" if goal is None else goal.text
    kept = words.encode()[:GOAL_TEXT_BYTES]
    return np.frombuffer(kept.ljust(GOAL_TEXT_BYTES, b"\0"), np.uint8)


def _picture(goal: Goal | None, side: int) -> NDArray[np.uint8]:
    if goal is None or goal.image is None:
        return np.zeros((side, side, 3), np.uint8)
    height, width, _ = goal.image.shape
    rows = ((np.arange(side) + 0.5) * height / side).astype(np.intp)
    columns = ((np.arange(side) + 0.5) * width / side).astype(np.intp)
    picture: NDArray[np.uint8] = goal.image[rows[:, None], columns]
    return picture
