"""Tests of pictures and films of training environments."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

pytest.importorskip("gymnasium", reason="pip install gymnasium")

from sim_envs import SMALL, vector

import avln.sim
from avln.sim.picture import _target

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.usefixtures("native_module")


def test_vectors_render_a_picture_per_environment() -> None:
    envs = vector(2, render_mode="rgb_array", senses=("audio",))
    envs.reset(seed=1)
    before = envs.render()
    assert before is not None
    envs.step([1, 1])
    pictures = envs.render()
    assert pictures is not None
    assert [(picture.shape, picture.dtype.name) for picture in pictures] == [((512, 1024, 3), "uint8")] * 2
    assert not np.array_equal(pictures[0], before[0])
    assert len(np.unique(pictures[0][:, 512:].reshape(-1, 3), axis=0)) > 5
    envs.close()
    envs = vector(1)
    assert envs.render() is None
    envs.close()


@pytest.mark.parametrize("place", [(-200.0, 10.0), (10.0, -200.0), (-1.0, -2.0), (63.0, 64.0), (500.0, 500.0)])
def test_targets_beyond_the_map_are_cropped(place: tuple[float, float]) -> None:
    plan = np.zeros((64, 64, 3))
    _target(plan, place, 64, 1, (9, 9, 9))
    assert plan.shape == (64, 64, 3)
    assert plan.any() == (min(place) > -5 and max(place) < 70)


def turn(_observation: dict[str, Any], _info: dict[str, Any]) -> int:
    return 1


def test_films_are_recorded_as_gif(tmp_path: Path) -> None:
    images = pytest.importorskip("PIL.Image", reason="pip install pillow")
    curriculum = replace(SMALL["curriculum"], max_steps=2)
    path = avln.sim.record(tmp_path / "film.gif", {**SMALL, "curriculum": curriculum}, turn, episodes=2)
    with images.open(path) as film:
        assert (path.name, film.size, film.n_frames) == ("film.gif", (1024, 512), 6)


@pytest.mark.skipif(sys.platform == "win32", reason="no shell scripts")
def test_films_are_recorded_as_mp4(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A script in place of ffmpeg stores the bytes of the frames."""
    tool = tmp_path / "ffmpeg"
    tool.write_text(
        '#!/bin/sh\nfor last; do :; done\ncase "$last" in *bad*) echo "no space" >&2; exit 1;; esac\ncat > "$last"\n'
    )
    tool.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    curriculum = replace(SMALL["curriculum"], max_steps=1)
    env = avln.sim.Env(render_mode="rgb_array", **{**SMALL, "curriculum": curriculum})
    path = avln.sim.record(tmp_path / "film.mp4", env, turn)
    assert path.stat().st_size == 2 * 512 * 1024 * 3
    with pytest.raises(avln.sim.SimError, match="no space"):
        avln.sim.record(tmp_path / "bad.mp4", env, turn)
    env.close()
    env = avln.sim.Env(**SMALL)
    with pytest.raises(ValueError, match="rgb_array"):
        avln.sim.record(tmp_path / "film.mp4", env, turn)
    env.close()


def test_films_need_a_tool(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setitem(sys.modules, "PIL", None)
    monkeypatch.setitem(sys.modules, "PIL.Image", None)
    with pytest.raises(ModuleNotFoundError, match="pip install pillow"):
        avln.sim.record(tmp_path / "film.mp4", SMALL, turn)
