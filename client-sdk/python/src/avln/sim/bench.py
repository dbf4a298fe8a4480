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


def measure(
    num_envs: int, threads: int | None, size: int, senses: list[str], seconds: float, batch_size: int | None = None
) -> dict[str, float]:
    """Walks at random for `seconds`; returns steps per second, processor seconds per step, and memory in MiB.

    With `batch_size`, the walk uses `send` and `recv`.
    """
    envs = VectorEnv(
        num_envs, threads=threads, batch_size=batch_size, size=size, senses=senses, goal_cues=False, reward="none"
    )
    envs.reset(seed=0)
    walk = _step if batch_size is None else _receive_and_send
    rng = np.random.default_rng(0)
    for _ in range(_WARM_UP_STEPS):
        _step(envs, rng)
    if batch_size is not None:
        envs.send(rng.integers(_WALKS, size=num_envs), np.arange(num_envs))
    steps, began_s, began_cpu_s = 0, time.perf_counter(), time.process_time()
    while time.perf_counter() - began_s < seconds:
        steps += walk(envs, rng)
    spent_s, spent_cpu_s = time.perf_counter() - began_s, time.process_time() - began_cpu_s
    memory_mib = _resident_mib()
    envs.close()
    return {"steps_per_s": steps / spent_s, "cpu_s_per_step": spent_cpu_s / steps, "rss_mib": memory_mib}


def _step(envs: VectorEnv, rng: np.random.Generator) -> int:
    envs.step(rng.integers(_WALKS, size=envs.num_envs))
    return envs.num_envs


def _receive_and_send(envs: VectorEnv, rng: np.random.Generator) -> int:
    ids = envs.recv()[4]["env_id"]
    envs.send(rng.integers(_WALKS, size=len(ids)), ids)
    return len(ids)


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
