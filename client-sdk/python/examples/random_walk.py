"""An agent with random actions: the lower bound of every leaderboard.

python examples/random_walk.py --token TOKEN
"""

from __future__ import annotations

import random

from shell import main

import avln

CHOICES = [avln.Action.MOVE_FORWARD] * 14 + [avln.Action.TURN_LEFT] * 3 + [avln.Action.TURN_RIGHT] * 3
SUBMIT_CHANCE = 0.01


class RandomWalk:
    """An agent that mostly moves forward, sometimes turns, rarely submits, and stops with the last step."""

    sensors = avln.Sensors(rgb=False, depth=False, audio=False)

    def __init__(self, seed: int = 42) -> None:
        self.rng = random.Random(seed)

    def begin(self, task: avln.TaskSpec, mission: avln.Mission) -> None:
        """Does nothing: the agent has no state."""

    def act(self, seen: avln.Observation) -> avln.Action:
        """Draws an action within the remaining steps and Submits."""
        if seen.remaining_steps == 1:
            return avln.Action.STOP
        if seen.remaining_submits and self.rng.random() < SUBMIT_CHANCE:
            return avln.Action.SUBMIT
        return self.rng.choice(CHOICES)


if __name__ == "__main__":
    main(RandomWalk)
