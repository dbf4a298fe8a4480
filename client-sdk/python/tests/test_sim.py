"""Tests of training environments in process."""

from __future__ import annotations

import json
import os
import re
import sys
import time
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium", reason="pip install gymnasium")

from gymnasium.utils.env_checker import check_env  # noqa: E402
from gymnasium.vector import AutoresetMode  # noqa: E402
from sim_envs import SMALL, vector  # noqa: E402

import avln.sim  # noqa: E402
from avln.cli import main  # noqa: E402

STOP = int(avln.Action.STOP)
CHEAP = ("lidar", "ears", "map")
GROUPS = ("targets", "ids", "top_down")


pytestmark = pytest.mark.usefixtures("native_module")


def copied(arrays: dict[str, Any]) -> dict[str, Any]:
    return {name: np.copy(array) for name, array in arrays.items()}


def assert_equal(one: dict[str, Any], other: dict[str, Any]) -> None:
    assert one.keys() == other.keys()
    for name, array in one.items():
        assert np.array_equal(array, other[name]), name


def test_gymnasium_checker_accepts_the_environment() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        options = {
            **SMALL,
            "senses": ("rgb", "depth", "audio", *CHEAP),
            "privileged": GROUPS,
            "render_mode": "rgb_array",
        }
        env = gymnasium.make("avln/LHAVLNTrain-v1", disable_env_checker=True, **options)
        check_env(env.unwrapped)
    env.reset(seed=1)
    assert env.render().shape == (512, 1024, 3)
    env.close()


def test_registered_vector_has_all_environments() -> None:
    envs = gymnasium.make_vec("avln/LHAVLNTrain-v1", num_envs=2, **SMALL)
    observations, _ = envs.reset(seed=3)
    assert observations["rgb"].shape == (2, 64, 64, 3)
    assert envs.observation_space.contains(observations)
    envs.close()


def test_threads_do_not_change_bits() -> None:
    played = []
    for threads in (1, 3):
        envs = vector(threads=threads, privileged=True, senses=("rgb", "depth", "audio", *CHEAP))
        observations, infos = envs.reset(seed=5)
        for actions in ([0, 1, 2], [0, 0, 3], [STOP, 0, 0], [0, 0, 0]):
            observations, rewards, terminated, truncated, infos = envs.step(actions)
        played.append({**copied(observations), **copied(infos), "r": rewards, "te": terminated, "tr": truncated})
        envs.close()
    assert_equal(*played)


@pytest.mark.parametrize("order", ["ordered", "unordered"])
def test_number_of_environments_does_not_change_episodes(order: str) -> None:
    played = [whole_episode(order, *size) for size in ((1, 1), (7, 16), (64, 3))]
    assert played[0][-1]["success"] == 1
    assert_equal_episodes(played)


@pytest.mark.parametrize("order", ["ordered", "unordered"])
def test_images_and_sounds_of_whole_episodes_are_equal(order: str) -> None:
    options: dict[str, Any] = {"senses": ("rgb", "depth", "audio"), "goal_cues": True}
    assert_equal_episodes([whole_episode(order, *size, **options) for size in ((1, 1), (7, 16), (64, 2))])


def assert_equal_episodes(played: list[list[dict[str, Any]]]) -> None:
    for other in played[1:]:
        assert len(other) == len(played[0])
        for step, same in zip(played[0], other):
            assert_equal(step, same)


def whole_episode(order: str, num_envs: int, threads: int, **options: Any) -> list[dict[str, Any]]:
    """Rows and flags of the first environment, of each step of the teacher."""
    curriculum = replace(SMALL["curriculum"], order=order)
    options = {"senses": ("depth", *CHEAP), "goal_cues": False, **options}
    envs = vector(num_envs, threads=threads, curriculum=curriculum, privileged=True, **options)
    _, infos = envs.reset(seed=5)
    steps: list[dict[str, Any]] = [{"over": False}]
    while not steps[-1]["over"]:
        observations, rewards, terminated, truncated, infos = envs.step(infos["expert"])
        first = {name: array[0].copy() for name, array in {**observations, **infos}.items()}
        steps.append({**first, "reward": rewards[0], "over": terminated[0] or truncated[0]})
    envs.close()
    return steps[1:]


def test_arrays_are_aligned_for_jax() -> None:
    envs = vector(3)
    observations, _ = envs.reset(seed=1)
    for name, array in observations.items():
        assert array.ctypes.data % 64 == 0, name
    envs.close()


