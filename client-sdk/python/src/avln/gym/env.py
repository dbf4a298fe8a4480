"""One slot as a Gymnasium environment."""

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

    from avln.link import Link
    from avln.mission import Mission
    from avln.play import Episode

Reward = Callable[[Observation, Action, Observation], float]
"""What a step is worth: the observation before it, the action, the observation after it."""


def no_reward(_before: Observation, _action: Action, _after: Observation) -> float:
    """Every step is worth 0: scores are the server's, and it tells none while an episode goes on."""
    return 0.0


class LHAVLNEnv(gymnasium.Env[dict[str, Any], Any]):
    """One slot of a run.

    Actions are `avln.Action`'s values, 0 to 4; observations are as `ObservationSpace` has them. `terminated` says that
    the task itself ended the episode (Stop, the last Submit), `truncated` that anything else did.

    `reset` begins the next episode of the run. Where the phase limits how many runs a team has, that is all: an
    explicit seed is refused, and so is a reset after the last episode. Elsewhere, as in practice, `reset(seed=…)`
    begins the run anew, so that the same episodes come in the same order, and runs follow one another without end.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 4}  # noqa: RUF012, as its base has it

    def __init__(
        self,
        server: str,
        token: str,
        phase: str = "",
        *,
        method: str = "gymnasium",
        order: Order | str = Order.UNORDERED,
        sensors: Sensors | None = None,
        keys: Sequence[str] | None = None,
        goal_side: int = 128,
        reward: Reward = no_reward,
        link: Link | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Connects and begins a run.

        Args:
            server: address like `http://127.0.0.1:50051`.
            token: the account's, or one run's.
            phase: id of the phase; empty for `Arena.practice_phase`.
            method: name on the leaderboard.
            order: `avln.Order`, or its word.
            sensors: which sensors, and how; by default all at 256 x 256 pixels.
            keys: which entries observations have; by default all.
            goal_side: pixels a side of the pictures of goals.
            reward: what a step is worth; by default nothing.
            link: how to connect, where the defaults do not do.
            render_mode: `rgb_array`, or None.

        Raises:
            Error: when the server refuses or the connection is lost.
            ValueError: when a key is no entry.
        """
        sensors = sensors or Sensors()
        self._runs = Runs(server, token, phase, method, Order(order), sensors=sensors, link=link)
        self._layout = self._runs.lay_out(keys, goal_side)
        self._reward = reward
        self._episode: Episode | None = None
        self._mission: dict[str, Any] = {}
        self.render_mode = render_mode
        self.observation_space = self._layout.space
        self.action_space = spaces.Discrete(len(Action))

    @property
    def episode(self) -> Episode | None:
        """The episode that is being played, with its mission, time and end; None before the first reset."""
        return self._episode

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begins the next episode, or with a seed the first one of another run.

        The info holds the mission: its order, and of each goal its modality with words or picture.

        Raises:
            RunOverError: where runs are counted, when no episode is left or a seed is given.
            ValueError: when there are options, of which there are none.
        """
        super().reset(seed=seed)
        refuse_options(options)
        if seed is not None:
            self._runs.begin_anew(f"reset was called with seed {seed}")
        episode = self._next_episode()
        if episode is None:
            self._runs.begin_anew("its episodes are played")
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
        """Takes one step.

        The info of an episode's last step holds its end reason, and metrics where the phase shows them.

        Raises:
            EpisodeOverError: after the end, or before the first reset.
            Error: when the server refuses or the connection is lost.
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
        """What the agent sees, u8 [height, width, 3]; None without a colour picture or a render mode."""
        return self._episode.observation.rgb if self._episode and self.render_mode else None

    def close(self) -> None:
        """Ends the run and closes the connection."""
        if not self._closed:
            self._closed = True
            self._runs.close()

    _closed = False


def ended(episode: Episode) -> tuple[bool, bool]:
    """Whether an episode is terminated, and whether it is truncated."""
    return (False, False) if episode.end is None else (episode.end.terminated, not episode.end.terminated)


def end_info(episode: Episode) -> dict[str, Any]:
    """What the info of a step tells: nothing before an episode's end."""
    if episode.end is None:
        return {}
    shown = {metric.name: metric.value for metric in episode.end.metrics or ()}
    return {"end_reason": episode.end.reason.value, "metrics": shown}


def mission_info(mission: Mission) -> dict[str, Any]:
    """What the info of a reset tells: the mission in words and pictures of their own sizes."""
    goals = [
        {"modality": goal.modality.name.lower()}
        | ({"image": goal.image} if goal.modality is Modality.IMAGE else {"text": goal.text})
        for goal in mission.goals
    ]
    return {"order": mission.order.value, "goals": goals}


def refuse_options(options: dict[str, Any] | None) -> None:
    """Refuses options of `reset`.

    Raises:
        ValueError: when there are any.
    """
    if options:
        raise ValueError(f"reset with options {sorted(options)}: there are none; leave them out")
