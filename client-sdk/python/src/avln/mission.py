"""An episode's mission."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from avln.action import Order
from avln.codec import CodecError, decode_rgb
from avln.errors import ProtocolError
from avln.v1 import common_pb2

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from avln.v1 import task_pb2

_ORDERS = {common_pb2.ORDER_ORDERED: Order.ORDERED, common_pb2.ORDER_UNORDERED: Order.UNORDERED}


class Modality(enum.IntEnum):
    """Kind of a goal cue."""

    CATEGORY = 1
    """The target's category label."""
    DESCRIPTION = 2
    """A sentence that matches only the target."""
    IMAGE = 3
    """A target image."""


@dataclass(frozen=True, eq=False)
class Goal:
    """A goal, described by a cue."""

    modality: Modality
    """Kind of the cue."""
    text: str = ""
    """Category label or sentence; empty for an image."""
    image: NDArray[np.uint8] | None = None
    """Image, u8 [height, width, 3], RGB, first row on top, read-only; None for text."""

    @classmethod
    def from_wire(cls, goal: task_pb2.Goal) -> Goal:
        """Converts a goal message.

        Raises:
            ProtocolError: if the cue is unknown to this client.
        """
        cue = goal.WhichOneof("cue")
        if cue == "category":
            return cls(Modality.CATEGORY, text=goal.category)
        if cue == "description":
            return cls(Modality.DESCRIPTION, text=goal.description)
        if cue == "image":
            return cls(Modality.IMAGE, image=_picture(goal.image))
        raise ProtocolError("a goal has no cue known to this client")


@dataclass(frozen=True, eq=False)
class Mission:
    """An episode's mission."""

    order: Order = Order.UNORDERED
    """Goal order."""
    goals: list[Goal] = field(default_factory=list)
    """2 to 4 goals."""

    @classmethod
    def from_wire(cls, mission: task_pb2.Mission) -> Mission:
        """Converts a mission message.

        Raises:
            ProtocolError: if the order or a goal cue is unknown to this client.
        """
        if mission.order not in _ORDERS:
            raise ProtocolError(f"order {mission.order} does not exist")
        return cls(_ORDERS[mission.order], [Goal.from_wire(goal) for goal in mission.goals])


def _picture(tensor: common_pb2.Tensor) -> NDArray[np.uint8]:
    shape = tuple(tensor.shape)
    is_raw = tensor.encoding == common_pb2.ENCODING_RAW and tensor.dtype == common_pb2.DTYPE_U8
    if len(shape) != 3 or shape[2] != 3 or not is_raw:
        raise ProtocolError(f"goal image: expected raw bytes with shape [height, width, 3], got {shape}")
    try:
        return decode_rgb(tensor.encoding, tensor.data, shape[0], shape[1])
    except CodecError as error:
        raise ProtocolError(f"goal image of {shape[1]} x {shape[0]} pixels: {error}") from None
