"""Tests of the bridge with a client of the authors' protocol."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from server import CHALLENGE, PHASE

import avln

zmq = pytest.importorskip("zmq", reason="pip install 'avln[bridge]'")
pytest.importorskip("msgpack", reason="pip install 'avln[bridge]'")

from authors_client import AuthorsClient  # noqa: E402

from avln.bridge import RequestHandler, pack, unpack  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Iterator

    from conftest import Endpoint

STOP, FORWARD, LEFT, RIGHT, SUBMIT = range(5)


class Bridge:
    """A process with `avln-bridge`, and a client."""

    def __init__(self, endpoint: Endpoint, phase: str) -> None:
        arguments = ["--server", endpoint.url, "--token", endpoint.token, "--phase", phase, "--size", "64"]
        command = [sys.executable, "-c", "import sys; from avln.bridge import main; sys.exit(main())"]
        bind = ["zmq", "--bind", "tcp://127.0.0.1:*"]
        self.process = subprocess.Popen(
            [*command, *bind, *arguments], stdout=subprocess.PIPE, text=True, env=os.environ
        )
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        found = re.search(r"(run_\w+): listening on (tcp://\S+)", line)
        assert found, line
        self.run, address = found.groups()
        self.context = zmq.Context()
        self.client = AuthorsClient(self.context, address)

    def close(self) -> None:
        self.client.socket.close()
        self.context.term()
        self.process.kill()
        self.process.communicate()


@pytest.fixture
def bridge(endpoint: Endpoint, request: pytest.FixtureRequest) -> Iterator[Bridge]:
    bridge = Bridge(endpoint, getattr(request, "param", PHASE))
    yield bridge
    bridge.close()


def test_bridge_client_plays_whole_run(bridge: Bridge, client: avln.Client) -> None:
    authors = bridge.client
    assert authors.ask("ping") == {"op": "pong", "episodes_total": 3}
    lasts = authors.play([LEFT, FORWARD, SUBMIT, RIGHT, STOP])
    assert len(lasts) == 3
    assert lasts[0]["episode_metrics"]["success"] in (0.0, 1.0)
    assert lasts[0]["episode_metrics"]["num_goals"] == len(lasts[0]["episode"]["goal_inputs"])
    assert authors.ask("close")["op"] == "closed"
    assert bridge.process.wait(timeout=30) == 0
    status = client.run(bridge.run)
    assert (status.state, status.ends) == ("completed", [(avln.EndReason.STOPPED, 3)])


def test_bridge_observations_have_authors_shapes(bridge: Bridge) -> None:
    seen = bridge.client.ask("start")["observations"]
    shapes = {key: (value.shape, value.dtype.name) for key, value in seen.items()}
    assert shapes == {
        "rgb": ((64, 64, 3), "uint8"),
        "depth": ((64, 64, 1), "float32"),
        "audiogoal": ((2, 16000), "float32"),
        "spectrogram": ((65, 26, 2), "float32"),
        "full_pose_sensor": ((7,), "float32"),
    }
    assert 0 < seen["depth"].max() <= 1
    turned = bridge.client.ask("action", action=LEFT)["observations"]["full_pose_sensor"]
    half = np.radians(15)
    np.testing.assert_allclose(turned, [0, 0, 0, 0, np.sin(half), 0, np.cos(half)], atol=1e-6)


def test_invalid_requests_get_error_and_episode_continues(bridge: Bridge) -> None:
    ask = bridge.client.ask
    assert ask("action", action=LEFT) == {
        "op": "error",
        "message": "take a step: no episode is open; send reset first",
    }
    ask("reset")
    for choice, complaint in [(9, "0 STOP"), ("fly", "fly"), (None, "missing")]:
        answer = ask("action", action=choice)
        assert answer["op"] == "error"
        assert complaint in answer["message"]
    assert "interrupted" in ask("interrupted")["message"]
    bridge.client.socket.send_multipart([b"\xc1 no MessagePack"])
    assert unpack(bridge.client.socket.recv_multipart())["op"] == "error"
    assert ask("action", action=LEFT)["step_index"] == 1


def keys_of(value: Any) -> set[str]:
    """Returns all keys in an answer, at any depth."""
    if isinstance(value, dict):
        return set(value).union(*map(keys_of, value.values()))
    return set().union(*map(keys_of, value)) if isinstance(value, list) else set()


@pytest.mark.parametrize("bridge", [CHALLENGE], indirect=True)
def test_bridge_hides_ground_truth(bridge: Bridge) -> None:
    started = bridge.client.ask("reset")
    answers = [started, *(bridge.client.ask("action", action=action) for action in (FORWARD, SUBMIT, STOP))]
    assert answers[-1]["done"]
    assert answers[-1]["episode_metrics"] == {}
    keys = set().union(*map(keys_of, answers))
    hidden = {"semantic", "pointgoal_with_gps_compass", "top_down_map", "sound_sources", "instance_key", "position"}
    assert not keys & hidden
    assert {answer["metrics"] != {} for answer in answers[1:]} == {False}
    assert answers[2]["info"]["feedback"]["found_goal_this_step"] is None
    episode = started["episode"]
    assert (episode["scene_id"], episode["scene_name"], started["scene"]) == ("hidden", "hidden", "hidden")
    assert episode["start_position"] == [0.0, 0.0, 0.0]
    for goal in episode["goal_inputs"]:
        assert len(goal) == 2 or (goal["modality"] == "image" and goal["detected_objects"] == [])


def test_nested_arrays_round_trip() -> None:
    message: dict[Any, Any] = {
        "a": [np.arange(6, dtype=np.float64).reshape(2, 3), (1, None)],
        3: {"b": np.int64(4)},
        "c": b"\0",
    }
    frames = pack(message)
    assert len(frames) == 2
    back = unpack(frames)
    np.testing.assert_array_equal(back["a"][0], message["a"][0])
    assert (back["a"][1], back["3"], back["c"]) == ([1, None], {"b": 4}, b"\0")
    with pytest.raises(ValueError, match="not MessagePack"):
        unpack([])


def test_lost_server_becomes_error_reply() -> None:
    class Lost:
        task = avln.TaskSpec()

        def next_episode(self) -> None:
            raise avln.LostError("begin an episode", "gone")

    answer = RequestHandler(Lost()).answer({"op": " RESET "})  # type: ignore[arg-type]
    assert answer["op"] == "error"
    assert "begin an episode" in answer["message"]
