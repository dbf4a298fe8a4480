"""An agent that moves forward, turns right at obstacles, and submits at regular intervals. It uses the pose only.

python examples/forward_and_turn.py --token TOKEN
"""

from __future__ import annotations

import math

from shell import main

import avln

BLOCKED = 0.5
"""Collision threshold: share of the forward distance."""


class ForwardAndTurn:
    """An agent with the same actions as `avln agent baseline forward-and-turn`."""

    sensors = avln.Sensors(rgb=False, depth=False, audio=False)

    def begin(self, task: avln.TaskSpec, mission: avln.Mission) -> None:
        """Resets the agent for an episode."""
        self.blocked_m = BLOCKED * task.forward_m
        self.share_steps = max(task.max_steps // len(mission.goals), 1)
        self.submits = 0
        self.walked_from: avln.Pose | None = None

    def act(self, seen: avln.Observation) -> avln.Action:
        """Returns Stop for the last step, Submit when due, otherwise a move."""
        if seen.remaining_steps <= 1:
            return avln.Action.STOP
        is_due = seen.step + 1 >= (self.submits + 1) * self.share_steps and seen.remaining_submits > 0
        if is_due:
            self.submits += 1
            self.walked_from = None
            return avln.Action.SUBMIT
        return self.onward(seen.pose)

    def onward(self, pose: avln.Pose) -> avln.Action:
        """Returns a turn after a collision, otherwise a step forward."""
        before, self.walked_from = self.walked_from, None
        if before and math.hypot(pose.x_m - before.x_m, pose.z_m - before.z_m) < self.blocked_m:
            return avln.Action.TURN_RIGHT
        self.walked_from = pose
        return avln.Action.MOVE_FORWARD


if __name__ == "__main__":
    main(ForwardAndTurn)