def test_arrays_are_shared_with_jax() -> None:
    jax = pytest.importorskip("jax", reason="pip install jax")
    envs = vector(3)
    observations, _ = envs.reset(seed=1)
    # By default, JAX converts int64 to int32.
    for name, array in ((name, array) for name, array in observations.items() if array.dtype != np.int64):
        shared = jax.dlpack.from_dlpack(array)
        assert shared.unsafe_buffer_pointer() == array.ctypes.data, name
    envs.close()


def test_arrays_are_shared_with_torch() -> None:
    torch = pytest.importorskip("torch", reason="pip install torch")
    envs = vector(1, senses=("depth",))
    observations, _ = envs.reset(seed=1)
    tensor = torch.from_dlpack(observations["depth"])
    assert tensor.data_ptr() == observations["depth"].__array_interface__["data"][0]
    envs.close()


def test_seeds_determine_the_episodes() -> None:
    envs = vector()
    first = copied(envs.reset(seed=1)[0])
    other = copied(envs.reset(seed=2)[0])
    assert_equal(first, envs.reset(seed=1)[0])
    assert any(not np.array_equal(first[name], other[name]) for name in first)
    envs.close()


def test_teacher_completes_a_mission() -> None:
    env = avln.sim.Env(privileged=True, senses=("depth",), **SMALL)
    _, info = env.reset(seed=4)
    rewards, terminated, truncated = 0.0, False, False
    while not (terminated or truncated):
        _, reward, terminated, truncated, info = env.step(info["expert"])
        rewards += reward
    assert terminated
    assert info["success"] == 1.0
    assert info["spl"] > 0.7
    assert rewards > 15.0
    with pytest.raises(avln.sim.SimError, match="the episode ended"):
        env.step(0)
    env.close()


def test_same_step_returns_the_final_observation() -> None:
    envs = vector(autoreset_mode=AutoresetMode.SAME_STEP, privileged=True)
    envs.reset(seed=1)
    observations, _, terminated, _, infos = envs.step([0, STOP, 0])
    assert terminated.tolist() == [False, True, False]
    assert infos["_final_obs"].tolist() == [False, True, False]
    assert infos["final_obs"][1]["remaining"][0] == 999
    assert observations["remaining"][:, 0].tolist() == [999, 1000, 999]
    assert infos["final_info"][1]["success"] == 0.0
    envs.close()


def test_next_step_resets_in_the_following_step() -> None:
    envs = vector()
    envs.reset(seed=1)
    observations, _, terminated, _, _ = envs.step([STOP, 0, 0])
    assert terminated.tolist() == [True, False, False]
    observations, rewards, terminated, _, _ = envs.step([0, 0, 0])
    assert observations["remaining"][:, 0].tolist() == [1000, 998, 998]
    assert (rewards[0], terminated[0]) == (0.0, False)
    envs.close()


def test_observations_stay_valid_for_one_more_step() -> None:
    envs = vector()
    envs.reset(seed=1)
    before = envs.step([0, 0, 0])[0]
    kept = copied(before)
    envs.step([1, 1, 1])
    assert_equal(before, kept)
    envs.close()


def test_states_are_restored_exactly() -> None:
    envs = vector(2, privileged=True, senses=("depth", "audio", *CHEAP))
    envs.reset(seed=6)
    for actions in ([0, 1], [0, 0], [2, 0]):
        envs.step(actions)
    state = envs.state(0)
    first = [copied(part) for part in envs.step([0, 0])[::4]]
    envs.restore(0, state)
    again = [copied(part) for part in envs.step([0, 0])[::4]]
    for one, other in zip(first, again):
        assert_equal({name: part[0] for name, part in one.items()}, {name: part[0] for name, part in other.items()})
    with pytest.raises(ValueError, match="cannot restore the state"):
        envs.restore(0, b"{}")
    with pytest.raises(ValueError, match="environment 2 does not exist"):
        envs.state(2)
    envs.close()


def test_bounds_are_those_of_the_rules() -> None:
    envs = vector(1, senses=("depth", "lidar"))
    space = envs.single_observation_space
    assert isinstance(space, gymnasium.spaces.Dict)
    for name, most in (("depth", 10.0), ("lidar", 10.0), ("remaining", 1000)):
        box = space[name]
        assert isinstance(box, gymnasium.spaces.Box)
        assert box.high.max() == most
    envs.close()


def test_cheap_senses_have_documented_shapes() -> None:
    envs = vector(2, senses=CHEAP)
    observations, _ = envs.reset(seed=1)
    assert envs.observation_space.contains(observations)
    assert {"rgb", "depth", "audio"}.isdisjoint(observations)
    shapes = {name: (observations[name].shape, observations[name].dtype.name) for name in CHEAP}
    assert shapes == {
        "lidar": ((2, 72), "float32"),
        "ears": ((2, 15), "float32"),
        "map": ((2, 32, 32), "uint8"),
    }
    assert re.fullmatch("[0-9a-f]{16}", envs.observation_digest)
    with_depth = vector(2, senses=("depth", *CHEAP))
    assert with_depth.observation_digest != envs.observation_digest
    with_depth.close()
    envs.close()


