"""PPO of TorchRL on the task of reach_sound.py.

python examples/training/torchrl_ppo.py --steps 2000000 --out torchrl.pt
"""

from __future__ import annotations

import argparse
from typing import Any

import torch
from network import Network
from reach_sound import TRAIN_SEED, ReachSound
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import ProbabilisticTensorDictModule, ProbabilisticTensorDictSequential, TensorDictModule
from torch import nn
from torch.distributions import Categorical
from torchrl.collectors import Collector
from torchrl.data import Categorical as Discrete
from torchrl.data import Composite, Unbounded
from torchrl.envs import EnvBase
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

STEPS, EPOCHS, BATCHES = 64, 3, 4


class TorchRlEnvs(EnvBase):
    """`ReachSound` with the interface of TorchRL."""

    def __init__(self, envs: ReachSound) -> None:
        """Wraps environments."""
        count = envs.num_envs
        super().__init__(batch_size=torch.Size([count]))
        self.envs = envs
        self.seen = torch.from_numpy(envs.reset()[0])
        self.observation_spec = Composite(features=Unbounded((count, envs.features)), shape=(count,))
        self.action_spec = Discrete(envs.actions, shape=(count,))
        self.reward_spec = Unbounded((count, 1))

    def _reset(self, _tensordict: TensorDictBase | None = None, **_: Any) -> TensorDictBase:
        # The environments have begun their next episodes by themselves.
        return TensorDict({"features": self.seen}, batch_size=self.batch_size)

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        seen, rewards, terminated, truncated, _ = self.envs.step(tensordict["action"].numpy())
        self.seen = torch.from_numpy(seen)
        column = {
            "reward": torch.from_numpy(rewards),
            "done": torch.from_numpy(terminated | truncated),
            "terminated": torch.from_numpy(terminated | truncated),
        }
        columns = {name: values.unsqueeze(-1) for name, values in column.items()}
        return TensorDict({"features": self.seen, **columns}, batch_size=self.batch_size)

    def _set_seed(self, seed: int | None) -> None:
        """Changes nothing: the seed is an argument of the environments."""


def modules(network: Network) -> tuple[ProbabilisticTensorDictSequential, TensorDictModule]:
    """Returns actor and critic with a common body."""
    actor = TensorDictModule(nn.Sequential(network.body, network.actor), ["features"], ["logits"])
    choice = ProbabilisticTensorDictModule(
        ["logits"], ["action"], distribution_class=Categorical, return_log_prob=True, default_interaction_type="random"
    )
    critic = TensorDictModule(nn.Sequential(network.body, network.critic), ["features"], ["state_value"])
    return ProbabilisticTensorDictSequential(actor, choice), critic


def train(seed: int, steps: int, out: str, num_envs: int = 128, **options: Any) -> Network:
    """Trains for some steps; writes the network to `out`, and the learning curve to `out`.csv."""
    torch.manual_seed(seed)
    reach = ReachSound(num_envs, TRAIN_SEED + seed, f"{out}.csv", **options)
    network = Network(reach.features, reach.actions)
    actor, critic = modules(network)
    loss = ClipPPOLoss(actor, critic, entropy_coeff=0.01, critic_coeff=0.5, normalize_advantage=True)
    advantages = GAE(gamma=0.99, lmbda=0.95, value_network=critic)
    optimiser = torch.optim.Adam(network.parameters(), lr=5e-4, eps=1e-5)
    collector = Collector(
        TorchRlEnvs(reach),
        actor,
        frames_per_batch=STEPS * num_envs,
        total_frames=steps,
        exploration_type=None,
        auto_register_policy_transforms=False,
    )
    for rollout in collector:
        rollout["next", "reward"] *= 0.1
        with torch.no_grad():
            advantages(rollout)
        rows = rollout.reshape(-1)
        for _ in range(EPOCHS):
            for batch in torch.randperm(len(rows)).chunk(BATCHES):
                losses = loss(rows[batch])
                optimiser.zero_grad()
                (losses["loss_objective"] + losses["loss_critic"] + losses["loss_entropy"]).backward()
                nn.utils.clip_grad_norm_(network.parameters(), 0.5)
                optimiser.step()
    collector.shutdown()
    network.save(out)
    return network


def main(arguments: list[str] | None = None) -> None:
    """Runs the command line."""
    program = argparse.ArgumentParser("torchrl_ppo", description="Train PPO of TorchRL")
    program.add_argument("--steps", type=int, default=2_000_000, help="training steps [2000000]")
    program.add_argument("--seed", type=int, default=1, help="seed of houses and weights [1]")
    program.add_argument("--out", default="torchrl.pt", help="file for the network [torchrl.pt]")
    options = program.parse_args(arguments)
    train(options.seed, options.steps, options.out)


if __name__ == "__main__":
    main()
