"""Exponential backoff with jitter."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from avln.errors import Error

_FIRST_S = 0.05
_LONGEST_S = 2.0
# Longest accepted delay, so that a wrong value cannot stop a client for hours.
_LONGEST_DELAY_S = 300.0


class Backoff:
    """Pauses between attempts to reach a server."""

    def __init__(self) -> None:
        self._pause_s = _FIRST_S

    def after(self, error: Error) -> float:
        """Returns the pause after a failure in seconds, and doubles the next pause.

        A delay requested by the server is a lower bound.
        """
        delay_s = min(float(error.retry_after_s or 0), _LONGEST_DELAY_S)
        # After a restart all clients lose their stream at the same moment. Without jitter they would return in lockstep
        # and overload the server again, also after an equal delay.
        pause_s = delay_s + self._pause_s * random.uniform(0.5, 1.0)
        self._pause_s = min(2 * self._pause_s, _LONGEST_S)
        return pause_s
