"""A single training environment."""

from __future__ import annotations

from operator import index
from typing import TYPE_CHECKING, Any, Callable

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from avln.sim.options import Progress, SimError, known_render_mode
from avln.sim.vector import VectorEnv

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from avln.sim.options import Folder, Scan

Reward = Callable[[dict[str, Any], int, dict[str, Any]], float]
"""Reward function: observation and info after the step, and the action."""


class Env(gymnasium.Env[dict[str, Any], Any]):
    """A training environment; the arguments are those of `VectorEnv`.

    `terminated` means that the task ended the episode (Stop, or an extra Submit under `ends_episode`), `truncated` the
    step limit.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 4}  # noqa: RUF012, as its base has it

    def __init__(
        self,
        source: str | Folder | Scan = "paper",
        *,
        reward: str | Progress | Reward = "progress",
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        """Creates the environment.

        Args:
            source: as for `VectorEnv`.
            reward: `progress`, `sparse` or `none`, coefficients of `progress`, or a function.
            render_mode: `rgb_array`, or None.
            options: other arguments of `VectorEnv`; by default one house and one thread.

        Raises:
            ValueError: if an option is out of range, or the source is not for training.
        """
        self._reward = None if isinstance(reward, (str, Progress)) else reward
        rule = reward if isinstance(reward, (str, Progress)) else "none"
        self.render_mode = known_render_mode(render_mode)
        if unsuitable := {"autoreset_mode", "batch_size"} & options.keys():
            raise TypeError(f"Env has no {', '.join(sorted(unsuitable))}; use VectorEnv")
        few = {"scenes": 1, "threads": 1, **options}
        self._vector = VectorEnv(1, source, reward=rule, autoreset_mode=AutoresetMode.DISABLED, **few)
        self._seen: dict[str, Any] = {}
        self.observation_space = self._vector.single_observation_space
        self.action_space = self._vector.single_action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Starts the next episode; with a seed, the first episode of another sequence.

        Raises:
            SimError: if a scene cannot be prepared.
            ValueError: if options are given, or the seed is negative.
        """
        if seed is not None:
            seed = index(seed)
            if seed < 0:
                raise ValueError(f"`seed` is {seed}; use a number from 0 on")
        super().reset(seed=seed)
        observations, infos = self._vector.reset(seed=seed, options=options)
        self._seen = _first(observations)
        return self._seen, _first(infos)

    def step(self, action: Any) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Performs an action.

        Raises:
            SimError: if the action is invalid, the episode has ended, or Ctrl-C interrupted the last step.
            TypeError: if the action is no whole number.
        """
        action = index(action)
        if self._vector.running:
            raise SimError("the last step was interrupted; call reset")
        observations, rewards, terminated, truncated, infos = self._vector.step([action])
        self._seen, info = _first(observations), _first(infos)
        reward = float(rewards[0]) if self._reward is None else float(self._reward(self._seen, action, info))
        return self._seen, reward, bool(terminated[0]), bool(truncated[0]), info

    def state(self) -> bytes:
        """Returns the exact state: the episode with all actions.

        Raises:
            ValueError: before the first reset.
        """
        return self._vector.state(0)

    def restore(self, state: bytes) -> tuple[dict[str, Any], dict[str, Any]]:
        """Restores a state by repeating its actions; returns its observation and info.

        Raises:
            SimError: if the state belongs to other episodes.
        """
        self._seen, info = self._vector.restore(0, state)
        return self._seen, info

    def render(self) -> NDArray[np.uint8] | None:
        """Returns the agent's view next to a map with path, sound and targets, u8 [512, 1024, 3].

        None without a render mode.

        Raises:
            ValueError: before the first reset.
        """
        return self._vector.picture(0) if self.render_mode else None

    def close(self) -> None:
        """Ends the thread."""
        self._vector.close()


def _first(arrays: dict[str, Any]) -> dict[str, Any]:
    """Returns copies of the first rows, which later steps do not change."""
    return {name: np.array(array[0]) if array.ndim > 1 else array[0] for name, array in arrays.items()}