def test_half_pixel_images_are_close_to_exact_ones() -> None:
    exact, coarse = (vector(1, size=64, senses=("depth",), detail=detail) for detail in ("exact", "half_pixel"))
    assert exact.observation_digest != coarse.observation_digest
    same, other = (envs.reset(seed=1)[0]["depth"] for envs in (exact, coarse))
    assert (same != other).any()
    assert (abs(same - other) < 0.1).mean() > 0.9
    exact.close()
    coarse.close()
    with pytest.raises(ValueError, match="`detail` is 'full'; use one of: exact, half_pixel"):
        vector(1, detail="full")


def test_an_invalid_action_affects_no_other_environment() -> None:
    envs = vector()
    envs.reset(seed=1)
    with pytest.raises(avln.sim.SimError, match="environment 1: action 9 does not exist"):
        envs.step([0, 9, 0])
    observations, *_ = envs.step([0, 0, 0])
    assert observations["remaining"][:, 0].tolist() == [998, 999, 998]
    with pytest.raises(ValueError, match="shape"):
        envs.step([0, 0])
    envs.close()


def test_rewards_can_be_functions() -> None:
    def by_depth(observations: dict[str, Any], actions: Any, _infos: dict[str, Any]) -> Any:
        if actions[0] == 1:
            raise ZeroDivisionError
        return observations["depth"].mean(axis=(1, 2))

    envs = vector(reward=by_depth)
    envs.reset(seed=1)
    observations, rewards, *_ = envs.step([0, 0, 0])
    assert np.allclose(rewards, observations["depth"].mean(axis=(1, 2)))
    with pytest.raises(ZeroDivisionError):
        envs.step([1, 0, 0])
    assert envs.step([0, 0, 0])[0]["remaining"][0, 0] == 997
    envs.close()


def test_explorer_completes_a_mission() -> None:
    env = avln.sim.Env(privileged=True, teacher="explore", senses=(), **SMALL)
    _, info = env.reset(seed=4)
    terminated, truncated = False, False
    while not (terminated or truncated):
        assert bool(info["expert_submit"]) or info["expert"] < avln.Action.SUBMIT
        _, _, terminated, truncated, info = env.step(info["expert"])
    assert terminated
    assert info["success"] == 1.0
    env.close()


def test_coefficients_weigh_the_reward() -> None:
    envs = vector(1, reward=avln.sim.Progress(slack=0.5, per_m=0.0, stop=3.0))
    envs.reset(seed=1)
    assert envs.step([0])[1].tolist() == [0.5]
    assert envs.step([STOP])[1].tolist() == [3.5]
    envs.close()


def test_added_submits_extend_the_budget() -> None:
    curriculum = replace(SMALL["curriculum"], added_submits=7, max_steps=3)
    envs = vector(1, curriculum=curriculum, privileged=True)
    observations, infos = envs.reset(seed=1)
    submits = int(infos["is_open"].sum()) - 1 + 7
    assert observations["remaining"].tolist() == [[3, submits]]
    assert envs.observation_space.contains(observations)
    assert envs.step([int(avln.Action.SUBMIT)])[0]["remaining"].tolist() == [[2, submits - 1]]
    envs.close()


