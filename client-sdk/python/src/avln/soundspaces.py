"""SoundSpaces policies as Habitat agents; `pip install 'avln[torch]'`.

agent = avln.soundspaces.PolicyAgent(actor_critic, hidden_size=512)
avln.habitat.play(run, agent, keys=["depth", "spectrogram"], actions=…)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

try:
    import torch
except ModuleNotFoundError as error:
    raise ModuleNotFoundError("avln.soundspaces needs torch; pip install 'avln[torch]'", name=error.name) from None

if TYPE_CHECKING:
    from collections.abc import Mapping


class Policy(Protocol):
    """A SoundSpaces actor-critic."""

    net: Any
    """Network with `num_recurrent_layers`."""

    def act(self, observations: Any, hidden: Any, previous: Any, masks: Any, *, deterministic: bool) -> tuple[Any, ...]:
        """Returns values, actions, log-probabilities and hidden states, possibly more."""


class PolicyAgent:
    """An agent with a recurrent policy and its state between steps.

    Observations become float32 tensors with a single row, as in SoundSpaces batches.
    """

    def __init__(
        self, policy: Policy, *, hidden_size: int = 512, deterministic: bool = False, device: str = "cpu"
    ) -> None:
        """Wraps a policy.

        Args:
            policy: a SoundSpaces actor-critic with loaded weights.
            hidden_size: size of the recurrent state.
            deterministic: True for the best action, False to sample.
            device: torch device.
        """
        self._policy = policy
        self._deterministic = deterministic
        self._device = torch.device(device)
        self._shape = (policy.net.num_recurrent_layers, 1, hidden_size)
        self.reset()

    def reset(self) -> None:
        """Resets the recurrent state before an episode."""
        self._hidden = torch.zeros(self._shape, device=self._device)
        self._previous = torch.zeros(1, 1, dtype=torch.long, device=self._device)
        self._mask = torch.zeros(1, 1, device=self._device)

    def act(self, observations: Mapping[str, Any]) -> int:
        """Returns the policy's action number."""
        batch = {key: self._tensor(value) for key, value in observations.items() if isinstance(value, np.ndarray)}
        with torch.inference_mode():
            chosen = self._policy.act(
                batch, self._hidden, self._previous, self._mask, deterministic=self._deterministic
            )
        self._previous, self._hidden = chosen[1], chosen[3]
        self._mask = torch.ones(1, 1, device=self._device)
        return int(self._previous.item())

    def _tensor(self, value: Any) -> torch.Tensor:
        return torch.from_numpy(np.array(value, np.float32)).unsqueeze(0).to(self._device)
