"""Evaluation of a trained network in houses without training episodes.

python examples/training/evaluate.py ppo.pt --episodes 320
"""

from __future__ import annotations

import argparse

from network import Network
from reach_sound import evaluate


def main(arguments: list[str] | None = None) -> None:
    """Runs the command line."""
    program = argparse.ArgumentParser("evaluate", description="Evaluate a network in unseen houses")
    program.add_argument("network", help="file of a trained network")
    program.add_argument("--episodes", type=int, default=320, help="episodes, rounded up to a multiple of 32 [320]")
    options = program.parse_args(arguments)
    share = evaluate(Network.load(options.network).act, options.episodes)
    print(f"{100 * share:.1f} % of the missions are complete")


if __name__ == "__main__":
    main()
