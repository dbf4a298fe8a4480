"""Several run slots as a Gymnasium vector environment."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from avln.action import Action, Order
from avln.errors import RunOverError
from avln.gym.env import Reward, end_info, ended, mission_info, no_reward, refuse_options
from avln.gym.runs import Runs
from avln.task import Sensors

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from avln.connect_options import ConnectOptions
    from avln.gym.spaces import ObservationSpace
    from avln.method_type import MethodType
    from avln.play import Episode, Play

Arrays = dict[str, Any]
Stepped = tuple[Arrays, "NDArray[np.float64]", "NDArray[np.bool_]", "NDArray[np.bool_]", Arrays]


class _Slot:
    """A slot between two steps."""

    def __init__(self, play: Play, layout: ObservationSpace) -> None:
        self.play = play
        self.layout = layout
        self.episode: Episode | None = None
        self.mission: Arrays = {}
        self.observation: Arrays = {key: np.zeros(s.shape, s.dtype) for key, s in layout.space.spaces.items()}
        self.asked = False
        """True if the next episode was requested."""

    @property
    def is_playing(self) -> bool:
        return self.episode is not None and not self.episode.is_over

    def begin(self) -> Arrays:
        """Receives the requested episode; returns the info."""
        self.asked = False
        episode = self.play.receive_episode()
        if episode is None:
            return {}
        self.episode, self.mission = episode, self.layout.mission(episode.mission)
        self.observation = self.layout.observation(episode.observation, self.mission)
        return mission_info(episode.mission)


class LHAVLNVectorEnv(VectorEnv[Arrays, Any, Any]):
    """A run's slots, which step together; the server simulates them in parallel.

    Episodes follow each other by `AutoresetMode.NEXT_STEP`: the step after an end ignores the
    action and returns the first observation of the next episode. A slot without a remaining
    episode is idle: `info["idle"]` is True, actions are ignored and the observation is constant.
    If all slots are idle, the next step starts another run if the phase does not limit runs, and
    raises `RunOverError` otherwise. For the other arguments see `LHAVLNEnv`.
    """

    metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP, "render_modes": []}  # noqa: RUF012, as its base has it

    def __init__(
        self,
        num_envs: int,
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
    ) -> None:
        """Connects and begins a run with `num_envs` slots.

        Raises:
            Error: if the server refuses, grants fewer slots or the connection is lost.
            ValueError: if a key or `method_type` is unknown.
        """
        super().__init__()
        self.closed = True  # until the run is open
        sensors = sensors or Sensors()
        self._runs = Runs(
            server,
            token,
            phase,
            method,
            Order(order),
            method_type=method_type,
            sensors=sensors,
            slots=num_envs,
            connect_options=connect_options,
        )
        self._layout = self._runs.lay_out(keys, goal_side)
        self.closed = False
        self._reward = reward
        self.num_envs = num_envs
        self.single_observation_space = self._layout.space
        self.single_action_space = spaces.Discrete(len(Action))
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._slots = self._open_slots()

    @property
    def episodes(self) -> list[Episode | None]:
        """The episode per slot, with mission, time and end."""
        return [slot.episode for slot in self._slots]

    def _open_slots(self) -> list[_Slot]:
        return [_Slot(play, self._layout) for play in self._runs.plays]

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Arrays, Arrays]:
        """Starts the next episode in every slot, or with a seed the first episodes of another run.

        Raises:
            RunOverError: in counted runs, if no episode remains or a seed is given.
            ValueError: if options are given.
        """
        refuse_options(options)
        if seed is not None:
            super().reset(seed=seed if isinstance(seed, int) else None)
            self._begin_anew(f"reset was called with seed {seed}")
        for slot in self._slots:
            if slot.is_playing and slot.episode is not None:
                slot.episode.abandon()
        if self._runs.plays[0].progress.waiting == 0:
            self._begin_anew("all episodes are played")
        return self._begin_all()

    def _begin_anew(self, because: str) -> None:
        self._runs.begin_anew(because)
        self._slots = self._open_slots()

    def _begin_all(self) -> tuple[Arrays, Arrays]:
        self._ask_for_episodes()
        infos: Arrays = {}
        for number, slot in enumerate(self._slots):
            info = slot.begin() if slot.asked else {}
            infos = self._add_info(infos, {**info, "idle": not slot.is_playing}, number)
        return self._stacked(), infos

    def step(self, actions: Any) -> Stepped:
        """Takes a step in every slot; starts the next episode after an end.

        Raises:
            RunOverError: in counted runs, if no episode remains.
            Error: if the server refuses or the connection is lost.
        """
        waiting = self._runs.plays[0].progress.waiting
        if waiting == 0 and not any(slot.is_playing for slot in self._slots):
            return self._step_into_another_run()
        acting = [slot.is_playing for slot in self._slots]
        taken = [Action(int(action)) for action in actions]
        for slot, action, acts in zip(self._slots, taken, acting):
            if acts and slot.episode is not None:
                slot.episode.send(action)
        self._ask_for_episodes()
        return self._received(taken, acting)

    def _ask_for_episodes(self) -> None:
        """Requests the remaining episodes for idle slots; a further request would wait for the end of the run."""
        waiting = self._runs.plays[0].progress.waiting
        idle = [slot for slot in self._slots if not slot.is_playing]
        for slot in idle[:waiting]:
            self._runs.begin_episode_of(slot.play)
            slot.asked = True

    def _received(self, taken: Sequence[Action], acting: Sequence[bool]) -> Stepped:
        rewards = np.zeros(self.num_envs, np.float64)
        flags = np.zeros((2, self.num_envs), np.bool_)
        infos: Arrays = {}
        for number, slot in enumerate(self._slots):
            info: Arrays = {}
            if acting[number] and slot.episode is not None:
                before = slot.episode.observation
                after = slot.episode.receive()
                rewards[number] = self._reward(before, taken[number], after)
                slot.observation = self._layout.observation(after, slot.mission)
                flags[:, number] = ended(slot.episode)
                info = end_info(slot.episode)
            elif slot.asked:
                info = slot.begin()
            is_idle = not (acting[number] or slot.is_playing)
            infos = self._add_info(infos, {**info, "idle": is_idle}, number)
        return self._stacked(), rewards, flags[0], flags[1], infos

    def _step_into_another_run(self) -> Stepped:
        if self._runs.is_counted:
            raise RunOverError(self._runs.plays[0].run, self._runs.phase)
        self._begin_anew("all episodes are played")
        observations, infos = self._begin_all()
        nothing = np.zeros(self.num_envs, np.bool_)
        return observations, np.zeros(self.num_envs), nothing, nothing.copy(), infos

    def _stacked(self) -> Arrays:
        return {key: np.stack([slot.observation[key] for slot in self._slots]) for key in self._layout.space.spaces}

    def close_extras(self, **_kwargs: Any) -> None:
        """Ends the run and closes the connection."""
        self._runs.close()
