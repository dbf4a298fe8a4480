"""Walks at random: the floor of every leaderboard.

python examples/random_walk.py --token TOKEN
"""

from __future__ import annotations

import random

from shell import main

import avln

CHOICES = [avln.Action.MOVE_FORWARD] * 14 + [avln.Action.TURN_LEFT] * 3 + [avln.Action.TURN_RIGHT] * 3
SUBMIT_CHANCE = 0.01


class RandomWalk:
    """Walks ahead most of the time, turns now and then, submits rarely and stops with its last step."""

    sensors = avln.Sensors(rgb=False, depth=False, audio=False)

    def __init__(self, seed: int = 42) -> None:
        self.rng = random.Random(seed)

    def begin(self, task: avln.TaskSpec, mission: avln.Mission) -> None:
        """Nothing to forget."""

    def act(self, seen: avln.Observation) -> avln.Action:
        """A draw, as long as there are steps and Submits."""
        if seen.remaining_steps == 1:
            return avln.Action.STOP
        if seen.remaining_submits and self.rng.random() < SUBMIT_CHANCE:
            return avln.Action.SUBMIT
        return self.rng.choice(CHOICES)


if __name__ == "__main__":
    main(RandomWalk)
