"""Client of the authors' protocol, written from its description: lock-step, MessagePack maps, arrays in frames."""

from __future__ import annotations

from typing import Any

import msgpack
import numpy as np
import zmq


class AuthorsClient:
    """A REQ socket client with the expectations of the authors' client."""

    def __init__(self, context: zmq.Context[Any], address: str) -> None:
        self.socket = context.socket(zmq.REQ)
        self.socket.setsockopt(zmq.LINGER, 0)
        self.socket.setsockopt(zmq.RCVTIMEO, 30_000)
        self.socket.connect(address)

    def ask(self, op: str, **fields: Any) -> Any:
        self.socket.send_multipart([msgpack.packb({"op": op, **fields}, use_bin_type=True)])
        frames = self.socket.recv_multipart()
        return self._decode(msgpack.unpackb(frames[0], raw=False), frames[1:])

    def _decode(self, value: Any, frames: list[bytes]) -> Any:
        if isinstance(value, dict) and value.get("__ndarray__") is True:
            array = np.frombuffer(frames[value["frame"]], dtype=np.dtype(value["dtype"]))
            return array.reshape(tuple(value["shape"]))
        if isinstance(value, dict):
            return {key: self._decode(entry, frames) for key, entry in value.items()}
        return [self._decode(entry, frames) for entry in value] if isinstance(value, list) else value

    def play(self, actions: list[int]) -> list[dict[str, Any]]:
        """Plays all episodes with the same actions; returns the last answer of every episode."""
        lasts: list[dict[str, Any]] = []
        while True:
            started = self.ask("reset")
            assert started["op"] in ("episode_start", "run_end"), started
            if started["op"] == "run_end":
                return lasts
            lasts.append(self._play_episode(started, actions))

    def _play_episode(self, started: dict[str, Any], actions: list[int]) -> dict[str, Any]:
        assert isinstance(started["observations"], dict)
        assert isinstance(started["episode"]["goal_inputs"], list)
        assert started["step_index"] == 0
        EpisodeObject(**started["episode"])
        for number, action in enumerate(actions, start=1):
            stepped = self.ask("action", action=action)
            assert (stepped["op"], stepped["step_index"]) == ("step", number), stepped
            if stepped["done"]:
                return dict(stepped)
        raise AssertionError("the actions did not end the episode")


class EpisodeObject:
    """The authors' client converts all episode keys to attributes."""

    def __init__(self, *, episode_id: str, scene_id: str, goal_inputs: list[Any], **more: Any) -> None:
        assert episode_id
        assert scene_id
        assert 2 <= len(goal_inputs) <= 4
        assert {"goal_count", "goal_order_mode", "start_position", "start_rotation", "scene_name"} == set(more)
