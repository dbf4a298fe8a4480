"""Sensor readings after a step."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import TYPE_CHECKING

from avln.v1 import play_pb2

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Pose:
    """Position and heading of the body's base. Right-handed, Y up; heading 0 faces -Z."""

    x_m: float = 0.0
    """Metres to the right of the frame's origin."""
    y_m: float = 0.0
    """Metres above the origin."""
    z_m: float = 0.0
    """Metres behind the origin."""
    heading_rad: float = 0.0
    """Radians about +Y, -pi to pi; positive is a left turn."""


class Feedback(enum.IntEnum):
    """Feedback to a Submit."""

    NONE = 0
    """No Submit, or no feedback by the rules."""
    ACCEPTED = 1
    """The Submit was counted; the verdict is hidden."""
    CORRECT = 2
    """The Submit completed a goal."""
    WRONG = 3
    """The Submit completed no goal."""

    @classmethod
    def from_wire(cls, number: int) -> Feedback:
        """Returns the feedback for a wire number; NONE if unknown."""
        return cls(number) if number in play_pb2.SubmitFeedback.values() else cls.NONE


@dataclass(frozen=True, eq=False)
class Observation:
    """Sensor readings after a step. Sensors not requested are None; arrays may be read-only."""

    step: int = 0
    """Steps taken; 0 before the first action."""
    rgb: NDArray[np.uint8] | None = None
    """Colours, u8 [height, width, 3], RGB, first row on top."""
    depth: NDArray[np.float32] | None = None
    """Planar depth, f32 [height, width], metres, first row on top; 0 without a hit in range."""
    audio: NDArray[np.float32] | None = None
    """Sound pressure during the step, f32 [2, `TaskSpec.audio_samples`], left ear first."""
    pose: Pose = Pose()
    """Base pose in the frame `TaskSpec.pose_frame`."""
    remaining_steps: int = 0
    """Remaining steps."""
    remaining_submits: int = 0
    """Remaining Submits, N - 1 at the start of a mission with N goals. At 0, claim the last goal with Stop."""
    feedback: Feedback = Feedback.NONE
    """Feedback to a Submit in this step."""
