"""Tests of the Gymnasium environments, with Gymnasium's checker and warnings as errors."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from server import CHALLENGE, PHASE

import avln

gymnasium = pytest.importorskip("gymnasium", reason="pip install 'avln[gym]'")

from gymnasium.utils.env_checker import check_env  # noqa: E402

from avln.gym import ENV_ID, GOAL_TEXT_BYTES, LHAVLNEnv, LHAVLNVectorEnv, ObservationSpace  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Iterator

    from conftest import Endpoint

SMALL = avln.Sensors.square(64)
STOP = int(avln.Action.STOP)
LEFT = int(avln.Action.TURN_LEFT)


def make(endpoint: Endpoint, phase: str = PHASE, **options: Any) -> LHAVLNEnv:
    options = {"sensors": SMALL, "goal_side": 32, **options}
    env = gymnasium.make(ENV_ID, server=endpoint.url, token=endpoint.token, phase=phase, **options)
    plain = env.unwrapped
    assert isinstance(plain, LHAVLNEnv)
    return plain


@pytest.fixture
def env(endpoint: Endpoint) -> Iterator[LHAVLNEnv]:
    env = make(endpoint)
    yield env
    env.close()


def test_environment_passes_gymnasium_check(endpoint: Endpoint) -> None:
    env = gymnasium.make(
        ENV_ID,
        server=endpoint.url,
        token=endpoint.token,
        phase=PHASE,
        sensors=SMALL,
        goal_side=32,
        render_mode="rgb_array",
    )
    check_env(env.unwrapped)
    env.close()


@pytest.mark.parametrize("last", ["env.close()", "avln.connection._close_connections()"])
def test_program_with_environment_exits(endpoint: Endpoint, last: str) -> None:
    code = f"""
