"""Tests of a policy with the interface of SoundSpaces actor-critics."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from server import PHASE

import avln
from avln import habitat

torch = pytest.importorskip("torch", reason="pip install 'avln[torch]'")

from avln.soundspaces import PolicyAgent  # noqa: E402

if TYPE_CHECKING:
    from conftest import Endpoint


class CountingPolicy:
    """A policy that turns left twice and stops; the hidden state counts steps, and a mask of 0 resets it."""

    net = SimpleNamespace(num_recurrent_layers=1)

    def __init__(self) -> None:
        self.seen: list[tuple[float, int, float]] = []

    def act(self, observations: Any, hidden: Any, previous: Any, masks: Any, *, deterministic: bool) -> Any:
        assert deterministic
        assert {key: tuple(value.shape) for key, value in observations.items()} == {
            "depth": (1, 64, 64, 1),
            "spectrogram": (1, 65, 26, 2),
        }
        assert {value.dtype for value in observations.values()} == {torch.float32}
        self.seen.append((hidden[0, 0, 0].item(), previous.item(), masks.item()))
        hidden = hidden * masks + 1
        action = 0 if hidden[0, 0, 0] == 3 else 2
        return None, torch.tensor([[action]]), None, hidden


def test_recurrent_policy_receives_its_state(endpoint: Endpoint) -> None:
    policy = CountingPolicy()
    agent = PolicyAgent(policy, hidden_size=4, deterministic=True)
    with avln.begin(endpoint.url, endpoint.token, PHASE, "soundspaces", sensors=avln.Sensors.square(64)) as run:
        habitat.play(run, agent, keys=["depth", "spectrogram", "goals"])
    assert policy.seen == [(0.0, 0, 0.0), (1.0, 2, 1.0), (2.0, 2, 1.0)] * 3
    assert run.summary is not None
    assert run.summary.ends == [(avln.EndReason.STOPPED, 3)]
