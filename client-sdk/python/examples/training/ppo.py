"""Proximal policy optimisation, after the formulas of Schulman et al. (2017), with the network of network.py.

    python examples/training/ppo.py --minutes 30 --seed 1 --out ppo.pt

trains on the task of reach_sound.py and writes the learning curve to ppo.pt.csv.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from typing import Any

import torch
from network import Network
from reach_sound import TRAIN_SEED, ReachSound
from torch.nn.functional import mse_loss


@dataclass(frozen=True)
class Settings:
    """Hyperparameters."""

    num_envs: int = 128
    steps: int = 64
    """Steps per environment and update."""
    epochs: int = 3
    batches: int = 4
    """Batches per epoch."""
    rate: float = 5e-4
    """Initial learning rate; it falls linearly to 0."""
    discount: float = 0.99
    trace: float = 0.95
    """Lambda of the generalised advantage estimate (Schulman et al. 2016)."""
    clip: float = 0.2
    entropy: float = 0.01
    value: float = 0.5
    """Weight of the value loss."""
    largest_gradient: float = 0.5
    reward_scale: float = 0.1


@dataclass
class Rollout:
    """Steps of all environments; the first axis is time."""

    features: torch.Tensor
    actions: torch.Tensor
    log_probs: torch.Tensor
    rewards: torch.Tensor
    ends: torch.Tensor
    values: torch.Tensor

    @classmethod
    def empty(cls, steps: int, num_envs: int, features: int) -> Rollout:
        """Returns a rollout of zeros."""
        numbers = [torch.zeros(steps, num_envs) for _ in range(4)]
        actions = torch.zeros(steps, num_envs, dtype=torch.long)
        return cls(torch.zeros(steps, num_envs, features), actions, *numbers)

    def advantages(self, last_value: torch.Tensor, settings: Settings) -> torch.Tensor:
        """Returns the generalised advantage estimates."""
        advantages = torch.zeros_like(self.rewards)
        after, value = torch.zeros_like(last_value), last_value
        for step in reversed(range(len(self.rewards))):
            goes_on = 1.0 - self.ends[step]
            error = self.rewards[step] + settings.discount * value * goes_on - self.values[step]
            after = error + settings.discount * settings.trace * goes_on * after
            advantages[step], value = after, self.values[step]
        return advantages


class Trainer:
    """Environments, network and optimiser."""

    def __init__(self, seed: int, settings: Settings, curve: str, **options: Any) -> None:
        """Starts the environments; curve and options are those of `ReachSound`."""
        torch.manual_seed(seed)
        self.settings = settings
        self.envs = ReachSound(settings.num_envs, TRAIN_SEED + seed, curve, **options)
        self.network = Network(self.envs.features, self.envs.actions)
        self.optimiser = torch.optim.Adam(self.network.parameters(), lr=settings.rate, eps=1e-5)
        self.rollout = Rollout.empty(settings.steps, settings.num_envs, self.envs.features)
        self.seen = torch.from_numpy(self.envs.reset()[0])

    def play(self) -> torch.Tensor:
        """Fills the rollout; returns the value after it."""
        rollout = self.rollout
        with torch.no_grad():
            for step in range(self.settings.steps):
                choice, values = self.network(self.seen)
                actions = choice.sample()
                rollout.features[step], rollout.actions[step], rollout.values[step] = self.seen, actions, values
                rollout.log_probs[step] = choice.log_prob(actions)
                seen, rewards, terminated, truncated, _ = self.envs.step(actions.numpy())
                rollout.rewards[step] = torch.from_numpy(rewards) * self.settings.reward_scale
                rollout.ends[step] = torch.from_numpy(terminated | truncated)
                self.seen = torch.from_numpy(seen)
            value: torch.Tensor = self.network(self.seen)[1]
            return value

    def learn(self, last_value: torch.Tensor) -> None:
        """Updates the network with the rollout."""
        settings, rollout = self.settings, self.rollout
        advantages = rollout.advantages(last_value, settings).flatten()
        targets = advantages + rollout.values.flatten()
        features = rollout.features.flatten(0, 1)
        actions, log_probs = rollout.actions.flatten(), rollout.log_probs.flatten()
        for _ in range(settings.epochs):
            for rows in torch.randperm(len(actions)).chunk(settings.batches):
                choice, values = self.network(features[rows])
                ratios = (choice.log_prob(actions[rows]) - log_probs[rows]).exp()
                gains = advantages[rows]
                gains = (gains - gains.mean()) / (gains.std() + 1e-8)
                clipped = ratios.clamp(1.0 - settings.clip, 1.0 + settings.clip)
                loss = -torch.min(ratios * gains, clipped * gains).mean()
                loss = loss + settings.value * mse_loss(values, targets[rows])
                loss = loss - settings.entropy * choice.entropy().mean()
                self.optimiser.zero_grad()
                loss.backward()
                torch.nn.utils.clip_grad_norm_(self.network.parameters(), settings.largest_gradient)
                self.optimiser.step()

    def set_progress(self, share: float) -> None:
        """Reduces the learning rate; `share` of the training is over."""
        for group in self.optimiser.param_groups:
            group["lr"] = self.settings.rate * max(1.0 - share, 0.02)


def train(seed: int, minutes: float, out: str, settings: Settings | None = None, **options: Any) -> Network:
    """Trains for some minutes; writes the network to `out`, and the learning curve to `out`.csv."""
    trainer = Trainer(seed, settings or Settings(), f"{out}.csv", **options)
    began_s = time.monotonic()
    while (share := (time.monotonic() - began_s) / (60.0 * minutes)) < 1.0:
        trainer.set_progress(share)
        trainer.learn(trainer.play())
    trainer.network.save(out)
    trainer.envs.close()
    return trainer.network


def main(arguments: list[str] | None = None) -> None:
    """Runs the command line."""
    program = argparse.ArgumentParser("ppo", description="Train PPO to reach a sounding object")
    program.add_argument("--minutes", type=float, default=30.0, help="training time [30]")
    program.add_argument("--seed", type=int, default=1, help="seed of houses and weights [1]")
    program.add_argument("--out", default="ppo.pt", help="file for the network [ppo.pt]")
    options = program.parse_args(arguments)
    train(options.seed, options.minutes, options.out)


if __name__ == "__main__":
    main()