def test_privileged_groups_have_their_arrays() -> None:
    envs = vector(1, privileged=GROUPS)
    _, infos = envs.reset(seed=1)
    shapes = {name: (array.shape[1:], array.dtype.name) for name, array in infos.items()}
    assert shapes == {
        "distance_m": ((4,), "float32"),
        "bearing_rad": ((4,), "float32"),
        "target_position": ((4, 3), "float32"),
        "is_open": ((4,), "uint8"),
        "is_in_region": ((4,), "uint8"),
        "sounding": ((), "int64"),
        "routed": ((), "int64"),
        "expert": ((), "int64"),
        "expert_submit": ((), "uint8"),
        "success": ((), "float32"),
        "spl": ((), "float32"),
        "instance": ((64, 64), "int32"),
        "semantic": ((64, 64), "uint8"),
        "target_instance": ((4,), "int32"),
        "top_down": ((512, 512), "uint8"),
    }
    assert infos["semantic"].max() <= 40
    assert infos["top_down"][0, 256, 256] == 1
    envs.close()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"source": "papers"}, "does not exist; use one of: paper"),
        ({"source": "mini"}, "needs houses of the pool 'train'"),
        ({"source": avln.sim.Folder("/nowhere")}, "cannot read /nowhere/dataset.json"),
        ({"source": avln.sim.Scan("/scan.glb")}, "scan /scan.glb may belong to a test split; confirm"),
        ({"size": 8}, "8 x 8 pixels is outside the limits"),
        ({"size": (64, 2000)}, "64 x 2000 pixels is outside the limits"),
        ({"size": -5}, "`size[0]` cannot be used: invalid value: integer `-5`"),
        ({"size": (64, 64, 64)}, "`size` is (64, 64, 64)"),
        ({"goal_side": 4}, "`goal_side` is 4; 8 to 512"),
        ({"num_envs": 0}, "`num_envs` is 0"),
        ({"threads": 0}, "`threads` is 0; 1 to 1024"),
        ({"threads": -1}, "`threads` cannot be used: invalid value: integer `-1`"),
        ({"episodes_per_scene": 0}, "`episodes_per_scene` is 0"),
        ({"teacher": None}, "`teacher` cannot be used: invalid type: null"),
        ({"autoreset_mode": "Never"}, "'Never' is not a valid AutoresetMode"),
        (
            {"curriculum": avln.sim.Curriculum(rooms=(3, 300))},
            "`rooms[1]` cannot be used: invalid value",
        ),
        ({"curriculum": avln.sim.Curriculum(distance_m=(float("nan"), 3.0))}, "`distance_m` is (nan, 3.0)"),
        ({"curriculum": avln.sim.Curriculum(goals=(0, 9))}, "`goals` is"),
        ({"senses": ("smell",)}, "`senses` has"),
        ({"senses": "depth"}, "`senses` is 'depth'; use a list of names"),
        ({"reward": 3}, "`reward` is 3"),
        ({"reward": "fame"}, "use one of: progress, sparse, none"),
        ({"rules": "chess"}, "chess"),
        ({"curriculum": avln.sim.Curriculum(order="sideways")}, "use ordered or unordered"),
        ({"batch_size": 9}, "`batch_size` is 9"),
        ({"privileged": ("maps",)}, "`privileged` has ['maps']; use targets, ids, top_down"),
        ({"teacher": "oracle"}, "use one of: path, explore"),
        ({"reward": avln.sim.Progress(found=float("inf"))}, "finite"),
        ({"curriculum": avln.sim.Curriculum(added_submits=101)}, "`added_submits` is 101; 0 to 100"),
    ],
)
def test_invalid_options_are_named(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        avln.sim.VectorEnv(**{**SMALL, "num_envs": 1, **options})


def test_scenes_are_read_at_the_first_reset() -> None:
    env = avln.sim.Env(avln.sim.Scan("/nowhere.glb", training=True), **SMALL)
    with pytest.raises(avln.sim.SimError, match=r"/nowhere\.glb"):
        env.reset()
    env.close()


def test_closed_environments_refuse_calls() -> None:
    envs = vector()
    envs.reset(seed=1)
    envs.step_async([0, 0, 0])
    envs.close()
    envs.close()
    with pytest.raises(RuntimeError, match="the environments are closed"):
        envs.step_wait()


@pytest.mark.skipif(sys.platform == "win32", reason="no fork")
def test_forked_children_are_told_to_start_anew() -> None:
    envs = vector()
    envs.reset(seed=1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        child = os.fork()
    if child == 0:
        try:
            envs.step([0, 0, 0])
        except RuntimeError as error:
            os._exit(0 if "after the fork" in str(error) else 2)
        os._exit(1)
    deadline = time.monotonic() + 60.0
    while (status := os.waitpid(child, os.WNOHANG)) == (0, 0) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert os.waitstatus_to_exitcode(status[1]) == 0
    envs.step([0, 0, 0])
    envs.close()


def test_bench_prints_speed_and_memory(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["bench", "--num-envs", "1", "--threads", "1", "--size", "64", "--seconds", "0.1", "--json"]
    for senses in ("depth", "rgbd,ears", "lidar,ears,map"):
        assert main([*arguments, "--senses", senses]) == 0
        speed = json.loads(capsys.readouterr().out)
        assert set(speed) == {"steps_per_s", "cpu_s_per_step", "rss_mib"}
        assert all(value > 0 for value in speed.values())
    assert main(["bench", "--senses", "smell"]) == 1
    assert "`senses` has ['smell']" in capsys.readouterr().err


def test_dropped_environments_end_their_threads() -> None:
    envs = vector()
    envs.reset(seed=1)
    envs.step_async([0, 0, 0])
    before = len(os.listdir("/proc/self/task")) if os.path.isdir("/proc/self/task") else 0
    del envs
    if before:
        assert len(os.listdir("/proc/self/task")) == before - 2
