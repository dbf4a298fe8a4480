"""Tests of demonstrations and exported splits, written by the program."""

from __future__ import annotations

import gzip
import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from avln.action import Action, Order
from avln.mission import Modality
from avln.rollouts import Rollouts, RolloutsError

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Furnished
    from server import Server

SIDE = 64


@pytest.fixture(scope="module")
def copied(furnished: Furnished, tmp_path_factory: pytest.TempPathFactory) -> Server:
    return furnished.copy(tmp_path_factory.mktemp("learnt") / "data")


@pytest.fixture(scope="module")
def folder(copied: Server, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("rollouts")
    record(copied, out, "--episodes", "2")
    return out


def record(server: Server, out: Path, *more: str) -> str:
    arguments = ("--split", "trial", "--out", str(out), "--size", str(SIDE), *more)
    return server.command("lab", "rollout", *arguments)


def test_rollouts_contain_episodes_and_steps(folder: Path) -> None:
    rollouts = Rollouts(folder)
    assert len(rollouts) == 2
    assert rollouts.manifest["sensors"] == ["rgb", "depth", "pose", "audio"]
    for rollout in rollouts:
        assert rollout.is_complete
        assert rollout.mission.order is Order.UNORDERED
        assert len(rollout.mission.goals) >= 2
        steps = list(rollout)
        assert len(steps) == len(rollout)
        actions = [action for _, action in steps]
        assert actions[-1] is Action.STOP
        assert actions.count(Action.SUBMIT) == len(rollout.mission.goals) - 1
        assert rollout.rgb is not None
        assert rollout.rgb.shape == (len(steps), SIDE, SIDE, 3)


def test_rollout_observations_match_agent_sensors(folder: Path) -> None:
    rollout = Rollouts(folder)[0]
    seen = [observation for observation, _ in rollout]
    first, last = seen[0], seen[-1]
    assert (first.step, first.pose.x_m, first.pose.heading_rad) == (0, 0.0, 0.0)
    assert first.rgb is not None
    assert first.rgb.std() > 1
    assert first.depth is not None
    assert first.depth.dtype == np.float32
    assert 0 < first.depth.max() <= 10
    assert first.audio is not None
    assert first.audio.shape[0] == 2
    assert last.audio is not None
    assert last.remaining_submits == 0
    assert first.remaining_steps - last.remaining_steps == len(rollout) - 1
    moved = [a.pose != b.pose for (a, act), (b, _) in zip(rollout, list(rollout)[1:]) if act is Action.MOVE_FORWARD]
    assert sum(moved) > len(moved) / 2
    heard = rollout.audio
    assert heard is not None
    assert np.abs(heard).max() > 0


def test_rollout_goals_match_split(furnished: Furnished, folder: Path) -> None:
    missions = {}
    for path in (furnished.folder / "splits" / "trial" / "trial" / "missions").glob("*.jsonl"):
        for line in path.read_text().splitlines()[1:]:
            mission = json.loads(line)
            missions[mission["id"]] = mission["goals"]
    for rollout in Rollouts(folder):
        for goal, cue in zip(rollout.mission.goals, missions[rollout.id]):
            if cue == "image":
                assert goal.modality is Modality.IMAGE
                assert goal.image is not None
                assert goal.image.shape[2] == 3
            else:
                assert cue == {goal.modality.name.lower(): goal.text}


def test_recorded_episodes_are_not_repeated(copied: Server, folder: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in (folder / "episodes").iterdir()}
    first = min(before)
    kept = first.read_bytes()
    first.unlink()
    assert "2 episodes were recorded, 1 were there before" in record(copied, folder, "--episodes", "3")
    after = {path: path.stat().st_mtime_ns for path in (folder / "episodes").iterdir()}
    assert len(after) == 3
    assert first.read_bytes() == kept
    assert all(after[path] == when for path, when in before.items() if path != first)


def test_other_sensors_need_another_folder(copied: Server, folder: Path, tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="another split or of other sensors"):
        record(copied, folder, "--sensors", "pose")
    record(copied, tmp_path, "--sensors", "pose", "--episodes", "1", "--order", "ordered")
    (only,) = Rollouts(tmp_path)
    observation, _ = next(iter(only))
    assert (observation.rgb, observation.depth, observation.audio) == (None, None, None)
    assert only.mission.order is Order.ORDERED


def test_hidden_splits_are_rejected(furnished: Furnished, tmp_path: Path) -> None:
    server = furnished.copy(tmp_path / "data")
    server.command("challenge", "phase", "open", "finals", "--split", "hidden", "--replays", "organiser")
    for command in (("lab", "rollout", "--split", "hidden"), ("data", "split", "export", "hidden")):
        with pytest.raises(AssertionError, match="'hidden' is hidden: phase 'finals' plays it"):
            server.command(*command, "--out", str(tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_damaged_rollout_error_names_file(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(RolloutsError, match="avln lab rollout --split"):
        Rollouts(tmp_path)
    (tmp_path / "rollouts.json").write_text('{"format": "avln-rollouts", "version": 2}')
    with pytest.raises(RolloutsError, match="version 2"):
        Rollouts(tmp_path)
    (tmp_path / "rollouts.json").write_text((folder / "rollouts.json").read_text())
    (tmp_path / "episodes").mkdir()
    whole = next((folder / "episodes").iterdir()).read_bytes()
    for cut in (b"PK", b"", whole[: len(whole) // 2], whole[:40] + b"xxxx" + whole[44:]):
        (tmp_path / "episodes" / "cut.npz").write_bytes(cut)
        with pytest.raises(RolloutsError, match=r"cut\.npz"):
            Rollouts(tmp_path)


def test_pyarrow_reads_exported_tables(copied: Server, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="pip install pyarrow")
    copied.command("data", "split", "export", "trial", "--out", str(tmp_path))
    tables = {path.stem: parquet.read_table(path) for path in (tmp_path / "trial").glob("*.parquet")}
    assert set(tables) == {"missions", "goals", "targets", "places", "tours"}
    missions, goals = tables["missions"].to_pylist(), tables["goals"].to_pylist()
    assert [mission["goals"] for mission in missions] == counts(goals, [mission["mission"] for mission in missions])
    (content,) = (tmp_path / "trial" / "content").glob("*.json.gz")
    episodes = json.loads(gzip.decompress(content.read_bytes()))["episodes"]
    for mission, episode in zip(missions, episodes):
        start = [mission[f"start_{axis}_m"] for axis in "xyz"]
        assert np.allclose(start, episode["start_position"], atol=1e-6)
        assert mission["unordered_m"] == episode["unordered_total_geodesic_distance"]
        assert mission["ordered_steps"] >= mission["goals"]
    instances = {(row["scene"], row["instance"]) for row in tables["targets"].to_pylist()}
    assert {row["instance"] for row in goals} == {instance for _, instance in instances}
    assert {row["kind"] for row in tables["places"].to_pylist()} == {"region", "viewpoint"}
    for row in goals:
        assert (row["text"] == "") == (row["modality"] == "image") == (not np.isnan(row["view_x_m"]))
    assert {row["order"] for row in tables["tours"].to_pylist()} == {"ordered", "unordered"}


def counts(goals: list[dict[str, Any]], missions: list[str]) -> list[int]:
    ids = [row["mission"] for row in goals]
    return [ids.count(mission) for mission in missions]
