"""Adapter for unmodified Habitat and SoundSpaces agents with `reset()` and `act(observations)`.

    with avln.begin(server, token, phase, "my-habitat-agent") as run:
        avln.habitat.play(run, agent, keys=["rgb", "depth", "gps", "compass"])

Habitat itself is not required.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Callable, Protocol

import numpy as np

from avln.action import Action
from avln.errors import UnknownActionError
from avln.mission import Goal, Modality
from avln.spectrogram import Padding, spectrogram

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from avln.mission import Mission
    from avln.observation import Observation, Pose
    from avln.play import Episode, Play
    from avln.summary import EpisodeEnd
    from avln.task import TaskSpec

EVALUATION_ACTIONS = (Action.STOP, Action.MOVE_FORWARD, Action.TURN_LEFT, Action.TURN_RIGHT, Action.SUBMIT)
"""Action numbers in the authors' evaluation; the first four are Habitat's."""
TRAINING_ACTIONS = (Action.STOP, Action.SUBMIT, Action.MOVE_FORWARD, Action.TURN_LEFT, Action.TURN_RIGHT)
"""Action numbers in the authors' training, in configuration order."""
_NAMES = {**{action.name: action for action in Action}, "LIFELONG_SUBMIT": Action.SUBMIT}


class HabitatAgent(Protocol):
    """The `habitat.Agent` interface."""

    def reset(self) -> Any:
        """Starts an episode."""

    def act(self, observations: dict[str, Any]) -> Any:
        """Returns an action: a number, a name, or a dictionary with the key `action`."""


@dataclass(frozen=True)
class Senses:
    """Observations in the formats of Habitat and SoundSpaces.

    | key | type and shape | content |
    | --- | --- | --- |
    | `rgb` | u8 [height, width, 3] | colours |
    | `depth` | f32 [height, width, 1] | 0 at `min_depth_m` to 1 at `max_depth_m`; metres without `normalize_depth` |
    | `audiogoal` | f32 [2, samples] | sound of the step, padded with zeros to `audio_samples` |
    | `spectrogram` | f32 [65, 26, 2] | `avln.spectrogram` of `audiogoal` |
    | `gps` | f32 [2] | metres forwards and to the right in the start frame: (-z, x) |
    | `compass` | f32 [1] | heading since the start, radians, -pi to pi, left positive |
    | `pose` | f32 [4] | gps, compass and step number, as in SoundSpaces |
    | `full_pose_sensor` | f32 [7] | x, y, z in metres and the quaternion x, y, z, w, in the pose frame |
    | `goals` | list | per goal `modality` (`object`, `description`, `image`) with `category`, `text` or `image` |
    """

    task: TaskSpec
    """Task rules."""
    keys: tuple[str, ...]
    """Requested entries."""
    min_depth_m: float = 0.0
    """Depth mapped to 0."""
    max_depth_m: float = 10.0
    """Depth mapped to 1, like all larger or missing depths."""
    normalize_depth: bool = True
    """True for depth from 0 to 1, the default in Habitat."""
    audio_samples: int = 0
    """`audiogoal` samples; 0: a second, as in SoundSpaces."""
    padding: Padding = "reflect"
    """Spectrogram padding at both ends."""

    def __post_init__(self) -> None:
        """Checks the keys.

        Raises:
            ValueError: if a key is unknown.
        """
        unknown = [key for key in self.keys if key not in _ENTRIES]
        if unknown:
            raise ValueError(f"select observations: unknown keys {unknown}; use {', '.join(sorted(_ENTRIES))}")

    def observations(self, seen: Observation, start: Pose, mission: Mission) -> dict[str, Any]:
        """Converts an observation; `start` is the episode's start pose."""
        view = _View(self, seen, start, mission)
        return {key: _ENTRIES[key](view) for key in self.keys}


@dataclass(frozen=True)
class _View:
    senses: Senses
    seen: Observation
    start: Pose
    mission: Mission


def _rgb(view: _View) -> NDArray[np.uint8]:
    rgb: NDArray[np.uint8] = _sensed(view.seen.rgb, "rgb")
    return rgb


def _depth(view: _View) -> NDArray[np.float32]:
    senses = view.senses
    seen = _sensed(view.seen.depth, "depth")
    in_range = np.where(seen > 0, seen, senses.max_depth_m)
    metres = np.clip(in_range, senses.min_depth_m, senses.max_depth_m)
    if senses.normalize_depth:
        metres = (metres - senses.min_depth_m) / (senses.max_depth_m - senses.min_depth_m)
    depth: NDArray[np.float32] = metres[..., None].astype(np.float32, copy=False)
    return depth


def _audiogoal(view: _View) -> NDArray[np.float32]:
    audio = _sensed(view.seen.audio, "audio")
    samples = view.senses.audio_samples or view.senses.task.sample_rate_hz
    filled = np.zeros((2, samples), np.float32)
    kept = min(samples, audio.shape[1])
    filled[:, :kept] = audio[:, :kept]
    return filled


