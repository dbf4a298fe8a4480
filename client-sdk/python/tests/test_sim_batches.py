"""Tests of partial batches and interrupted calls of training environments."""

from __future__ import annotations

import re
import signal
from typing import Any

import numpy as np
import pytest

pytest.importorskip("gymnasium", reason="pip install gymnasium")

from gymnasium.vector import AutoresetMode
from sim_envs import vector

import avln.sim

STOP = int(avln.Action.STOP)

pytestmark = pytest.mark.usefixtures("native_module")


def test_batches_follow_the_order_of_completion() -> None:
    envs = vector(4, batch_size=2)
    envs.reset(seed=1)
    envs.send([0, 1, 2, 0], [0, 1, 2, 3])
    seen: list[int] = []
    for _ in range(2):
        observations, rewards, *_, infos = envs.recv()
        assert observations["pose"].shape == (2, 4)
        assert rewards.shape == (2,)
        seen.extend(infos["env_id"].tolist())
    assert sorted(seen) == [0, 1, 2, 3]
    with pytest.raises(avln.sim.SimError, match="0 steps are running"):
        envs.recv()
    envs.close()


def test_steps_and_resets_follow_partial_batches() -> None:
    envs = vector(2, batch_size=1)
    envs.reset(seed=1)
    envs.send([0], [1])
    envs.recv()
    observations, *_ = envs.step([0, 0])
    assert observations["remaining"][:, 0].tolist() == [999, 998]
    envs.send([0], [0])
    envs.recv()
    observations, _ = envs.reset(options={"reset_mask": np.array([False, True])})
    assert observations["remaining"][:, 0].tolist() == [998, 1000]
    observations, *_ = envs.step([0, 0])
    assert observations["remaining"][:, 0].tolist() == [997, 999]
    envs.close()


def test_partial_batches_have_final_observations() -> None:
    envs = vector(2, batch_size=1, autoreset_mode=AutoresetMode.SAME_STEP, privileged=True)
    envs.reset(seed=1)
    envs.send([STOP], [1])
    observations, _, terminated, _, infos = envs.recv()
    assert terminated.tolist() == [True]
    assert infos["final_obs"][0]["remaining"][0] == 999
    assert infos["final_info"][0]["success"] == 0.0
    assert observations["remaining"][0, 0] == 1000
    envs.close()


def test_wrong_calls_leave_no_step_behind() -> None:
    envs = vector(2)
    envs.reset(seed=1)
    with pytest.raises(avln.sim.SimError, match="0 of 2 environments"):
        envs.step_wait()
    with pytest.raises(ValueError, match=re.escape("`env_ids` is [1, 1]")):
        envs.send([0, 0], [1, 1])
    with pytest.raises(ValueError, match="use equal lists"):
        envs.send([0], [0, 1])
    envs.send([0], [1])
    with pytest.raises(avln.sim.SimError, match=re.escape("[1] have a running step")):
        envs.send([0, 0], [0, 1])
    with pytest.raises(avln.sim.SimError, match="a step is running"):
        envs.step([0, 0])
    observations, _ = envs.reset()
    assert observations["remaining"][:, 0].tolist() == [1000, 1000]
    assert envs.step([0, 0])[0]["remaining"][:, 0].tolist() == [999, 999]
    envs.close()


def test_an_interrupted_reset_changes_no_later_result(monkeypatch: pytest.MonkeyPatch) -> None:
    envs = vector(2)
    envs.reset(seed=1)
    with monkeypatch.context() as interrupted:
        interrupted.setattr(envs, "_received", lambda _count: signal.raise_signal(signal.SIGINT))
        with pytest.raises(KeyboardInterrupt):
            envs.reset()
    observations, _ = envs.reset()
    assert observations["remaining"][:, 0].tolist() == [1000, 1000]
    observations, *_ = envs.step([0, STOP])
    assert observations["remaining"][:, 0].tolist() == [999, 999]
    envs.close()


def test_reward_functions_apply_to_partial_batches() -> None:
    def by_action(observations: dict[str, Any], actions: Any, infos: dict[str, Any]) -> Any:
        assert len(observations["pose"]) == len(actions) == 1
        return 10.0 * infos["env_id"] + actions

    envs = vector(2, batch_size=1, reward=by_action)
    envs.reset(seed=1)
    envs.send([1, 2], [0, 1])
    rewards = sorted(float(envs.recv()[1][0]) for _ in range(2))
    assert rewards == [1.0, 12.0]
    envs.close()