import avln.connection, gc, grpc, gymnasium
gc.disable()
env = gymnasium.make("avln/LHAVLN-v1", server={endpoint.url!r}, token={endpoint.token!r})
print(sorted(env.reset()[0]))
{last}
# The interpreter's exit waits forever for calls that outlive the gRPC threads.
assert not [known for known in gc.get_objects() if isinstance(known, grpc.RpcError)]
"""
    command = [sys.executable, "-W", "error", "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    assert "'rgb'" in done.stdout


def test_observations_fit_finite_spaces(env: LHAVLNEnv) -> None:
    for name, space in env.observation_space.spaces.items():  # type: ignore[attr-defined]
        if isinstance(space, gymnasium.spaces.Box):
            assert space.is_bounded(), name
    observation, info = env.reset()
    assert observation in env.observation_space
    assert info["order"] == "unordered"
    assert 2 <= len(info["goals"]) <= 4
    for action in (LEFT, int(avln.Action.MOVE_FORWARD), int(avln.Action.SUBMIT)):
        observation, reward, terminated, truncated, info = env.step(action)
        assert observation in env.observation_space
        assert (reward, terminated, truncated, info) == (0.0, False, False, {})


def test_last_step_has_end_reason_and_metrics(env: LHAVLNEnv) -> None:
    env.reset()
    *_, terminated, truncated, info = env.step(STOP)
    assert (terminated, truncated) == (True, False)
    assert info["end_reason"] == "stopped"
    assert "spl" in info["metrics"]
    with pytest.raises(avln.EpisodeOverError):
        env.step(STOP)


def test_practice_repeats_and_seed_restarts_it(env: LHAVLNEnv) -> None:
    firsts = [env.reset(seed=3)[0]["rgb"]]
    firsts += [env.reset()[0]["rgb"] for _ in range(3)]
    np.testing.assert_array_equal(firsts[3], firsts[0])
    assert any((firsts[0] != other).any() for other in firsts[1:3])
    np.testing.assert_array_equal(env.reset(seed=4)[0]["rgb"], firsts[0])


def test_run_token_needs_no_phase(endpoint: Endpoint, client: avln.Client) -> None:
    run = client.start_run(PHASE, "given")
    env = gymnasium.make(ENV_ID, server=endpoint.url, token=run.token, sensors=SMALL, goal_side=32)
    env.reset()
    with pytest.raises(avln.RunOverError, match=f"run {run.id}: reset was called with seed 7, and"):
        env.reset(seed=7)
    env.close()


def test_counted_runs_refuse_seeds_and_end(endpoint: Endpoint) -> None:
    env = make(endpoint, CHALLENGE)
    env.reset()
    with pytest.raises(avln.RunOverError, match="seed 7"):
        env.reset(seed=7)
    env.reset()
    env.reset()
    with pytest.raises(avln.RunOverError, match="challenge"):
        env.reset()
    env.close()


def test_environment_checks_keys_and_options(endpoint: Endpoint) -> None:
    env = make(endpoint, keys=["depth", "pose"], reward=lambda before, action, after: after.step - before.step + action)
    assert list(env.reset()[0]) == ["depth", "pose"]
    assert env.step(LEFT)[1] == 1 + LEFT
    with pytest.raises(ValueError, match="options"):
        env.reset(options={"episode": 3})
    env.close()
    with pytest.raises(ValueError, match="semantic"):
        make(endpoint, keys=["semantic"])


def test_goals_become_arrays_of_fixed_shapes() -> None:
    picture = np.arange(4 * 4 * 3, dtype=np.uint8).reshape(4, 4, 3)
    goals = [avln.Goal(avln.Modality.CATEGORY, text="bed"), avln.Goal(avln.Modality.IMAGE, image=picture)]
    layout = ObservationSpace(avln.TaskSpec(), avln.Sensors(rgb=False, depth=False, audio=False), goal_side=2)
    arrays = layout.mission(avln.Mission(avln.Order.ORDERED, goals))
    assert arrays["order"] == 1
    assert arrays["goal_modality"].tolist() == [1, 3, 0, 0]
    assert arrays["goal_text"].shape == (4, GOAL_TEXT_BYTES)
    assert bytes(arrays["goal_text"][0]).rstrip(b"\0") == b"bed"
    assert not arrays["goal_text"][1].any()
    # Pixels 1 and 3 per side: the centres of the halves.
    np.testing.assert_array_equal(arrays["goal_image"][1], picture[1::2, 1::2])
    assert layout.space.contains(layout.observation(avln.Observation(), arrays))


def vector(endpoint: Endpoint, num_envs: int = 2, phase: str = PHASE) -> LHAVLNVectorEnv:
    envs = gymnasium.make_vec(
        ENV_ID,
        num_envs=num_envs,
        vectorization_mode="vector_entry_point",
        server=endpoint.url,
        token=endpoint.token,
        phase=phase,
        sensors=SMALL,
        goal_side=32,
    )
    assert isinstance(envs.unwrapped, LHAVLNVectorEnv)
    return envs.unwrapped


def test_slots_step_together_and_start_next_episode(endpoint: Endpoint) -> None:
    envs = vector(endpoint)
    observations, infos = envs.reset(seed=1)
    assert observations in envs.observation_space
    assert infos["idle"].tolist() == [False, False]
    observations, rewards, terminated, truncated, _ = envs.step(np.array([LEFT, STOP]))
    assert observations in envs.observation_space
    assert rewards.tolist() == [0.0, 0.0]
    assert terminated.tolist() == [False, True]
    assert truncated.tolist() == [False, False]
    assert observations["pose"][0, 3] == pytest.approx(np.radians(30), abs=1e-6)
    observations, *_, infos = envs.step(np.array([LEFT, LEFT]))
    assert infos["_order"].tolist() == [False, True], "the second slot began the next episode"
    assert observations["remaining"][:, 0].tolist() == [998, 1000]
    envs.close()


def test_slots_without_episode_are_idle_until_restart(endpoint: Endpoint) -> None:
    envs = vector(endpoint)
    envs.reset(seed=1)
    idle = [envs.step(np.array([STOP, STOP]))[4]["idle"].tolist() for _ in range(4)]
    # Both slots stop; one begins the third episode and stops; a new run begins.
    assert idle == [[False, False], [False, True], [False, True], [False, False]]
    envs.close()


def test_vector_ends_after_counted_run(endpoint: Endpoint) -> None:
    envs = vector(endpoint, 3, CHALLENGE)
    envs.reset()
    envs.step(np.array([STOP] * 3))
    with pytest.raises(avln.RunOverError):
        envs.step(np.array([STOP] * 3))
    envs.close()


def test_too_many_slots_are_rejected(endpoint: Endpoint) -> None:
    with pytest.raises(avln.Error, match="num_envs=4"):
        vector(endpoint, 5)