def _spectrogram(view: _View) -> NDArray[np.float32]:
    return spectrogram(_audiogoal(view), view.senses.padding)


def _gps(view: _View) -> NDArray[np.float32]:
    here, start = view.seen.pose, view.start
    right_m, back_m = here.x_m - start.x_m, here.z_m - start.z_m
    sine, cosine = math.sin(start.heading_rad), math.cos(start.heading_rad)
    # Rotated about +Y by the negative start heading.
    x_m, z_m = cosine * right_m - sine * back_m, sine * right_m + cosine * back_m
    return np.array([-z_m, x_m], np.float32)


def _compass(view: _View) -> NDArray[np.float32]:
    turned_rad = view.seen.pose.heading_rad - view.start.heading_rad
    return np.array([math.atan2(math.sin(turned_rad), math.cos(turned_rad))], np.float32)


def _pose(view: _View) -> NDArray[np.float32]:
    return np.concatenate([_gps(view), _compass(view), np.array([view.seen.step], np.float32)])


def _full_pose(view: _View) -> NDArray[np.float32]:
    pose = view.seen.pose
    half_rad = pose.heading_rad / 2
    return np.array([pose.x_m, pose.y_m, pose.z_m, 0.0, math.sin(half_rad), 0.0, math.cos(half_rad)], np.float32)


def _goals(view: _View) -> list[dict[str, Any]]:
    return [goal_input(goal) for goal in view.mission.goals]


_ENTRIES: dict[str, Callable[[_View], Any]] = {
    "rgb": _rgb,
    "depth": _depth,
    "audiogoal": _audiogoal,
    "spectrogram": _spectrogram,
    "gps": _gps,
    "compass": _compass,
    "pose": _pose,
    "full_pose_sensor": _full_pose,
    "goals": _goals,
}


def _sensed(array: Any, sensor: str) -> Any:
    if array is None:
        raise ValueError(f"the run has no {sensor}; request it with avln.Sensors({sensor}=True)")
    return array


def goal_input(goal: Goal) -> dict[str, Any]:
    """Returns a goal in the authors' evaluation format."""
    if goal.modality is Modality.CATEGORY:
        return {"modality": "object", "category": goal.text}
    if goal.modality is Modality.DESCRIPTION:
        return {"modality": "description", "text": goal.text}
    return {"modality": "image", "image": goal.image}


def to_action(choice: Any, actions: Sequence[Action] = EVALUATION_ACTIONS) -> Action:
    """Converts an agent's choice to an action.

    A choice is an index in `actions`, a name in any case, or a dictionary with the key `action`.

    Raises:
        UnknownActionError: if the choice is no action.
    """
    named = choice["action"] if isinstance(choice, dict) and "action" in choice else choice
    if isinstance(named, str) and named.upper() in _NAMES:
        return _NAMES[named.upper()]
    try:
        number = int(named)
    except (TypeError, ValueError, OverflowError):
        number = -1
    if not 0 <= number < len(actions):
        numbers = ", ".join(f"{index} {action.name}" for index, action in enumerate(actions))
        raise UnknownActionError(choice, f"{numbers}, or a name")
    return actions[number]


def play(
    run: Play,
    agent: HabitatAgent,
    *,
    keys: Sequence[str] = ("rgb", "depth", "gps", "compass"),
    actions: Sequence[Action] = EVALUATION_ACTIONS,
    stop_submits: bool = False,
    on_end: Callable[[EpisodeEnd], None] | None = None,
    **senses: Any,
) -> None:
    """Plays a run's episodes with a Habitat agent.

    Args:
        run: a slot from `avln.begin`.
        agent: object with `reset()` and `act(observations)`.
        keys: observation entries.
        actions: the agent's action numbers.
        stop_submits: True to treat STOP as a Submit while Submits are left, for single-goal agents.
        on_end: callback for every ended episode.
        **senses: further `Senses` arguments, such as `min_depth_m=0.5`.

    Raises:
        Error: if the server refuses, violates the protocol or the connection is lost.
        ValueError: if a key is unknown or its sensor was not requested.
    """
    view = Senses(run.task, tuple(keys), **senses)
    for episode in run:
        agent.reset()
        for observation in _observations(episode, view):
            action = to_action(agent.act(observation), actions)
            has_submits = episode.observation.remaining_submits > 0
            episode.act(Action.SUBMIT if stop_submits and has_submits and action is Action.STOP else action)
        if on_end is not None and episode.end is not None:
            on_end(episode.end)


def _observations(episode: Episode, view: Senses) -> Iterator[dict[str, Any]]:
    start = episode.observation.pose
    for seen in episode:
        yield view.observations(seen, start, episode.mission)
