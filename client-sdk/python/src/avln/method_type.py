"""Method types."""

from __future__ import annotations

import enum
from typing import cast

from avln.v1 import run_pb2 as v1


class MethodType(enum.Enum):
    """A method's type, declared by `Client.start_run` and shown on the leaderboard."""

    TRAINING_FREE = "training-free"
    """Without learnt parts."""
    LEARNT_PERCEPTION = "learnt-perception"
    """Learnt perception, such as a network trained on training houses; the decisions are not learnt."""
    FOUNDATION_MODELS = "foundation-models"
    """Foundation models: large detectors, encoders or language models trained on other data."""
    IMITATION = "imitation"
    """A policy learnt by imitation of demonstrations."""
    RL = "rl"
    """A policy learnt by reinforcement learning."""

    @classmethod
    def _missing_(cls, value: object) -> MethodType:
        known = ", ".join(member.value for member in cls)
        raise ValueError(f"method type {value!r} does not exist; use one of: {known}")

    def to_wire(self) -> v1.MethodType:
        """Returns the wire number."""
        return cast("v1.MethodType", v1.MethodType.Value(f"METHOD_TYPE_{self.name}"))

    @classmethod
    def from_wire(cls, number: int) -> MethodType | None:
        """Returns the type for a wire number; None if it is undeclared or unknown to this client."""
        return next((member for member in cls if member.to_wire() == number), None)
