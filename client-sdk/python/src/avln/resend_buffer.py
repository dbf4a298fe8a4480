"""Sent and received frames per slot, for resuming after a lost connection."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Union

from avln.v1 import common_pb2, play_pb2

if TYPE_CHECKING:
    from collections.abc import Iterable

Sent = Union[play_pb2.Ready, play_pb2.Act, play_pb2.Abandon]
"""Frames to which the server replies."""
Arrived = Union[play_pb2.EpisodeStart, play_pb2.Observation, play_pb2.EpisodeEnd, play_pb2.Fault, play_pb2.RunEnd]
"""Replies to `Sent` frames, and ends."""


@dataclass
class _Slot:
    """A slot from the client's perspective."""

    episode: str = ""
    """Open episode; may be empty."""
    step: int = 0
    """Step in the last received observation."""
    open: Sent | None = None
    """Unanswered frame."""


class ResendBuffer:
    """A run's slots from the client's perspective."""

    def __init__(self, slots: int) -> None:
        self._slots = [_Slot() for _ in range(slots)]
        self.is_over = False
        """True if the run has ended."""
        self.said_goodbye = False
        """True if the client has ended the run."""

    def sending(self, frame: Sent) -> None:
        """Records a frame before it is sent."""
        self._slots[frame.slot].open = frame

    def arrived(self, frame: Arrived) -> bool:
        """Records a received frame; returns False for a duplicate."""
        if isinstance(frame, play_pb2.RunEnd):
            self.is_over = True
            return True
        slot = self._slot(frame)
        if slot is None:
            return True
        if isinstance(frame, play_pb2.EpisodeStart):
            slot.episode, slot.step, slot.open = frame.episode, frame.observation.step, None
        elif isinstance(frame, play_pb2.Observation):
            return _observed(slot, frame)
        elif isinstance(frame, play_pb2.EpisodeEnd) and frame.episode == slot.episode:
            slot.episode, slot.step, slot.open = "", 0, None
        elif isinstance(frame, play_pb2.Fault) and frame.recoverable:
            slot.open = None
        return True

    def known(self) -> list[play_pb2.SlotPosition]:
        """Returns the last received steps for Hello."""
        return [
            play_pb2.SlotPosition(slot=number, episode=slot.episode, step=slot.step)
            for number, slot in enumerate(self._slots)
            if slot.episode
        ]

    def to_repeat(self, resumed: Iterable[play_pb2.SlotPosition]) -> list[Sent]:
        """Returns the frames to resend, given the server's slot positions."""
        there = {position.slot: position for position in resumed}
        return [
            slot.open
            for number, slot in enumerate(self._slots)
            if slot.open is not None and _is_unanswered(slot.open, there.get(number))
        ]

    def is_gone(self, fault: play_pb2.Fault) -> bool:
        """Returns True if a fault reports a slot's lost episode."""
        slot = self._slot(fault)
        is_unknown = fault.reason == common_pb2.REASON_EPISODE_UNKNOWN
        return is_unknown and slot is not None and bool(slot.episode) and slot.episode == fault.episode

    def _slot(self, frame: Arrived) -> _Slot | None:
        if isinstance(frame, play_pb2.RunEnd):
            return None
        if isinstance(frame, play_pb2.Fault) and not frame.HasField("slot"):
            return None
        return self._slots[frame.slot] if frame.slot < len(self._slots) else None


def _observed(slot: _Slot, seen: play_pb2.Observation) -> bool:
    if seen.episode != slot.episode:
        return True
    if seen.step <= slot.step:
        return False
    slot.step, slot.open = seen.step, None
    return True


def _is_unanswered(frame: Sent, there: play_pb2.SlotPosition | None) -> bool:
    if isinstance(frame, play_pb2.Ready):
        return there is None
    if there is None:
        return False
    if isinstance(frame, play_pb2.Act):
        return frame.episode == there.episode and frame.step == there.step + 1
    return True
