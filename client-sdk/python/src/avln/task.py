"""Sensors and task rules."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

from avln.errors import ProtocolError, SensorsError
from avln.v1 import common_pb2, task_pb2

if TYPE_CHECKING:
    from avln.packing import Packing

_SIDES = range(64, 1025)
_HFOV_RAD = (0.35, 2.4)
_POSITIVE = (
    "forward_m",
    "turn_deg",
    "step_s",
    "max_steps",
    "hfov_rad",
    "depth_max_m",
    "sample_rate_hz",
    "success_radius_m",
)


@dataclass(frozen=True)
class Sensors:
    """Requested sensors. Other sensors are not rendered or sent; the pose is always included."""

    rgb: bool = True
    """True to request colour images."""
    depth: bool = True
    """True to request depth images."""
    audio: bool = True
    """True to request sound."""
    width: int = 256
    """Pixels in a row, 64 to 1024."""
    height: int = 256
    """Rows, 64 to 1024."""
    hfov_rad: float = math.pi / 2
    """Horizontal view angle, radians, 0.35 to 2.4."""

    @classmethod
    def square(cls, side: int) -> Sensors:
        """All sensors at `side` x `side` pixels with a view of 90 degrees."""
        return cls(width=side, height=side)

    def kinds(self) -> list[common_pb2.SensorKind]:
        """Returns the requested sensor kinds."""
        wanted = [
            (self.rgb, common_pb2.SENSOR_KIND_RGB),
            (self.depth, common_pb2.SENSOR_KIND_DEPTH),
            (self.audio, common_pb2.SENSOR_KIND_AUDIO),
        ]
        return [kind for is_wanted, kind in wanted if is_wanted]

    def to_wire(self, packing: Packing) -> task_pb2.SensorSubscription:
        """Returns the subscription message.

        Raises:
            SensorsError: if the camera settings are out of range for any server.
        """
        sides_fit = self.width in _SIDES and self.height in _SIDES
        if not (sides_fit and _HFOV_RAD[0] <= self.hfov_rad <= _HFOV_RAD[1]):
            raise SensorsError(self.width, self.height, self.hfov_rad)
        wishes = [task_pb2.SensorWish(kind=kind, encodings=packing.wishes(kind)) for kind in self.kinds()]
        return task_pb2.SensorSubscription(wishes=wishes, width=self.width, height=self.height, hfov_rad=self.hfov_rad)


@dataclass(frozen=True)
class TaskSpec:
    """Rules, fixed for a run.

    Rules with names contain the lower-case word of `avln/v1/task.proto`, such as `start` or
    `camera_to_box`; `unspecified` if missing, `other` if unknown to this client.
    """

    rules: str = "lh-avln-v1"
    """Rule set name and version."""
    forward_m: float = 0.25
    """MOVE_FORWARD length, metres."""
    turn_deg: int = 30
    """TURN_LEFT and TURN_RIGHT angle, degrees; divides 360."""
    step_s: float = 0.25
    """Simulated time per step, seconds."""
    max_steps: int = 1000
    """Most actions in an episode; all five kinds count."""
    body_radius_m: float = 0.1
    """Body radius, metres."""
    body_height_m: float = 1.5
    """Body height, metres."""
    width: int = 256
    """Image width, pixels."""
    height: int = 256
    """Image height, pixels."""
    hfov_rad: float = math.pi / 2
    """Horizontal view angle, radians. Pixels are square, the camera looks level."""
    camera_height_m: float = 1.0
    """Camera height above the base, metres."""
    ear_height_m: float = 1.0
    """Ear height above the base, metres."""
    depth_max_m: float = 10.0
    """Depth sensor range, metres; beyond it depth is 0."""
    sample_rate_hz: int = 16_000
    """Samples per second and ear."""
    audio_samples: int = 4000
    """Samples per ear and observation."""
    samples_per_step: int = 4000
    """Samples per ear and simulated step; the rest is 0."""
    pose_frame: str = "start"
    """Pose frame: `start`, with a zero first pose, or `world`, the scene frame."""
    success_radius_m: float = 2.0
    """Success radius, metres."""
    success_distance: str = "camera_to_box"
    """Success distance definition: `camera_to_box`, `base_to_viewpoint` or `camera_to_mesh`."""
    wrong_submit: str = "keeps_goal"
    """Wrong Submit's effect in an ordered mission: `keeps_goal` or `skips_goal`."""
    extra_submit: str = "ignored"
    """Effect of a Submit without Submits left: `ignored` (uses a step) or `ends_episode`; `unspecified` from
    older servers, where it ends the episode.
    """
    stop_claims: str = "any_open"
    """Goals open to a Stop: `any_open`, as for a Submit, or `last_only`; `unspecified` from older servers,
    where any open goal counts.
    """
    feedback: str = "none"
    """Feedback to a Submit: `none`, `accepted` or `verdict`."""
    sounding: str = "unfinished_in_drawn_order"
    """Sounding schedule: `unfinished_in_drawn_order` or `all_in_goal_order`."""
    sounding_window_steps: int = 25
    """Sounding steps per target and turn."""
    silence: str = "immediate"
    """Silence of a found target: `immediate`, `delayed` (5 to 20 steps after the Submit) or `window_end`
    (at the end of its turn); `unspecified` from older servers, where it is immediate.
    """
    distractor_sources: int = 0
    """Sounding distractors per episode, besides those per goal; see `sounding_sources`."""
    distractor_sources_per_goal: int = 0
    """Sounding distractors per goal of the episode."""
    sound_clip: str = "anonymous"
    """Sound clip assignment: `anonymous`, `by_category` or `distinct`."""
    source_lift_m: float = 0.0
    """Source height above the target centre, metres."""
    depth_noise: str = "none"
    """Depth noise: `none` or `redwood`. The referee and goal images use depth without noise."""
    rgb_noise: str = "none"
    """Colour noise: `none` or `gaussian`."""
    head: str = ""
    """Head model: empty for a rigid sphere with a radius of 8.75 cm and ears at 100 degrees from
    straight ahead, otherwise the hexadecimal BLAKE3 hash of a measured head's SOFA file.
    """

    @property
    def turn_rad(self) -> float:
        """TURN_LEFT and TURN_RIGHT angle, radians."""
        return math.radians(self.turn_deg)

    def sounding_sources(self, goals: int) -> int:
        """Returns the number of sound sources at the start of a mission: targets and distractors, with equal turns."""
        return goals + self.distractor_sources + self.distractor_sources_per_goal * goals

    @classmethod
    def from_wire(cls, task: task_pb2.TaskSpec) -> TaskSpec:
        """Converts a task message.

        Raises:
            ProtocolError: if a number is not positive.
        """
        for name in (*_POSITIVE, "depth_divisor"):
            value = float(getattr(task, name))
            if not (math.isfinite(value) and value > 0):
                raise ProtocolError(f"Welcome.task.{name}: expected a positive number, got {value}")
        facts: dict[str, Any] = {field.name: _fact(task, field.name) for field in fields(cls)}
        return cls(**facts)


_RULES = {
    "pose_frame": task_pb2.PoseFrame,
    "success_distance": task_pb2.DistanceRule,
    "wrong_submit": task_pb2.WrongSubmit,
    "extra_submit": task_pb2.ExtraSubmit,
    "stop_claims": task_pb2.StopClaims,
    "feedback": task_pb2.FeedbackRule,
    "sounding": task_pb2.SoundingRule,
    "silence": task_pb2.SilenceRule,
    "sound_clip": task_pb2.SoundClip,
    "depth_noise": task_pb2.DepthNoise,
    "rgb_noise": task_pb2.RgbNoise,
}


def _fact(task: task_pb2.TaskSpec, name: str) -> object:
    value = getattr(task, name)
    return word(_RULES[name], value) if name in _RULES else value


def word(enum: object, number: int) -> str:
    """Returns the lower-case enum word for a number, without prefix; `other` if unknown."""
    values = {value: name for name, value in enum.items()}  # type: ignore[attr-defined]
    prefix = values[0][: -len("UNSPECIFIED")]
    return values[number][len(prefix) :].lower() if number in values else "other"
