"""Actions, orders and end reasons."""

from __future__ import annotations

import enum
from typing import cast

from avln.v1 import common_pb2 as v1


class Action(enum.IntEnum):
    """An agent's action; the value is the index in action spaces. Every action uses a step."""

    MOVE_FORWARD = 0
    """Move forward by `TaskSpec.forward_m`, sliding at walls."""
    TURN_LEFT = 1
    """Turn left by `TaskSpec.turn_rad` on the spot."""
    TURN_RIGHT = 2
    """Turn right by `TaskSpec.turn_rad` on the spot."""
    SUBMIT = 3
    """Report a goal at this position. `TaskSpec.extra_submit` defines the effect without Submits left."""
    STOP = 4
    """Report the last goal and end the episode."""

    def to_wire(self) -> v1.Action:
        """Returns the wire number: the index plus 1."""
        return cast("v1.Action", v1.Action.Value(f"ACTION_{self.name}"))


class Order(enum.Enum):
    """Goal order."""

    ORDERED = "ordered"
    """Goals count only in the given order."""
    UNORDERED = "unordered"
    """Goals count in any order."""

    def to_wire(self) -> v1.Order:
        """Returns the wire number."""
        return cast("v1.Order", v1.Order.Value(f"ORDER_{self.name}"))


class EndReason(enum.Enum):
    """Cause of an episode's end."""

    STOPPED = "stopped"
    """The agent chose Stop."""
    FINAL_SUBMIT = "final submit"
    """The agent sent a Submit without Submits left, under `ends_episode`."""
    STEP_LIMIT = "step limit"
    """The step limit was reached."""
    TIME_BUDGET = "time budget"
    """The run's time budget or wall time was used up."""
    ABANDONED = "abandoned"
    """The agent abandoned the episode."""
    DISCONNECTED = "disconnected"
    """The agent disconnected and did not resume in time."""
    SERVER_FAULT = "server fault"
    """The server failed; the episode does not count."""
    OTHER = "another reason"
    """A reason unknown to this client."""

    @classmethod
    def from_wire(cls, number: int) -> EndReason:
        """Returns the reason for a wire number."""
        if number in v1.EndReason.values():
            name = v1.EndReason.Name(number).replace("END_REASON_", "", 1)
            return cls.__members__.get(name, cls.OTHER)
        return cls.OTHER
