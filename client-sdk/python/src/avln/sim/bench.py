"""Speed and memory of training environments."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

from avln.sim.vector import VectorEnv

_WARM_UP_STEPS = 100
"""Four turns: every source has sounded once, and is prepared."""
_WALKS = 3
"""Number of actions without Submit and Stop."""


def measure(num_envs: int, threads: int | None, size: int, senses: list[str], seconds: float) -> dict[str, float]:
    """Walks at random for `seconds`; returns steps per second, processor seconds per step, and memory in MiB."""
    envs = VectorEnv(num_envs, threads=threads, size=size, senses=senses, goal_cues=False, reward="none")
    envs.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(_WARM_UP_STEPS):
        envs.step(rng.integers(_WALKS, size=num_envs))
    steps, began_s, began_cpu_s = 0, time.perf_counter(), time.process_time()
    while time.perf_counter() - began_s < seconds:
        envs.step(rng.integers(_WALKS, size=num_envs))
        steps += num_envs
    spent_s, spent_cpu_s = time.perf_counter() - began_s, time.process_time() - began_cpu_s
    memory_mib = _resident_mib()
    envs.close()
    return {"steps_per_s": steps / spent_s, "cpu_s_per_step": spent_cpu_s / steps, "rss_mib": memory_mib}


def _resident_mib() -> float:
    status = Path("/proc/self/status")
    if status.exists():
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmRSS:"))
        return int(line.split()[1]) / 1024
    try:
        import resource  # noqa: PLC0415, not on Windows
    except ModuleNotFoundError:
        return 0.0
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most / (1 << 20 if sys.platform == "darwin" else 1024)
