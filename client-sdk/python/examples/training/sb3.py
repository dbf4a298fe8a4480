"""PPO of Stable-Baselines3 on the task of reach_sound.py.

python examples/training/sb3.py --steps 2000000 --out sb3.zip
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from network import HIDDEN
from reach_sound import TRAIN_SEED, ReachSound
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv, VecMonitor

REWARD_SCALE = 0.1


class Sb3Envs(VecEnv):
    """`ReachSound` with the interface of Stable-Baselines3."""

    def __init__(self, envs: ReachSound) -> None:
        """Wraps environments."""
        self.envs = envs
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)
        self._actions = np.zeros(envs.num_envs, np.int64)

    def reset(self) -> Any:
        """Starts new episodes."""
        return self.envs.reset()[0]

    def step_async(self, actions: Any) -> None:
        """Stores the actions of the next step."""
        self._actions = actions

    def step_wait(self) -> Any:
        """Performs the step."""
        seen, rewards, terminated, truncated, infos = self.envs.step(self._actions)
        details: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for env in np.flatnonzero(terminated | truncated):
            details[env]["is_success"] = bool(infos["is_success"][env])
        return seen, rewards * REWARD_SCALE, terminated | truncated, details

    def close(self) -> None:
        """Ends the environments."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Returns an attribute of the environments, which all share."""
        return [getattr(self.envs, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Sets nothing: environments have no attributes of their own."""
        raise NotImplementedError(attr_name)

    def env_method(self, method_name: str, *_args: Any, indices: Any = None, **_options: Any) -> list[Any]:
        """Calls nothing: environments have no methods of their own."""
        raise NotImplementedError(method_name)

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Returns False for every environment."""
        return [False] * len(list(self._get_indices(indices)))


def train(seed: int, steps: int, curve: str, num_envs: int = 128, **options: Any) -> PPO:
    """Trains for some steps; curve and options are those of `ReachSound`."""
    envs = VecMonitor(Sb3Envs(ReachSound(num_envs, TRAIN_SEED + seed, curve, **options)))
    model = PPO(
        "MlpPolicy",
        envs,
        learning_rate=5e-4,
        n_steps=64,
        batch_size=16 * num_envs,
        n_epochs=3,
        ent_coef=0.01,
        policy_kwargs={"net_arch": [HIDDEN, HIDDEN]},
        seed=seed,
        device="cpu",
    )
    model.learn(steps)
    envs.close()
    return model


def main(arguments: list[str] | None = None) -> None:
    """Runs the command line."""
    program = argparse.ArgumentParser("sb3", description="Train PPO of Stable-Baselines3")
    program.add_argument("--steps", type=int, default=2_000_000, help="training steps [2000000]")
    program.add_argument("--seed", type=int, default=1, help="seed of houses and weights [1]")
    program.add_argument("--out", default="sb3.zip", help="file for the policy [sb3.zip]")
    options = program.parse_args(arguments)
    train(options.seed, options.steps, f"{options.out}.csv").save(options.out)


if __name__ == "__main__":
    main()
