"""A PyTorch policy with a batch over all slots of a run: a template for custom networks.

python examples/torch_policy.py --token TOKEN --slots 4
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import nn

import avln
from avln.options import add_connection, add_run, begin_from, parser

if TYPE_CHECKING:
    from avln.play import Episode, Play

SIDE = 64
SENSORS = avln.Sensors(audio=False, width=SIDE, height=SIDE)


class Policy(nn.Module):
    """An untrained network: colour and depth images to a score per action."""

    def __init__(self) -> None:
        super().__init__()
        self.eyes = nn.Sequential(
            nn.Conv2d(4, 16, 8, stride=4), nn.ReLU(), nn.Conv2d(16, 32, 4, stride=2), nn.ReLU(), nn.Flatten()
        )
        self.head = nn.Linear(32 * 6 * 6, len(avln.Action))

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """Maps images [slots, 4, 64, 64] to scores [slots, 5]."""
        scores: torch.Tensor = self.head(self.eyes(pictures))
        return scores


def batch(episodes: list[Episode]) -> torch.Tensor:
    """Returns an image per slot with red, green, blue and depth from 0 to 1."""
    pictures = []
    for episode in episodes:
        seen, far_m = episode.observation, episode.task.depth_max_m
        assert seen.rgb is not None
        assert seen.depth is not None
        pictures.append(np.concatenate([seen.rgb / np.float32(255), seen.depth[..., None] / far_m], axis=2))
    return torch.from_numpy(np.stack(pictures)).permute(0, 3, 1, 2).float()


def choose(policy: Policy, episodes: list[Episode], generator: torch.Generator) -> list[avln.Action]:
    """Draws an action per slot from the policy's scores, within the remaining Submits; the last step is Stop."""
    with torch.inference_mode():
        scores = policy(batch(episodes))
        spent = [episode.observation.remaining_submits == 0 for episode in episodes]
        scores[torch.tensor(spent), avln.Action.SUBMIT] = -torch.inf
    drawn = torch.multinomial(scores.softmax(dim=1), 1, generator=generator)[:, 0].tolist()
    is_last = [episode.observation.remaining_steps == 1 for episode in episodes]
    return [avln.Action.STOP if last else avln.Action(index) for last, index in zip(is_last, drawn)]


def play_slots(plays: list[Play], policy: Policy, seed: int = 0) -> avln.RunSummary:
    """Plays a run: all slots send an action before any result is awaited."""
    generator = torch.Generator().manual_seed(seed)
    idle = list(plays)
    while True:
        begin_episodes(idle)
        playing = [play.episode for play in plays if play.episode is not None and not play.episode.is_over]
        if not playing:
            return plays[0].finish()
        for episode, action in zip(playing, choose(policy, playing, generator)):
            episode.send(action)
        for episode in playing:
            episode.receive()
        idle = [play for play in plays if play.episode is None or play.episode.is_over]


def begin_episodes(idle: list[Play]) -> None:
    """Begins the remaining episodes, at most one per idle slot."""
    asking = idle[: idle[0].progress.waiting] if idle else []
    for play in asking:
        play.request_episode()
    for play in asking:
        play.receive_episode()


def main() -> None:
    """Runs the command line."""
    program = parser("torch_policy", "Play a run with a single policy for all slots")
    add_connection(program)
    add_run(program, method="torch-policy")
    program.add_argument("--slots", type=int, default=4, help="episodes to play in parallel [4]")
    options = program.parse_args()
    client, run = begin_from(options)
    with client:
        print(play_slots(client.play_slots(run, options.slots, SENSORS), Policy().eval()))


if __name__ == "__main__":
    main()
