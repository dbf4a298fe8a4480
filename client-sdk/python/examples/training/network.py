"""Actor and critic of the training examples."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import torch
from torch import nn
from torch.distributions import Categorical

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

HIDDEN = 256
TEMPERATURE = 0.5
"""Below 1, the network plays probable actions more often than in training."""


class Network(nn.Module):
    """Two hidden layers with an actor and a critic."""

    def __init__(self, features: int, actions: int) -> None:
        """Draws the weights."""
        super().__init__()
        self.size = {"features": int(features), "actions": int(actions)}
        self.body = nn.Sequential(layer(features, HIDDEN), nn.Tanh(), layer(HIDDEN, HIDDEN), nn.Tanh())
        self.actor = layer(HIDDEN, actions, gain=0.01)
        self.critic = layer(HIDDEN, 1, gain=1.0)

    def forward(self, features: torch.Tensor) -> tuple[Categorical, torch.Tensor]:
        """Returns the distribution of actions and the value, per row."""
        hidden = self.body(features)
        return Categorical(logits=self.actor(hidden)), self.critic(hidden).squeeze(-1)

    @torch.no_grad()
    def act(self, features: NDArray[np.float32]) -> NDArray[np.int64]:
        """Draws an action per row, the probable ones more often than in training.

        The most probable action alone can turn to and fro for ever; an improbable Stop would end many episodes.
        """
        logits = self(torch.from_numpy(features))[0].logits
        actions: NDArray[np.int64] = torch.multinomial((logits / TEMPERATURE).softmax(-1), 1).squeeze(-1).numpy()
        return actions

    def save(self, path: str | Path) -> None:
        """Writes size and weights."""
        torch.save({"size": self.size, "weights": self.state_dict()}, path)

    @classmethod
    def load(cls, path: str | Path) -> Network:
        """Reads a network."""
        stored: dict[str, Any] = torch.load(path, weights_only=True)
        network = cls(**stored["size"])
        network.load_state_dict(stored["weights"])
        return network


def layer(inputs: int, outputs: int, gain: float = 2**0.5) -> nn.Linear:
    """Returns a linear layer with orthogonal weights."""
    linear = nn.Linear(inputs, outputs)
    nn.init.orthogonal_(linear.weight, gain)
    nn.init.zeros_(linear.bias)
    return linear
