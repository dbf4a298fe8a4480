"""Imitation of the teacher by DAgger (Ross et al. 2011).

    python examples/training/dagger.py --minutes 10 --seed 1 --out dagger.pt

The network plays; the teacher names the right action in every visited state, and the network learns all answers so far.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from network import Network
from reach_sound import TRAIN_SEED, ReachSound
from torch.nn.functional import cross_entropy


@dataclass(frozen=True)
class Settings:
    """Hyperparameters."""

    num_envs: int = 64
    steps: int = 64
    """Steps per environment and round."""
    memory: int = 400_000
    """Largest number of stored states; the oldest are dropped."""
    batches: int = 60
    """Batches per round."""
    batch_size: int = 1024
    rate: float = 1e-3
    teacher_rounds: int = 5
    """Rounds in which the share of the teacher's actions falls from 1 to 0."""


class Memory:
    """States with the teacher's actions."""

    def __init__(self, size: int, features: int) -> None:
        """Reserves the memory."""
        self.features = torch.zeros(size, features)
        self.actions = torch.zeros(size, dtype=torch.long)
        self.count = 0

    def add(self, features: torch.Tensor, actions: torch.Tensor) -> None:
        """Adds states, in place of the oldest ones if the memory is full."""
        places = (self.count + torch.arange(len(actions))) % len(self.actions)
        self.features[places], self.actions[places] = features, actions
        self.count += len(actions)

    def draw(self, count: int) -> tuple[torch.Tensor, torch.Tensor]:
        """Returns states at random."""
        places = torch.randint(min(self.count, len(self.actions)), (count,))
        return self.features[places], self.actions[places]


def train(seed: int, minutes: float, out: str, settings: Settings | None = None, **options: Any) -> Network:
    """Trains for some minutes; writes the network to `out`, and the learning curve to `out`.csv."""
    settings = settings or Settings()
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    envs = ReachSound(settings.num_envs, TRAIN_SEED + seed, f"{out}.csv", **options)
    network = Network(envs.features, envs.actions)
    optimiser = torch.optim.Adam(network.parameters(), lr=settings.rate)
    memory = Memory(settings.memory, envs.features)
    seen, infos = envs.reset()
    began, round_number = time.monotonic(), 0
    while time.monotonic() - began < 60.0 * minutes:
        teacher_share = max(1.0 - round_number / settings.teacher_rounds, 0.0)
        for _ in range(settings.steps):
            expert = envs.expert(infos)
            memory.add(torch.from_numpy(seen), torch.from_numpy(expert))
            is_taught = rng.random(settings.num_envs) < teacher_share
            actions = np.where(is_taught, expert, network.act(seen))
            seen, _, _, _, infos = envs.step(actions)
        for _ in range(settings.batches):
            features, right = memory.draw(settings.batch_size)
            loss = cross_entropy(network(features)[0].logits, right)
            optimiser.zero_grad()
            torch.autograd.backward(loss)
            optimiser.step()
        round_number += 1
    network.save(out)
    envs.close()
    return network


def main(arguments: list[str] | None = None) -> None:
    """Runs the command line."""
    program = argparse.ArgumentParser("dagger", description="Imitate the teacher's way to a sounding object")
    program.add_argument("--minutes", type=float, default=10.0, help="training time [10]")
    program.add_argument("--seed", type=int, default=1, help="seed of houses and weights [1]")
    program.add_argument("--out", default="dagger.pt", help="file for the network [dagger.pt]")
    options = program.parse_args(arguments)
    train(options.seed, options.minutes, options.out)


if __name__ == "__main__":
    main()
