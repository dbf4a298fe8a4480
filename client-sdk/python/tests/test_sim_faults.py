"""Tests of bad input and interruptions in training environments: each error names an item, and the others go on."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("gymnasium", reason="pip install gymnasium")

from server import WHAT_TO_DO, program
from sim_envs import SMALL, vector

import avln.sim

pytestmark = pytest.mark.usefixtures("native_module")

IS_WINDOWS = sys.platform == "win32"


def test_an_invalid_action_leaves_63_results() -> None:
    envs = vector(64, senses=("depth",))
    envs.reset(seed=1)
    actions = np.zeros(64, np.int64)
    actions[40] = 9
    with pytest.raises(avln.sim.SimError, match="environment 40: action 9 does not exist") as caught:
        envs.step(actions)
    observations, rewards, terminated, *_ = caught.value.results
    assert np.delete(observations["remaining"][:, 0], 40).tolist() == [999] * 63
    assert rewards.shape == terminated.shape == (64,)
    envs.close()


@pytest.mark.parametrize("action", [-1, 5, 2**40])
def test_unknown_actions_are_named(action: int) -> None:
    env = avln.sim.Env(**SMALL, senses=("depth",))
    env.reset(seed=1)
    with pytest.raises(avln.sim.SimError, match=f"environment 0: action {action} does not exist"):
        env.step(action)
    with pytest.raises(TypeError, match="integer"):
        env.step(0.7)
    assert env.step(0)[0]["remaining"][0] == 999
    env.close()


def test_unsuitable_arguments_of_calls_are_refused() -> None:
    envs = vector(2, senses=("depth",), reward=lambda *_: None)
    envs.reset(seed=1)
    with pytest.raises(ValueError, match=re.escape("`actions` is [0.7, 0.0]; use whole numbers")):
        envs.step([0.7, 0.0])
    with pytest.raises(ValueError, match="the reward function returned None"):
        envs.step([0, 0])
    for mask in ([True], [1, 0], "x"):
        with pytest.raises(ValueError, match="use 2 booleans"):
            envs.reset(options={"reset_mask": mask})
    envs.close()


def test_an_invalid_action_in_a_batch_leaves_the_others() -> None:
    envs = vector(2)
    envs.reset(seed=1)
    envs.send([0, 9], [0, 1])
    with pytest.raises(avln.sim.SimError, match="environment 1: action 9") as caught:
        envs.recv()
    rows, *_, infos = caught.value.results
    row = infos["env_id"].tolist().index(0)
    assert rows["remaining"][row, 0] == 999
    envs.close()


def test_errors_of_reward_functions_pass_through() -> None:
    def failing(*_: Any) -> Any:
        raise ZeroDivisionError("no reward")

    env = avln.sim.Env(reward=failing, **SMALL, senses=("depth",))
    env.reset(seed=1)
    with pytest.raises(ZeroDivisionError, match="no reward"):
        env.step(0)
    env.close()
    envs = vector(2, batch_size=1, reward=failing)
    envs.reset(seed=1)
    envs.send([0, 0], [0, 1])
    for _ in range(2):
        with pytest.raises(ZeroDivisionError, match="no reward"):
            envs.recv()
    envs.close()


@pytest.mark.skipif(IS_WINDOWS, reason="no signals")
def test_ctrl_c_leaves_the_results_of_a_step() -> None:
    envs = vector(24, size=512, threads=1)
    envs.reset(seed=1)
    timer = threading.Timer(0.02, os.kill, (os.getpid(), signal.SIGINT))

    def play() -> None:
        timer.start()
        # Until the signal, however late it comes.
        while True:
            envs.step([1] * 24)

    with pytest.raises(KeyboardInterrupt):
        play()
    timer.join()
    try:
        observations, *_ = envs.step_wait()
    except avln.sim.SimError:
        # The signal came between two steps.
        observations, *_ = envs.step([1] * 24)
    assert len(set(observations["remaining"][:, 0].tolist())) == 1
    envs.close()


class Interrupted:
    """Native environments that a Ctrl-C interrupts before a step starts."""

    def __init__(self, native: Any) -> None:
        self._native = native

    def __getattr__(self, name: str) -> Any:
        return getattr(self._native, name)

    def send_steps(self, *_: Any) -> None:
        raise KeyboardInterrupt


def test_ctrl_c_before_a_step_leaves_nothing_to_wait_for(monkeypatch: pytest.MonkeyPatch) -> None:
    envs = vector(senses=("depth",))
    envs.reset(seed=1)
    with monkeypatch.context() as patch:
        patch.setattr(envs, "_native", Interrupted(envs._native))
        with pytest.raises(KeyboardInterrupt):
            envs.step_async([1, 1, 1])
    with pytest.raises(avln.sim.SimError, match="0 of 3 environments have a running step"):
        envs.step_wait()
    observations, *_ = envs.step([1, 1, 1])
    assert len(set(observations["remaining"][:, 0].tolist())) == 1
    envs.close()


def test_other_threads_run_during_a_step() -> None:
    envs = vector(24, size=512, threads=1)
    envs.reset(seed=1)
    ticks: list[float] = []
    is_over = threading.Event()

    def tick() -> None:
        while not is_over.wait(0.001):
            ticks.append(time.monotonic())

    thread = threading.Thread(target=tick)
    thread.start()
    began = time.monotonic()
    envs.step([0] * 24)
    ended = time.monotonic()
    is_over.set()
    thread.join()
    assert sum(began < tick < ended for tick in ticks) >= 5, f"{ended - began} s"
    envs.close()


def test_arrays_are_reused_after_two_steps() -> None:
    envs = vector(1, senses=("depth",))
    envs.reset(seed=1)
    depths = [envs.step([1])[0]["depth"] for _ in range(3)]
    assert np.shares_memory(depths[0], depths[2])
    assert not np.shares_memory(depths[0], depths[1])
    envs.close()


def run_python(code: str) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join(filter(None, [str(Path(__file__).parent), os.environ.get("PYTHONPATH")]))
    command = [sys.executable, "-c", code]
    environment = {**os.environ, "PYTHONPATH": path}
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120, env=environment)


def test_the_module_in_a_name_is_imported() -> None:
    done = run_python(
        "import gymnasium\nfrom sim_envs import SMALL\n"
        "envs = gymnasium.make_vec('avln:avln/LHAVLNTrain-v1', num_envs=2, senses=('depth',), **SMALL)\n"
        "print(envs.num_envs)"
    )
    assert done.stdout == "2\n", done.stderr


def test_the_interpreter_ends_during_a_step() -> None:
    done = run_python(
        "from sim_envs import vector\nenvs = vector(24, size=512, threads=1)\nenvs.reset(seed=1)\n"
        "envs.step_async([0] * 24)\nprint('running')"
    )
    assert (done.returncode, done.stdout) == (0, "running\n"), done.stderr


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="memory is read in /proc")
def test_dropped_environments_leave_no_memory() -> None:
    done = run_python(
        "import ctypes, os\nfrom avln.sim.bench import _resident_mib\nfrom sim_envs import vector\n\n"
        # glibc keeps freed memory, for each thread in another arena; other libraries have no malloc_trim.
        "trim = getattr(ctypes.CDLL(None), 'malloc_trim', lambda pad: 0)\n\n"
        "def measure():\n    for _ in range(3):\n        vector(senses=('depth',)).reset(seed=1)\n    trim(0)\n"
        "    return _resident_mib(), len(os.listdir('/proc/self/task'))\n\n"
        "(before_mib, before), (after_mib, after) = measure(), measure()\n"
        "print(after - before, round(after_mib - before_mib))"
    )
    threads, grown_mib = map(int, done.stdout.split())
    # A house takes about 30 MiB.
    assert threads == 0
    assert grown_mib < 15, done.stdout


@pytest.mark.skipif(IS_WINDOWS, reason="no fork")
def test_forked_children_close_what_their_parent_waits_for() -> None:
    envs = vector(24, size=512, threads=1)
    envs.reset(seed=1)
    envs.step_async([0] * 24)
    waiting = threading.Thread(target=envs.step_wait)
    waiting.start()
    time.sleep(0.02)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        child = os.fork()
    if child == 0:
        envs.close()
        os._exit(0)
    deadline = time.monotonic() + 60.0
    while (status := os.waitpid(child, os.WNOHANG)) == (0, 0) and time.monotonic() < deadline:
        time.sleep(0.02)
    waiting.join()
    envs.close()
    assert status[0] == child, "the child hangs"
    assert os.waitstatus_to_exitcode(status[1]) == 0


def test_states_of_another_seed_are_refused() -> None:
    env = avln.sim.Env(**SMALL, senses=("depth",))
    env.reset(seed=1)
    env.step(1)
    state = env.state()
    first, *_ = env.step(0)
    env.restore(state)
    again, *_ = env.step(0)
    assert np.array_equal(first["depth"], again["depth"])
    env.reset(seed=2)
    with pytest.raises(avln.sim.SimError, match="another source or seed"):
        env.restore(state)
    env.close()


@pytest.fixture(scope="module")
def houses(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data set of the recipe `mini`, and a house file."""
    binary = program()
    if binary is None:
        pytest.skip(WHAT_TO_DO)
    folder = tmp_path_factory.mktemp("houses")
    for arguments in (
        ["data", "dataset", "build", "mini", "--out", "mini"],
        ["scene", "export", "--seed", "3", "house.glb"],
    ):
        subprocess.run([binary, "--data", "data", *arguments], cwd=folder, check=True, capture_output=True, timeout=280)
    return folder


