"""The task of the training examples: reach the sounding object and claim it.

A mission has a single goal, which sounds all the time; the agent claims it with Stop within the success region. The
agent hears with `ears` and measures obstacles with `lidar`. A single step does not tell front from back, so a policy
without memory receives the sound of the last steps with the agent's own motion.

    python examples/training/evaluate.py ppo.pt

evaluates a policy in houses that its training has not seen.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Callable

import gymnasium
import numpy as np
from curve import Curve
from gymnasium import spaces
from gymnasium.vector import AutoresetMode

import avln
import avln.sim

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

ACTIONS = np.array([avln.Action.MOVE_FORWARD, avln.Action.TURN_LEFT, avln.Action.TURN_RIGHT, avln.Action.STOP])
"""Actions of the task; without further goals, Submit has no effect."""
HEARD_STEPS = 8
"""Steps whose sound is in the features."""
TRAIN_STEPS, TEST_STEPS = 300, 1000
"""Step limits: short episodes give more starts in training; the evaluation has the limit of the benchmark."""
EPISODES_PER_SCENE = 200
"""Episodes of an environment in a house: the preparation of a house takes as long as thousands of steps."""
TRAIN_SEED, TEST_SEED = 1, 2_000_000
"""Seeds of houses for training (plus the seed of the run) and evaluation; houses of different seeds differ."""
LIDAR_M = 5.0
"""Larger distances look equal, metres."""
EARS_SCALE = np.array([50.0] * 12 + [0.5, 30.0, 1.0], np.float32)
"""Divisors of `ears`: levels in decibels, delay in milliseconds, direct sound in decibels, onset."""
STEP_M = 0.25
"""Length of a free forward step, metres."""


class ReachSound(gymnasium.vector.VectorEnv[Any, Any, Any]):
    """Training environments of the task, with features as observations: f32 [environments, features].

    The features are `lidar`, and for each of the last `HEARD_STEPS` steps, the newest first: `ears`, the action and the
    walked distance.
    """

    def __init__(self, num_envs: int, seed: int, curve: str | Path | None = None, **options: Any) -> None:
        """Starts the environments.

        Args:
            num_envs: environments.
            seed: seed of the houses.
            curve: file for the learning curve.
            options: other arguments of `avln.sim.VectorEnv`.
        """
        self._curve = None if curve is None else Curve(curve)
        self.envs = avln.sim.VectorEnv(
            num_envs,
            seed=seed,
            senses=("lidar", "ears"),
            goal_cues=False,
            autoreset_mode=AutoresetMode.SAME_STEP,
            privileged=True,
            episodes_per_scene=EPISODES_PER_SCENE,
            **{"curriculum": avln.sim.Curriculum(goals=(1, 1), max_steps=TRAIN_STEPS), **options},
        )
        self.num_envs = num_envs
        self.metadata, self.render_mode = self.envs.metadata, None
        rays = len(self.envs.single_observation_space.sample()["lidar"])
        self._lidar = np.zeros((num_envs, rays), np.float32)
        self._heard = np.zeros((num_envs, HEARD_STEPS, len(EARS_SCALE) + len(ACTIONS) + 1), np.float32)
        self._places = np.zeros((num_envs, 3), np.float32)
        self.features, self.actions = rays + self._heard[0].size, len(ACTIONS)
        self.single_observation_space = spaces.Box(-np.inf, np.inf, (self.features,), np.float32)
        self.single_action_space = spaces.Discrete(len(ACTIONS))
        self.observation_space = gymnasium.vector.utils.batch_space(self.single_observation_space, num_envs)
        self.action_space = gymnasium.vector.utils.batch_space(self.single_action_space, num_envs)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Starts new episodes; without a seed, those of the constructor's seed."""
        observations, infos = self.envs.reset(seed=seed, options=options)
        self._heard[:] = 0.0
        self._sense(observations, np.full(self.num_envs, -1))
        return self._features(), infos

    def step(self, actions: Any) -> tuple[NDArray[np.float32], Any, Any, Any, dict[str, Any]]:
        """Performs one of `ACTIONS` in each environment."""
        observations, rewards, terminated, truncated, infos = self.envs.step(ACTIONS[actions])
        is_over = terminated | truncated
        infos["is_success"] = np.zeros(self.num_envs, np.bool_)
        for env in np.flatnonzero(is_over):
            infos["is_success"][env] = infos["final_info"][env]["success"] > 0
        if self._curve is not None:
            self._curve.add(self.num_envs, infos["is_success"][is_over].tolist())
        self._heard[is_over] = 0.0
        self._sense(observations, np.where(is_over, -1, actions))
        return self._features(), rewards.astype(np.float32), terminated, truncated, infos

    def expert(self, infos: dict[str, Any]) -> NDArray[np.int64]:
        """Returns the teacher's actions, as indices in `ACTIONS`."""
        actions: NDArray[np.int64] = np.searchsorted(ACTIONS, infos["expert"])
        return actions

    def close_extras(self, **options: Any) -> None:
        """Ends the threads."""
        self.envs.close(**options)

    def _sense(self, observations: dict[str, Any], actions: NDArray[np.int64]) -> None:
        """Adds a step; action -1 is the start of an episode."""
        lidar, places = observations["lidar"], observations["pose"][:, :3]
        self._lidar[:] = np.where(lidar > 0.0, np.minimum(lidar, LIDAR_M), LIDAR_M) / LIDAR_M
        walked = np.linalg.norm(places - self._places, axis=1) / STEP_M
        self._places = places.copy()
        done = np.eye(len(ACTIONS) + 1, dtype=np.float32)[actions][:, :-1]
        columns = [observations["ears"] / EARS_SCALE, done, (walked * (actions >= 0))[:, None]]
        self._heard[:, 1:] = self._heard[:, :-1].copy()
        self._heard[:, 0] = np.concatenate(columns, axis=1)

    def _features(self) -> NDArray[np.float32]:
        return np.concatenate([self._lidar, self._heard.reshape(self.num_envs, -1)], axis=1)


Policy = Callable[["NDArray[np.float32]"], "NDArray[np.int64]"]
"""Returns an action per row of features."""


def evaluate(policy: Policy, episodes: int = 200, num_envs: int = 32, seed: int = TEST_SEED, **options: Any) -> float:
    """Returns the share of missions that a policy completes, in houses without training episodes."""
    mission = avln.sim.Curriculum(goals=(1, 1), max_steps=TEST_STEPS)
    envs = ReachSound(num_envs, seed, **{"scenes": 16, "curriculum": mission, **options})
    features, _ = envs.reset()
    # Equal numbers of episodes from each environment: short episodes would otherwise be more frequent.
    wanted = -(-episodes // num_envs)
    ended, complete = np.zeros(num_envs, np.int64), 0
    while ended.min() < wanted:
        features, _, terminated, truncated, infos = envs.step(policy(features))
        counts = (terminated | truncated) & (ended < wanted)
        complete += int((infos["is_success"] & counts).sum())
        ended += counts
    envs.close()
    return complete / (wanted * num_envs)
