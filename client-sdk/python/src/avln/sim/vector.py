"""Many environments on worker threads."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Callable

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from avln.action import Action
from avln.sim.options import (
    SENSES,
    Curriculum,
    Folder,
    Progress,
    Scan,
    SimError,
    known_render_mode,
    native,
    to_json,
)
from avln.sim.picture import HEIGHT_PX, draw

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

Arrays = dict[str, "NDArray[Any]"]
VectorReward = Callable[[Arrays, "NDArray[np.int64]", dict[str, Any]], "ArrayLike"]
"""Reward function: observations and infos after the step, and the actions; returns a number per environment."""
_ALIGNMENT = 64
"""JAX copies arrays that do not start at a multiple of these bytes."""

PAPER = Curriculum()
"""The missions of the benchmark."""
_FARTHEST_M = 10_000.0
_LOUDEST = 1e6
_MOST_DB = 300.0
_BUFFERS = 2


class VectorEnv(gymnasium.vector.VectorEnv[Any, Any, Any]):
    """Training environments that run on worker threads.

    Observations have the keys of `avln.gym.ObservationSpace`, with a leading axis for the environments. The arrays are
    allocated once and written in place by the threads, alternately in two buffers: an observation stays valid until the
    second step after it. With `batch_size`, `recv` copies the rows of the finished environments.

    The episodes depend only on `seed` and the source. Equal actions give equal bits for any number of threads.
    """

    metadata = {  # noqa: RUF012, as its base has it
        "render_modes": ["rgb_array"],
        "render_fps": 4,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(  # noqa: PLR0913, flat arguments suit gymnasium.make
        self,
        num_envs: int = 8,
        source: str | Folder | Scan = "paper",
        *,
        seed: int = 0,
        threads: int | None = None,
        batch_size: int | None = None,
        size: int | tuple[int, int] = 128,
        senses: Sequence[str] = SENSES,
        detail: str = "exact",
        curriculum: Curriculum = PAPER,
        scenes: int = 8,
        episodes_per_scene: int = 64,
        rules: str = "lh-avln-v1",
        goal_side: int = 64,
        goal_cues: bool = True,
        reward: str | Progress | VectorReward = "progress",
        privileged: bool | Sequence[str] = False,
        teacher: str = "path",
        autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
    ) -> None:
        """Starts the threads; raises `ValueError` if an option is out of range, or the source is not for training.

        Args:
            num_envs: environments.
            source: name of a recipe, whose training houses are drawn without end; a `Folder`; or a `Scan`.
            seed: seed of all draws, until `reset` gives another.
            threads: worker threads, 1 to 1024; by default one per processor.
            batch_size: environments per `recv`; all by default.
            size: image side, or width and height, pixels, 64 to 1024.
            senses: any of `rgb`, `depth` and `audio`, and for training only `lidar`, `ears` and `map`.
            detail: `exact`, or `half_pixel` for faster images of simplified surfaces, which servers do not have.
            curriculum: limits for missions and houses; by default those of the benchmark.
            scenes: scenes in use at the same time; environments with equal index modulo this number share one.
            episodes_per_scene: episodes of an environment before its next scene.
            rules: rule set.
            goal_side: side of goal images, pixels.
            goal_cues: True to add `goal_text` and `goal_image`.
            reward: `progress`, `sparse` or `none` (docs/training.md), coefficients of `progress`, or a function.
            privileged: training information in the infos: any of `targets`, `ids`, `top_down`; True for `targets`.
            teacher: author of `expert` in `targets`: `path` or `explore`.
            autoreset_mode: behaviour at the end of an episode, as in Gymnasium.
            render_mode: `rgb_array`, or None.
        """
        self._reward = None if isinstance(reward, (str, Progress)) else reward
        self._options: dict[str, Any] = {
            "source": source,
            "num_envs": num_envs,
            "threads": threads,
            "size": size,
            "senses": senses,
            "detail": detail,
            "curriculum": curriculum,
            "scenes": scenes,
            "episodes_per_scene": episodes_per_scene,
            "rules": rules,
            "goal_side": goal_side,
            "goal_cues": goal_cues,
            "reward": reward,
            "privileged": privileged,
            "teacher": teacher,
            "autoreset_mode": autoreset_mode,
        }
        self.num_envs, self.render_mode = num_envs, known_render_mode(render_mode)
        self.metadata = {**self.metadata, "autoreset_mode": autoreset_mode}
        self._begin(seed)
        self._set_batch_size(num_envs if batch_size is None else batch_size)
        self._make_spaces(4 + curriculum.added_submits)

    def _begin(self, seed: int) -> None:
        """Starts the native environments and their buffers."""
        self._native = native().NativeVector(to_json(seed=seed, **self._options))
        self._layout = self._native.layout()
        has_finals = self.metadata["autoreset_mode"] == AutoresetMode.SAME_STEP
        self._buffers = [self._arrays() for _ in range(_BUFFERS)]
        self._finals = [self._arrays() if has_finals else {} for _ in range(_BUFFERS)]
        for arrays, finals in zip(self._buffers, self._finals):
            self._native.add_buffer(list(arrays.values()), list(finals.values()), self.num_envs)
        self._observed = [name for name, *_, is_info in self._layout if not is_info]
        self._turn = np.zeros(self.num_envs, np.int64)
        self._actions = np.zeros(self.num_envs, np.int64)

    @property
    def running(self) -> int:
        """Number of environments with a task that `recv` has not returned."""
        return sum(self._native.running())

    def _set_batch_size(self, batch_size: int) -> None:
        self.batch_size = batch_size
        if not 1 <= batch_size <= self.num_envs:
            self._native.close()
            raise ValueError(f"`batch_size` is {batch_size}; 1 to {self.num_envs} are possible")

    def _arrays(self) -> Arrays:
        return {name: _zeros((self.num_envs, *shape), kind) for name, kind, shape, _ in self._layout}

    def _make_spaces(self, most_submits: int) -> None:
        farthest_m, max_steps = self._native.limits()
        most = {"depth": farthest_m, "lidar": farthest_m, "remaining": max(max_steps, most_submits)}
        known = {name: _space(name, kind, shape, most) for name, kind, shape, is_info in self._layout if not is_info}
        self.single_observation_space = spaces.Dict(known)
        self.single_action_space = spaces.Discrete(len(Action))
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Arrays, dict[str, Any]]:
        """Starts the next episode of all environments; with a seed, the first episode of another sequence.

        Options can contain Gymnasium's `reset_mask`, to reset some environments only.

        Raises:
            SimError: if a scene cannot be prepared.
            ValueError: if the seed is a list, or an option is unknown.
        """
        mask = dict(options or {}).pop("reset_mask", None)
        if set(options or {}) - {"reset_mask"}:
            raise ValueError(f"reset the environments: unsupported options {sorted(options or {})}")
        if isinstance(seed, list):
            raise ValueError("a list of seeds is not supported; one seed determines all environments")
        self._drain()
        if seed is not None:
            old = self._native
            self._begin(seed)
            old.close()
        envs = np.arange(self.num_envs) if mask is None else np.flatnonzero(self._mask(mask))
        turn = int((self._turn[0] + 1) % _BUFFERS)
        self._keep(turn, self._turn, np.setdiff1d(np.arange(self.num_envs), envs))
        self._turn[:] = turn
        self._native.send_resets(envs.tolist(), turn, envs.tolist())
        self._raise_errors(self._received(len(envs)))
        return self._observations(turn), self._infos(turn)

    def _mask(self, mask: ArrayLike) -> NDArray[np.bool_]:
        chosen = np.asarray(mask)
        if chosen.shape != (self.num_envs,) or chosen.dtype != np.bool_:
            raise ValueError(f"`reset_mask` is {mask!r}; use {self.num_envs} booleans")
        return chosen

    def _keep(self, turn: int, before: NDArray[np.int64], envs: NDArray[np.int64]) -> None:
        """Copies rows from the other buffer, for environments that wrote there last."""
        for env in envs[before[envs] != turn]:
            for name, array in self._buffers[turn].items():
                array[env] = self._buffers[before[env]][name][env]

    def step(self, actions: ArrayLike) -> tuple[Arrays, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Performs an action in each environment.

        Returns observations, rewards f64 [num_envs], terminated and truncated bool [num_envs], and infos.

        Raises:
            SimError: if an action is invalid, or an environment has no episode. All others have made their step; the
                error's `results` are those of the call.
        """
        self.step_async(actions)
        return self.step_wait()

    def step_async(self, actions: ArrayLike) -> None:
        """Starts a step of all environments.

        Raises:
            SimError: if a step is running.
        """
        if self.running:
            raise SimError("a step is running; call step_wait, recv or reset first")
        chosen = _whole("actions", actions)
        if chosen.shape != (self.num_envs,):
            raise ValueError(f"`actions` has shape {chosen.shape}; use ({self.num_envs},)")
        # After partial calls of `send`, environments can differ in their buffer; a step needs all in one.
        self._turn[:] = self._turn[0]
        self.send(chosen, np.arange(self.num_envs))

    def step_wait(self) -> tuple[Arrays, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Waits for the step of all environments; returns as `step`.

        Raises:
            SimError: as `step`, or if not all environments have a running step.
        """
        if self.running < self.num_envs:
            raise SimError(
                f"{self.running} of {self.num_envs} environments have a running step; call step_async or reset first"
            )
        results = self._received(self.num_envs)
        turn = int(self._turn[0])
        # After partial calls of `send`, environments can differ in their buffer.
        self._keep(turn, self._turn, np.arange(self.num_envs))
        rewards, terminated, truncated = self._flags(results)
        infos = self._infos(turn)
        self._add_finals(infos, np.arange(self.num_envs), terminated | truncated)
        self._turn[:] = turn
        observations = self._observations(turn)
        self._raise_errors(results, (observations, rewards, terminated, truncated, infos))
        if self._reward is not None:
            rewards[:] = _numbers(self._reward(observations, self._actions, infos))
        return observations, rewards, terminated, truncated, infos

    def send(self, actions: ArrayLike, env_ids: ArrayLike) -> None:
        """Starts a step of some environments, as in EnvPool.

        Raises:
            SimError: if one of them has a running step.
            ValueError: if an index is repeated or unknown, or the number of actions differs.
        """
        envs, chosen = _whole("env_ids", env_ids), _whole("actions", actions)
        self._check(envs, chosen)
        self._turn[envs] = (self._turn[envs] + 1) % _BUFFERS
        self._actions[envs] = chosen
        for turn in range(_BUFFERS):
            here = self._turn[envs] == turn
            rows = envs[here].tolist()
            self._native.send_steps(rows, chosen[here].tolist(), turn, rows)

    def _check(self, envs: NDArray[np.int64], actions: NDArray[np.int64]) -> None:
        if envs.ndim != 1 or actions.shape != envs.shape:
            raise ValueError(
                f"`actions` and `env_ids` have the shapes {actions.shape} and {envs.shape}; use equal lists"
            )
        if ((envs < 0) | (envs >= self.num_envs)).any() or len(np.unique(envs)) < len(envs):
            raise ValueError(f"`env_ids` is {envs.tolist()}; use different numbers from 0 to {self.num_envs - 1}")
        is_running = self._native.running()
        if running := [env for env in envs.tolist() if is_running[env]]:
            raise SimError(f"environments {running} have a running step; call recv first")

    def recv(self) -> tuple[Arrays, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Waits for `batch_size` environments, in the order of completion; their indices are `infos["env_id"]`.

        Returns as `step`, with copies of the rows of these environments.

        Raises:
            SimError: if fewer steps are running, or one has failed; the others are in the error's `results`.
        """
        if self.running < self.batch_size:
            raise SimError(
                f"{self.running} steps are running, fewer than the batch size {self.batch_size}; call send or reset"
            )
        results = self._received(self.batch_size)
        envs = np.array([result[0] for result in results])
        rows = {
            name: np.stack([self._buffers[self._turn[env]][name][env] for env in envs]) for name, *_ in self._layout
        }
        flags = [np.array([result[index] for result in results]) for index in (2, 3, 4)]
        infos: dict[str, Any] = {name: rows.pop(name) for name, _, _, is_info in self._layout if is_info}
        infos["env_id"] = envs
        self._add_finals(infos, envs, flags[1] | flags[2])
        self._raise_errors(results, (rows, *flags, infos))
        if self._reward is not None:
            flags[0][:] = _numbers(self._reward(rows, self._actions[envs], infos))
        return rows, flags[0], flags[1], flags[2], infos

    def state(self, env_id: int) -> bytes:
        """Returns the exact state of an environment between steps: the episode with all actions.

        Raises:
            ValueError: if it has no episode.
        """
        return bytes(self._native.state(env_id))

    def restore(self, env_id: int, state: bytes) -> tuple[Arrays, dict[str, Any]]:
        """Restores a state of any environment in this one by repeating its actions; returns its observation and info.

        The arrays have no leading axis. The environment's row in the last observation changes too. Running steps are
        awaited, and their results dropped.

        Raises:
            SimError: if the state belongs to other episodes.
            ValueError: if there is no such environment, or the bytes are no state.
        """
        self._drain()
        self._check(np.array([env_id]), np.zeros(1, np.int64))
        turn = int(self._turn[env_id])
        self._native.send_restore(env_id, state, turn, env_id)
        self._raise_errors(self._received(1))
        row = {name: array[env_id].copy() for name, array in self._buffers[turn].items()}
        return {name: row[name] for name in self._observed}, {
            name: row[name] for name, *_, is_info in self._layout if is_info
        }

    @property
    def observation_digest(self) -> str:
        """Name of the observation's exact definition, 16 hexadecimal digits: record it with a trained model."""
        return str(self._native.observation_digest())

    def picture(self, env_id: int) -> NDArray[np.uint8]:
        """Returns the agent's view next to a map, u8 [512, 1024, 3] (docs/training.md).

        Raises:
            ValueError: if the environment has no episode.
        """
        return draw(*self._native.overview(env_id, HEIGHT_PX))

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Returns a picture per environment as `picture` does; None without a render mode."""
        return tuple(self.picture(env) for env in range(self.num_envs)) if self.render_mode else None

    def close_extras(self, **_: Any) -> None:
        """Ends the threads."""
        self._native.close()

    def _drain(self) -> None:
        if self.running:
            self._received(self.running)

    def _received(self, count: int) -> list[Any]:
        """Waits for results; Ctrl-C leaves them for the next call."""
        return list(self._native.recv(count))

    def _observations(self, turn: int) -> Arrays:
        return {name: self._buffers[turn][name] for name in self._observed}

    def _infos(self, turn: int) -> dict[str, Any]:
        return {name: self._buffers[turn][name] for name, *_, is_info in self._layout if is_info}

    def _flags(self, results: list[Any]) -> list[NDArray[Any]]:
        flags: list[NDArray[Any]] = [np.zeros(self.num_envs, kind) for kind in (np.float64, np.bool_, np.bool_)]
        envs, _, *columns, _ = zip(*results)
        for array, values in zip(flags, columns):
            array[list(envs)] = values
        return flags

    def _add_finals(self, infos: dict[str, Any], envs: NDArray[Any], is_over: NDArray[Any]) -> None:
        if not self._finals[0] or not is_over.any():
            return
        observations, details = (np.full(len(envs), None, object) for _ in range(2))
        for row in np.flatnonzero(is_over):
            finals = {name: array[envs[row]].copy() for name, array in self._finals[self._turn[envs[row]]].items()}
            observations[row] = {name: finals[name] for name in self._observed}
            details[row] = {name: finals[name] for name, *_, is_info in self._layout if is_info}
        infos.update(final_obs=observations, _final_obs=is_over.copy(), final_info=details, _final_info=is_over.copy())

    @staticmethod
    def _raise_errors(results: list[Any], returned: Any = None) -> None:
        messages = [message for *_, message in results if message]
        if messages:
            error = SimError("; ".join(sorted(set(messages))))
            error.results = returned
            raise error


def _whole(name: str, values: ArrayLike) -> NDArray[np.int64]:
    """Returns integers; raises `ValueError` for other numbers, which NumPy would round."""
    numbers = np.asarray(values)
    if numbers.size and not np.issubdtype(numbers.dtype, np.integer):
        raise ValueError(f"`{name}` is {values!r}; use whole numbers")
    return numbers.astype(np.int64)


def _numbers(rewards: ArrayLike | None) -> ArrayLike:
    """Returns the rewards of a function; raises `ValueError` without them, which NumPy would convert to `nan`."""
    if rewards is None:
        raise ValueError("the reward function returned None; return a number per environment")
    return rewards


def _zeros(shape: tuple[int, ...], kind: str) -> NDArray[Any]:
    size = int(np.prod(shape)) * np.dtype(kind).itemsize
    memory = np.zeros(size + _ALIGNMENT, np.uint8)
    start = -memory.ctypes.data % _ALIGNMENT
    return memory[start : start + size].view(kind).reshape(shape)


def _space(name: str, kind: str, shape: list[int], most: dict[str, float]) -> spaces.Space[Any]:
    dtype = np.dtype(kind).type
    if name == "feedback":
        return spaces.Discrete(4)
    if name == "order":
        return spaces.Discrete(2)
    if name == "goal_modality":
        return spaces.MultiDiscrete([4] * shape[0])
    if name == "pose":
        farthest = np.array([_FARTHEST_M] * 3 + [np.pi + 1e-3], np.float32)
        return spaces.Box(-farthest, farthest, dtype=np.float32)
    lowest, highest = {
        "audio": (-_LOUDEST, _LOUDEST),
        "ears": (-_MOST_DB, _MOST_DB),
        "map": (0, 2),
    }.get(name, (0, most.get(name, 255)))
    return spaces.Box(lowest, highest, tuple(shape), dtype)
