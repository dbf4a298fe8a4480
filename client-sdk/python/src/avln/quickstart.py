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
    sensors = avln.Sensors.square(128)

    def begin(self, task: avln.TaskSpec, mission: avln.Mission) -> None:
        self.reach_m = 3 * task.forward_m
        print([goal.text or "an image" for goal in mission.goals])

    def act(self, seen: avln.Observation) -> avln.Action:
        if seen.remaining_steps == 1:
            return avln.Action.STOP
        rows, columns = seen.depth.shape
        ahead = seen.depth[rows // 3 : 2 * rows // 3, columns // 3 : 2 * columns // 3]
        is_free = ahead[ahead > 0].min(initial=self.reach_m + 1) > self.reach_m
        return avln.Action.MOVE_FORWARD if is_free else avln.Action.TURN_LEFT
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
