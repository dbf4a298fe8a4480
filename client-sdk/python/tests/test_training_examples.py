"""Tests of the training examples at a small size."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

pytest.importorskip("gymnasium", reason="pip install gymnasium")
pytest.importorskip("torch", reason="pip install torch")

import curve
import dagger
import ppo
from curve import ROW_STEPS, Curve
from evaluate import policy
from network import Network
from reach_sound import ACTIONS, EARS_SCALE, ReachSound, evaluate

import avln.sim

if TYPE_CHECKING:
    from pathlib import Path

EASY: dict[str, Any] = {
    "curriculum": avln.sim.Curriculum(
        goals=(1, 1), distance_m=(1.0, 100.0), max_steps=40, rooms=(3, 4), storeys=(1, 1)
    ),
    "scenes": 1,
}


pytestmark = pytest.mark.usefixtures("native_module")


def test_features_contain_sound_and_motion() -> None:
    envs = ReachSound(2, 1, **EASY)
    rays, ears = len(envs.envs.single_observation_space.sample()["lidar"]), len(EARS_SCALE)
    features, _ = envs.reset()
    assert envs.observation_space.contains(features)
    assert features[:, rays : rays + ears].any()
    assert not features[:, rays + ears :].any()
    later, *_ = envs.step(np.array([0, 1]))
    envs.close()
    motion = later[:, rays + ears :][:, : len(ACTIONS) + 1]
    assert motion[0, 0] == motion[1, 1] == 1.0
    assert motion[0, :-1].sum() == motion[1, :-1].sum() == 1.0
    assert motion[1, -1] == 0.0


def test_teacher_completes_the_task() -> None:
    envs = ReachSound(4, 1, **{**EASY, "curriculum": avln.sim.Curriculum(goals=(1, 1), rooms=(3, 4), storeys=(1, 1))})
    _, infos = envs.reset()
    ended = complete = 0
    while ended < 8:
        _, _, terminated, truncated, infos = envs.step(envs.expert(infos))
        ended += int((terminated | truncated).sum())
        complete += int(infos["is_success"].sum())
    envs.close()
    assert complete >= ended - 1


def test_ppo_changes_the_network_and_writes_it(tmp_path: Path) -> None:
    settings = ppo.Settings(num_envs=4, steps=16)
    network = ppo.train(1, 0.01, str(tmp_path / "ppo.pt"), settings, **EASY)
    stored = Network.load(tmp_path / "ppo.pt")
    features = np.zeros((3, network.size["features"]), np.float32)
    assert stored.act(features).shape == (3,)
    assert (tmp_path / "ppo.pt.csv").read_text().startswith("steps,minutes,success\n")
    assert 0.0 <= evaluate(stored.act, episodes=2, num_envs=2, **EASY) <= 1.0


def test_dagger_imitates_the_teacher(tmp_path: Path) -> None:
    settings = dagger.Settings(num_envs=4, steps=32, batches=10, batch_size=64)
    network = dagger.train(1, 0.02, str(tmp_path / "dagger.pt"), settings, **EASY)
    assert network.size["actions"] == len(ACTIONS)


def test_stable_baselines3_trains(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3", reason="pip install stable-baselines3")
    import sb3  # noqa: PLC0415, needs an extra

    model = sb3.train(1, 256, str(tmp_path / "sb3.csv"), num_envs=4, **EASY)
    model.save(tmp_path / "sb3.zip")
    features = np.stack([model.observation_space.sample()] * 3)
    assert policy(str(tmp_path / "sb3.zip"))(features).shape == (3,)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_torchrl_trains(tmp_path: Path) -> None:
    pytest.importorskip("torchrl", reason="pip install torchrl")
    import torchrl_ppo  # noqa: PLC0415, needs an extra

    torchrl_ppo.train(1, 256, str(tmp_path / "torchrl.pt"), num_envs=4, **EASY)
    assert Network.load(tmp_path / "torchrl.pt").size["actions"] == len(ACTIONS)


def test_curves_are_drawn(tmp_path: Path) -> None:
    rows = Curve(tmp_path / "ppo.pt.csv")
    rows.add(ROW_STEPS - 1, [True, False])
    rows.add(1, [True, True])
    assert len(curve.read(tmp_path / "ppo.pt.csv")) == 1
    curve.main([str(tmp_path / "ppo.pt.csv"), "--out", str(tmp_path / "curves.svg")])
    text = (tmp_path / "curves.svg").read_text()
    assert text.count("<polyline") == 1
    assert ">ppo</text>" in text

    other = tmp_path / "seed2"
    other.mkdir()
    Curve(other / "ppo.pt.csv").add(ROW_STEPS, [True])
    curve.main([*map(str, tmp_path.rglob("*.csv")), "--out", str(tmp_path / "curves.svg")])
    assert (tmp_path / "curves.svg").read_text().count("<polyline") == 2
