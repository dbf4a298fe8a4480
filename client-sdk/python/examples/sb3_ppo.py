"""Training of PPO (Stable-Baselines3) in a practice phase, on the CPU.

python examples/sb3_ppo.py --token TOKEN --steps 2000

The only reward is for unvisited cells, so the agent learns to move; it needs no hidden data.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import gymnasium
import torch
from stable_baselines3 import PPO

import avln
import avln.gym
from avln.options import add_connection, add_run, connect_options, parser

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

CELL_M = 0.5
SIDE = 64


class NewGround:
    """A reward of 1 for every new cell of half a metre in an episode, minus 0.01 per step."""

    def __init__(self) -> None:
        self.seen: set[tuple[int, int]] = set()

    def __call__(self, before: avln.Observation, _action: avln.Action, after: avln.Observation) -> float:
        """Returns the reward of a step."""
        if before.step == 0:
            self.seen = set()
        cell = round(after.pose.x_m / CELL_M), round(after.pose.z_m / CELL_M)
        is_new = cell not in self.seen
        self.seen.add(cell)
        return float(is_new) - 0.01


def train(server: str, token: str, phase: str, steps: int, **options: Any) -> BaseAlgorithm:
    """Trains for `steps` steps; `options` are environment arguments."""
    env = gymnasium.make(
        avln.gym.ENV_ID,
        server=server,
        token=token,
        phase=phase,
        sensors=avln.Sensors(audio=False, width=SIDE, height=SIDE),
        keys=["depth", "pose"],
        reward=NewGround(),
        **options,
    )
    torch.set_num_threads(1)  # a small network is slower with several threads
    model = PPO("MultiInputPolicy", env, n_steps=256, batch_size=64, device="cpu", seed=None)
    model.learn(total_timesteps=steps)
    env.close()
    return model


def main(arguments: list[str] | None = None) -> None:
    """Runs the command line."""
    program = parser("sb3_ppo", "Train PPO in a practice phase")
    add_connection(program)
    add_run(program, method="ppo", method_type=avln.MethodType.RL)
    program.add_argument("--steps", type=int, default=2000, help="training steps [2000]")
    program.add_argument("--out", default="ppo.zip", help="file for the policy [ppo.zip]")
    options = program.parse_args(arguments)
    rest = {
        "method": options.method,
        "method_type": options.method_type,
        "order": options.order,
        "connect_options": connect_options(options),
    }
    train(options.server, options.token, options.phase, options.steps, **rest).save(options.out)
    print(f"wrote {options.out}")


if __name__ == "__main__":
    main()