def test_evaluation_splits_are_refused(houses: Path) -> None:
    with pytest.raises(ValueError, match=re.escape("split 'val' has houses of the pool 'validation'")):
        avln.sim.Env(avln.sim.Folder(houses / "mini", "val"), **SMALL)
    with pytest.raises(ValueError, match=re.escape("has no split 'test'; it has: val")):
        avln.sim.Env(avln.sim.Folder(houses / "mini", "test"), **SMALL)


def test_scans_are_played(houses: Path) -> None:
    env = avln.sim.Env(avln.sim.Scan(houses / "house.glb", training=True), **{**SMALL, "senses": ("depth",)})
    observation, _ = env.reset(seed=1)
    assert observation["depth"].shape == (64, 64)
    assert env.step(0)[0]["remaining"][0] == 999
    env.close()


def test_films_are_gif_without_ffmpeg(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("PIL.Image", reason="pip install pillow")
    monkeypatch.setenv("PATH", str(tmp_path))
    options = {**SMALL, "curriculum": replace(SMALL["curriculum"], max_steps=1)}
    path = avln.sim.record(tmp_path / "film.mp4", options, lambda *_: 1)
    assert path.name == "film.gif"
    assert path.read_bytes().startswith(b"GIF89a")


def test_steps_after_partial_sends_return_new_rows() -> None:
    envs = vector(2, batch_size=1, senses=("depth",))
    envs.reset(seed=1)
    envs.send([0], [1])
    envs.recv()
    envs.send([0, 0], [0, 1])
    observations, *_ = envs.step_wait()
    assert np.diff(observations["remaining"][:, 0]).tolist() == [-1]
    held = observations["remaining"].copy()
    envs.send([1], [1])
    envs.recv()
    assert np.array_equal(observations["remaining"], held), "valid until the second step"
    envs.reset()
    assert np.diff(envs.step([0, 0])[0]["remaining"][:, 0]).tolist() == [0]
    envs.close()


def test_refused_seeds_leave_the_environments() -> None:
    envs = vector(1, senses=("depth",))
    seed: Any = np.int64(1)
    envs.reset(seed=seed)
    with pytest.raises(ValueError, match="`seed` cannot be used: invalid value: integer `-1`"):
        envs.reset(seed=-1)
    envs.step([0])
    envs.close()
    with pytest.raises(RuntimeError, match="the environments are closed"):
        envs.reset(seed=1)
    env = avln.sim.Env(**SMALL, senses=("depth",))
    env.reset(seed=seed)
    with pytest.raises(ValueError, match="`seed` is -1"):
        env.reset(seed=-1)
    env.step(0)
    env.close()


def test_interrupted_resets_can_be_repeated() -> None:
    envs = vector(3, senses=("depth",))
    envs.reset(seed=1)
    envs.send([0], [1])
    with pytest.raises(avln.sim.SimError, match="call step_wait, recv or reset first"):
        envs.step([0, 0, 0])
    with pytest.raises(avln.sim.SimError, match="1 of 3 environments have a running step; call step_async or reset"):
        envs.step_wait()
    observations, _ = envs.reset(options={"reset_mask": [False, False, True]})
    assert observations["remaining"][:, 0].tolist() == [1000, 999, 1000]
    envs.close()


def test_numbers_of_numpy_are_options() -> None:
    one: Any = np.int64(1)
    slack: Any = np.float32(-0.5)
    envs = vector(one, size=np.int64(64), senses=("depth",), reward=avln.sim.Progress(slack=slack))
    envs.reset(seed=1)
    assert envs.step([1])[1].tolist() == [-0.5]
    envs.close()
    vector(1, size=[96, 64], senses=("depth",)).close()
    with pytest.raises(TypeError, match="neither a number nor a text"):
        vector(1, rules=Path("rules"))


def test_unsuitable_options_of_env_are_refused() -> None:
    with pytest.raises(TypeError, match="Env has no batch_size; use VectorEnv"):
        avln.sim.Env(batch_size=1)
    for make in (avln.sim.Env, vector):
        with pytest.raises(ValueError, match="`render_mode` is 'human'"):
            make(render_mode="human")


def test_one_reward_is_that_of_the_whole_batch() -> None:
    envs = vector(2, batch_size=2, senses=("depth",), reward=lambda *_: 2.5)
    envs.reset(seed=1)
    envs.send([0, 0], [0, 1])
    assert envs.recv()[1].tolist() == [2.5, 2.5]
    envs.close()


def test_interrupted_env_asks_for_a_reset() -> None:
    env = avln.sim.Env(**SMALL, senses=("depth",))
    env.reset(seed=1)
    env._vector.send([0], [0])
    with pytest.raises(avln.sim.SimError, match="the last step was interrupted; call reset"):
        env.step(0)
    env.reset()
    env.step(0)
    env.close()


def test_missing_native_files_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AVLN_NATIVE", "/no/such/file")
    with pytest.raises(ModuleNotFoundError, match="cannot load AVLN_NATIVE=/no/such/file"):
        avln.sim.Env()
