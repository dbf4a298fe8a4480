"""Tests of equal scores for equal actions, for both clients and after server crashes."""

from __future__ import annotations

import json
import threading
import urllib.request
from typing import TYPE_CHECKING, Any

import pytest
from forward_and_turn import ForwardAndTurn
from server import PHASE

import avln

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from conftest import Endpoint, Furnished
    from server import Server

METHOD = "forward-and-turn"


def facts(server: Server, run: str) -> list[dict[str, Any]]:
    """Returns the public episode results: steps, metres, collisions, distances, scores."""
    with urllib.request.urlopen(f"http://127.0.0.1:{server.web}/api/v1/runs/{run}") as answer:
        results = json.load(answer)
    return [episode["metrics"] for episode in sorted(results["episodes"], key=lambda episode: episode["episode"])]


@pytest.mark.parametrize("order", list(avln.Order))
def test_python_and_rust_scores_are_equal(endpoint: Endpoint, client: avln.Client, order: avln.Order) -> None:
    options = ["--server", endpoint.url, "--token", endpoint.token, "--phase", PHASE, "--order", order.value]
    known = {run.id for run in client.runs(PHASE)}
    endpoint.server.command("agent", "baseline", METHOD, *options, "--size", "64")
    rust = next(run.id for run in client.runs(PHASE) if run.id not in known)
    run = client.start_run(PHASE, "python", order)
    assert avln.evaluate(client, run, ForwardAndTurn(), ForwardAndTurn.sensors).complete
    walked = facts(endpoint.server, run.id)
    assert walked == facts(endpoint.server, rust)
    assert all(episode["path_m"] > 10 and episode["steps"] == 1000 for episode in walked)


@pytest.fixture
def mortal(furnished: Furnished, tmp_path: Path) -> Iterator[Server]:
    server = furnished.copy(tmp_path / "data")
    server.start()
    yield server
    server.kill()


def poses(play: avln.Play, agent: ForwardAndTurn, killer: Killer | None) -> list[avln.Pose]:
    """Plays all episodes; returns all observed poses."""
    seen = []
    for episode in play:
        agent.begin(play.task, episode.mission)
        for observation in episode:
            seen.append(observation.pose)
            if killer is not None and len(seen) in killer.at:
                killer.strike()
            episode.act(agent.act(observation) if observation.step < 60 else avln.Action.STOP)
    return seen


class Killer:
    """A failure injector: it kills the server after some steps and restarts it 0.3 s later."""

    def __init__(self, server: Server, at: set[int]) -> None:
        self.server, self.at = server, at
        self.struck = 0

    def strike(self) -> None:
        self.server.kill()
        self.struck += 1
        threading.Timer(0.3, self.server.start).start()


@pytest.mark.parametrize("sensors", [ForwardAndTurn.sensors, avln.Sensors.square(64)], ids=["blind", "all senses"])
def test_killed_server_changes_no_result(mortal: Server, furnished: Furnished, sensors: avln.Sensors) -> None:
    with avln.connect(mortal.url, furnished.token) as client:
        calm = client.start_run(PHASE, "calm")
        with client.play(calm, sensors) as play:
            undisturbed = poses(play, ForwardAndTurn(), None)
        killer = Killer(mortal, {25, 90})
        run = client.start_run(PHASE, "killed")
        with client.play(run, sensors) as play:
            assert poses(play, ForwardAndTurn(), killer) == undisturbed
        assert killer.struck == 2
        assert client.run(run.id).state == "completed"
        assert facts(mortal, run.id) == facts(mortal, calm.id)
