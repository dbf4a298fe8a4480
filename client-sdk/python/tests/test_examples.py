"""Tests of the examples: runs, maps, bearings."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from audio_follower import AudioFollower, bearing_rad, delay_s
from frontier import FREE, Frontier, Map
from random_walk import RandomWalk
from server import PHASE

import avln

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Endpoint

RATE_HZ = 16_000


class Short:
    """An agent that stops after some steps."""

    def __init__(self, agent: Any, steps: int) -> None:
        self.agent, self.steps = agent, steps

    def begin(self, task: avln.TaskSpec, mission: avln.Mission) -> None:
        self.agent.begin(task, mission)

    def act(self, seen: avln.Observation) -> avln.Action:
        action = avln.Action(self.agent.act(seen))
        return avln.Action.STOP if seen.step >= self.steps else action


@pytest.mark.parametrize("agent", [RandomWalk, AudioFollower, Frontier])
def test_example_plays_run(client: avln.Client, agent: Any) -> None:
    run = client.start_run(PHASE, agent.__name__)
    summary = avln.evaluate(client, run, Short(agent(), 30), agent.sensors)
    assert summary.complete


def heard(lead_samples: int) -> Any:
    """Returns noise that reaches the left ear `lead_samples` earlier."""
    noise = np.random.default_rng(1).normal(size=4100).astype(np.float32)
    return np.stack([noise[50 + lead_samples : 4050 + lead_samples], noise[50:4050]])


def test_bearing_follows_ear_delay() -> None:
    assert delay_s(heard(4), RATE_HZ) == pytest.approx(-4 / RATE_HZ, abs=1e-5)
    # 4 samples are 0.25 ms: 0.0875 / 343 (a + sin a) = 0.00025 for a = 0.4973.
    assert bearing_rad(heard(4), RATE_HZ) == pytest.approx(0.497, abs=0.01)
    assert bearing_rad(heard(-4), RATE_HZ) == pytest.approx(-0.497, abs=0.01)
    assert bearing_rad(heard(0), RATE_HZ) == pytest.approx(0.0, abs=0.01)


def test_map_is_free_up_to_wall() -> None:
    task = avln.TaskSpec(width=64, height=64)
    drawn = Map(task)
    drawn.see(avln.Pose(heading_rad=math.pi / 2), np.full((64, 64), 2.0, np.float32))
    # The agent faces -X, with a wall two metres ahead.
    assert drawn.cells[drawn.cell(-1.0, 0.0)] == FREE
    assert drawn.cells[drawn.cell(-2.0, 0.0)] != FREE
    assert drawn.cells[drawn.cell(1.0, 0.0)] == 0
    way = drawn.path_to_frontier(drawn.cell(0.0, 0.0))
    assert way[0] == drawn.cell(0.0, 0.0)
    assert len(way) > 1


def test_ppo_trains_on_practice(endpoint: Endpoint, tmp_path: Path) -> None:
    stable_baselines3 = pytest.importorskip("stable_baselines3", reason="pip install 'avln[sb3]'")
    from sb3_ppo import main  # noqa: PLC0415

    out = tmp_path / "ppo.zip"
    connection = ["--server", endpoint.url, "--token", endpoint.token, "--phase", PHASE]
    main([*connection, "--steps", "2000", "--out", str(out)])
    assert stable_baselines3.PPO.load(out).num_timesteps >= 2000


def test_torch_policy_plays_slots_in_one_batch(client: avln.Client) -> None:
    pytest.importorskip("torch", reason="pip install 'avln[torch]'")
    from torch_policy import SENSORS, Policy, play_slots  # noqa: PLC0415

    plays = client.play_slots(client.start_run(PHASE, "torch"), 2, SENSORS)
    assert play_slots(plays, Policy().eval()).complete


def test_torch_policy_keeps_to_remaining_submits() -> None:
    torch = pytest.importorskip("torch", reason="pip install 'avln[torch]'")
    from torch_policy import SIDE, Policy, choose  # noqa: PLC0415

    def episode(submits: int, steps: int) -> Any:
        rgb, depth = np.zeros((SIDE, SIDE, 3), np.uint8), np.zeros((SIDE, SIDE), np.float32)
        seen = avln.Observation(rgb=rgb, depth=depth, remaining_steps=steps, remaining_submits=submits)
        return SimpleNamespace(observation=seen, task=avln.TaskSpec())

    policy = Policy().eval()
    torch.nn.init.constant_(policy.head.bias[avln.Action.SUBMIT], 99.0)
    episodes = [episode(1, 9), episode(0, 9), episode(1, 1)]
    first, second, last = choose(policy, episodes, torch.Generator().manual_seed(1))
    assert (first, last) == (avln.Action.SUBMIT, avln.Action.STOP)
    assert second != avln.Action.SUBMIT
