"""Small training environments for tests."""

from __future__ import annotations

from typing import Any

import avln.sim

SMALL: dict[str, Any] = {
    "curriculum": avln.sim.Curriculum(goals=(1, 2), distance_m=(1.0, 100.0), rooms=(3, 4), storeys=(1, 1)),
    "size": 64,
    "goal_side": 16,
    "scenes": 1,
}


def vector(num_envs: int = 3, **options: Any) -> avln.sim.VectorEnv:
    # Without sound, whose sources take most of the preparation.
    return avln.sim.VectorEnv(num_envs, **{**SMALL, "threads": 2, "senses": ("rgb", "depth"), **options})
