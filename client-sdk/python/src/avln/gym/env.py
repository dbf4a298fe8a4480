"""A slot as a Gymnasium environment."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Callable

import gymnasium
from gymnasium import spaces

from avln.action import Action, Order
from avln.errors import EpisodeOverError, RunOverError
from avln.gym.runs import Runs
from avln.mission import Modality
from avln.observation import Observation
from avln.task import Sensors

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

    from avln.connect_options import ConnectOptions
    from avln.method_type import MethodType
    from avln.mission import Mission
    from avln.play import Episode

Reward = Callable[[Observation, Action, Observation], float]
"""Reward function: observation before the step, action, observation after it."""


def no_reward(_before: Observation, _action: Action, _after: Observation) -> float:
    """Returns 0 for every step: the server hides scores during an episode."""
    return 0.0


class LHAVLNEnv(gymnasium.Env[dict[str, Any], Any]):
    """A run slot.

    Actions are the values of `avln.Action`, 0 to 4; observations follow `ObservationSpace`.
    `terminated` means that the task ended the episode (Stop, or an extra Submit under `ends_episode`), `truncated` any
    other end.

    `reset` starts the next episode of the run. If the phase limits the number of runs, an
    explicit seed and a reset after the last episode are refused. Otherwise, as in practice,
    `reset(seed=…)` restarts the run with the same episodes in the same order, and runs follow
    each other without end.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 4}  # noqa: RUF012, as its base has it

    def __init__(
        self,
        server: str,
        token: str,
        phase: str = "",
        *,
        method: str = "gymnasium",
        method_type: MethodType | str | None = None,
        order: Order | str = Order.UNORDERED,
        sensors: Sensors | None = None,
        keys: Sequence[str] | None = None,
        goal_side: int = 128,
        reward: Reward = no_reward,
        connect_options: ConnectOptions | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Connects and starts a run.

        Args:
            server: address like `http://127.0.0.1:50051`.
            token: account token or run token.
            phase: id of the phase; empty for `Client.practice_phase`.
            method: name on the leaderboard.
            method_type: type of the method, `avln.MethodType` or its value, such as `rl`.
            order: goal order, `avln.Order` or its value.
            sensors: sensors and their settings; by default all at 256 x 256 pixels.
            keys: observation entries; by default all.
            goal_side: side of goal images, pixels.
            reward: reward function; by default 0.
            connect_options: connection options.
            render_mode: `rgb_array`, or None.

        Raises:
            Error: if the server refuses or the connection is lost.
            ValueError: if a key or `method_type` is unknown.
        """
        sensors = sensors or Sensors()
        self._runs = Runs(
            server,
            token,
            phase,
            method,
            Order(order),
            method_type=method_type,
            sensors=sensors,
            connect_options=connect_options,
        )
        self._layout = self._runs.lay_out(keys, goal_side)
        self._reward = reward
        self._episode: Episode | None = None
        self._mission: dict[str, Any] = {}
        self.render_mode = render_mode
        self.observation_space = self._layout.space
        self.action_space = spaces.Discrete(len(Action))

    @property
    def episode(self) -> Episode | None:
        """The current episode with mission, time and end; None before the first reset."""
        return self._episode

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Starts the next episode, or with a seed the first episode of another run.

        The info contains the mission: order, and per goal the modality with text or image.

        Raises:
            RunOverError: in counted runs, if no episode remains or a seed is given.
            ValueError: if options are given.
        """
        super().reset(seed=seed)
        refuse_options(options)
        if seed is not None:
            self._runs.begin_anew(f"reset was called with seed {seed}")
        episode = self._next_episode()
        if episode is None:
            self._runs.begin_anew("all episodes are played")
            episode = self._next_episode()
        if episode is None:
            raise RunOverError(self._runs.plays[0].run, self._runs.phase)
        self._episode, self._mission = episode, self._layout.mission(episode.mission)
        return self._observe(episode), mission_info(episode.mission)

    def _next_episode(self) -> Episode | None:
        play = self._runs.plays[0]
        self._runs.begin_episode_of(play)
        return play.receive_episode()

    def step(self, action: Any) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Takes a step.

        The info of the last step contains the end reason, and metrics if the phase shows them.

        Raises:
            EpisodeOverError: after the end, or before the first reset.
            Error: if the server refuses or the connection is lost.
        """
        episode = self._episode
        if episode is None:
            raise EpisodeOverError
        before, taken = episode.observation, Action(int(action))
        after = episode.act(taken)
        terminated, truncated = ended(episode)
        reward = float(self._reward(before, taken, after))
        return self._observe(episode), reward, terminated, truncated, end_info(episode)

    def _observe(self, episode: Episode) -> dict[str, Any]:
        return self._layout.observation(episode.observation, self._mission)

    def render(self) -> NDArray[np.uint8] | None:
        """Returns the agent's view, u8 [height, width, 3]; None without a colour image or render mode."""
        return self._episode.observation.rgb if self._episode and self.render_mode else None

    def close(self) -> None:
        """Ends the run and closes the connection."""
        if not self._closed:
            self._closed = True
            self._runs.close()

    _closed = False


def ended(episode: Episode) -> tuple[bool, bool]:
    """Returns the flags terminated and truncated."""
    return (False, False) if episode.end is None else (episode.end.terminated, not episode.end.terminated)


def end_info(episode: Episode) -> dict[str, Any]:
    """Returns the info of a step: empty before the end of the episode."""
    if episode.end is None:
        return {}
    shown = {metric.name: metric.value for metric in episode.end.metrics or ()}
    return {"end_reason": episode.end.reason.value, "metrics": shown}


def mission_info(mission: Mission) -> dict[str, Any]:
    """Returns the info of a reset: the mission with texts and unscaled images."""
    goals = [
        {"modality": goal.modality.name.lower()}
        | ({"image": goal.image} if goal.modality is Modality.IMAGE else {"text": goal.text})
        for goal in mission.goals
    ]
    return {"order": mission.order.value, "goals": goals}


def refuse_options(options: dict[str, Any] | None) -> None:
    """Rejects options of `reset`.

    Raises:
        ValueError: if options are given.
    """
    if options:
        raise ValueError(f"reset the environment: unsupported options {sorted(options)}; call reset without options")
