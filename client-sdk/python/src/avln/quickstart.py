"""The agent written by `avln-py quickstart`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from avln.errors import Error

if TYPE_CHECKING:
    from pathlib import Path

AGENT = '''\
"""Walks forward if the way is free, otherwise turns; stops with the last step."""

import avln


class Agent:
    def begin(self, task: avln.TaskSpec, mission: avln.Mission) -> None:
        print(mission.order, [goal.text or "an image" for goal in mission.goals])
        self.goals = mission.goals  # goal.text: category or sentence; goal.image: uint8 [height, width, 3]

    def act(self, seen: avln.Observation) -> avln.Action:
        if seen.remaining_steps == 1:
            return avln.Action.STOP
        if self.is_at_goal(seen):
            return avln.Action.SUBMIT if seen.remaining_submits else avln.Action.STOP
        third = len(seen.depth) // 3
        ahead = seen.depth[third:-third, third:-third]  # metres, float32 [height, width]; 0: no surface in range
        is_free = ahead[ahead > 0].min(initial=9) > 0.75
        return avln.Action.MOVE_FORWARD if is_free else avln.Action.TURN_LEFT

    def is_at_goal(self, seen: avln.Observation) -> bool:
        """Insert your detector: compare seen.rgb, seen.depth and seen.audio with self.goals."""
        return False
'''


def write(path: Path) -> None:
    """Writes the agent's file.

    Raises:
        Error: if a different file exists at this path, or the file cannot be written.
    """
    try:
        if path.exists() and path.read_bytes() != AGENT.encode():
            raise Error(f"write an agent to {path}: the file exists already; choose another path with --out")
        path.write_text(AGENT)
    except OSError as error:
        raise Error(f"write an agent to {path}: {error.strerror}; choose another path with --out") from None
