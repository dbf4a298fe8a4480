"""Training episodes in process equal episodes of a server, bit for bit."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium", reason="pip install gymnasium")

import avln  # noqa: E402
import avln.sim  # noqa: E402
from avln.gym import LHAVLNEnv  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from conftest import Furnished
    from server import Server

pytestmark = pytest.mark.usefixtures("native_module")

SIDE, GOAL_SIDE, PHASE = 64, 32, "training"
RECIPE = {
    "name": "training",
    "rules": "lh-avln-v1",
    "seed": 3,
    "missions": {"goals": [2, 3], "min_start_m": 1.0, "min_separation_m": 1.0, "distractors": [0, 255]},
    "splits": [
        {
            "name": "train",
            "scenes": {"houses": {"count": 1, "rooms": [3, 4], "storeys": [1, 1], "pool": "train"}},
            "missions_per_scene": 2,
        }
    ],
}


@pytest.fixture(scope="module")
def hosted(furnished: Furnished, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Server, str, Path]]:
    """A server with a phase on a training split; its token, and the folder of the data set."""
    folder = tmp_path_factory.mktemp("training")
    (folder / "recipe.json").write_text(json.dumps(RECIPE))
    server, data_set = furnished.copy(folder / "data"), folder / "dataset"
    build = ("data", "dataset", "build", str(folder / "recipe.json"), "--out", str(data_set), "--verifier", "none")
    server.command(*build)
    server.command("challenge", "phase", "open", PHASE, "--split", "train", "--dataset", str(data_set))
    server.start()
    yield server, furnished.token, data_set
    server.kill()


def assert_equal(seen: dict[str, Any], other: dict[str, Any], step: int) -> None:
    assert seen.keys() == other.keys()
    for name, array in seen.items():
        assert np.array_equal(array, other[name]), f"{name} differs in step {step}"


def start_same_episode(sim: avln.sim.Env, first: dict[str, Any]) -> dict[str, Any]:
    """Resets the environment until it starts the episode with the observation `first`; returns the infos."""
    for _ in range(40):
        seen, info = sim.reset()
        if all(np.array_equal(seen[name], array) for name, array in first.items()):
            return info
    raise AssertionError("no training episode has the first observation of the server")


@pytest.mark.parametrize("order", ["ordered", "unordered"])
def test_whole_episodes_equal_the_server(hosted: tuple[Server, str, Path], order: str) -> None:
    server, token, data_set = hosted
    sim = avln.sim.Env(
        avln.sim.Folder(data_set),
        size=SIDE,
        goal_side=GOAL_SIDE,
        curriculum=avln.sim.Curriculum(goals=(1, 4), distance_m=(0.0, 1000.0), order=order),
        privileged=True,
    )
    sensors = avln.Sensors.square(SIDE)
    env = LHAVLNEnv(server.url, token, PHASE, method=order, order=order, sensors=sensors, goal_side=GOAL_SIDE)
    spl = []
    for episode in range(2):
        first, _ = env.reset()
        info, step, is_over = start_same_episode(sim, first), 0, False
        while not is_over:
            # In the second episode, other actions make the way longer than the teacher's.
            action = 1 + step % 2 if episode == 1 and step % 7 < 2 else int(info["expert"])
            seen, _, terminated, truncated, info = sim.step(action)
            other, _, *ends, _ = env.step(action)
            step, is_over = step + 1, terminated or truncated
            assert_equal(seen, other, step)
            assert ends == [terminated, truncated]
        assert info["success"] == 1.0
        spl.append(float(info["spl"]))
    env.close()
    sim.close()
    with avln.connect(server.url, token) as client:
        scores = {metric.name: metric.value for metric in client.runs(PHASE)[0].metrics or []}
    assert scores["sr"] == 1.0
    assert scores["spl"] == pytest.approx(np.mean(spl), abs=1e-6)


def test_skipped_goals_are_not_found(furnished: Furnished, tmp_path: Path) -> None:
    rules = "lh-avln-authors-v1"
    (tmp_path / "recipe.json").write_text(json.dumps({**RECIPE, "rules": rules}))
    server, data_set = furnished.copy(tmp_path / "data"), tmp_path / "dataset"
    build = ("data", "dataset", "build", str(tmp_path / "recipe.json"), "--out", str(data_set), "--verifier", "none")
    server.command(*build)
    options: dict[str, Any] = {
        "rules": rules,
        "reward": "sparse",
        "privileged": True,
        "senses": ("depth",),
        "size": SIDE,
    }
    curriculum = avln.sim.Curriculum(goals=(1, 4), distance_m=(0.0, 1000.0), order="ordered")
    env = avln.sim.Env(avln.sim.Folder(data_set), curriculum=curriculum, **options)
    _, info = env.reset(seed=1)
    goals = int(info["is_open"].sum())
    rewards = []
    # The start is a metre or more away from all targets.
    for skipped in range(1, goals):
        _, reward, _, _, info = env.step(int(avln.Action.SUBMIT))
        assert info["is_open"].sum() == goals - skipped
        rewards.append(reward)
    _, reward, terminated, _, info = env.step(int(avln.Action.STOP))
    assert terminated
    assert (info["success"], info["spl"], *rewards, reward) == (0.0,) * (goals + 2)
    env.close()

    with pytest.raises(ValueError, match="the missions of this source are built for 'lh-avln-authors-v1'"):
        avln.sim.Env(avln.sim.Folder(data_set), curriculum=curriculum)
