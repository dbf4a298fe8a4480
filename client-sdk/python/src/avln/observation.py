"""What the sensors deliver after a step."""

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
    """Place and heading of the base of the body. Right-handed, Y up; at heading 0 the agent looks along -Z."""

    x_m: float = 0.0
    """Metres to the right of the frame's origin."""
    y_m: float = 0.0
    """Metres above it."""
    z_m: float = 0.0
    """Metres behind it."""
    heading_rad: float = 0.0
    """Radians about +Y, -pi to pi; positive is a left turn."""


class Feedback(enum.IntEnum):
    """What the agent learns from a Submit."""

    NONE = 0
    """Nothing: no Submit was made, or the rules are silent."""
    ACCEPTED = 1
    """The Submit was counted; nothing is said about the match."""
    CORRECT = 2
    """It completed a goal."""
    WRONG = 3
    """It completed none."""

    @classmethod
    def from_wire(cls, number: int) -> Feedback:
        """The feedback of a number on the wire; NONE where this client does not know it."""
        return cls(number) if number in play_pb2.SubmitFeedback.values() else cls.NONE


@dataclass(frozen=True, eq=False)
class Observation:
    """What the agent senses after a step. Sensors that were not asked for are None; arrays may be read-only."""

    step: int = 0
    """Steps taken so far; 0 is the observation before the first action."""
    rgb: NDArray[np.uint8] | None = None
    """Colours, u8 [height, width, 3], RGB, first row on top."""
    depth: NDArray[np.float32] | None = None
    """Distances along the optical axis, f32 [height, width], metres, first row on top; 0 where nothing is in range."""
    audio: NDArray[np.float32] | None = None
    """Sound pressure during the step, f32 [2, `TaskSpec.audio_samples`], the left ear's first."""
    pose: Pose = Pose()
    """Base of the body, in the frame that `TaskSpec.pose_frame` names."""
    remaining_steps: int = 0
    """Steps that are left."""
    remaining_submits: int = 0
    """Submits that are left before one is final."""
    feedback: Feedback = Feedback.NONE
    """What the rules let the agent know about a Submit made in this step."""
