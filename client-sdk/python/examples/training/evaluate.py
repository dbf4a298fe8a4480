"""Evaluation of a trained policy in houses without training episodes.

python examples/training/evaluate.py ppo.pt --episodes 320
"""

from __future__ import annotations

import argparse

from network import Network
from reach_sound import Policy, evaluate


def policy(path: str) -> Policy:
    """Reads the policy of sb3.py (.zip), or the network of another example."""
    if not path.endswith(".zip"):
        return Network.load(path).act
    from stable_baselines3 import PPO  # noqa: PLC0415, needs an extra

    model = PPO.load(path, device="cpu")
    return lambda features: model.predict(features)[0]


def main(arguments: list[str] | None = None) -> None:
    """Runs the command line."""
    program = argparse.ArgumentParser("evaluate", description="Evaluate a policy in unseen houses")
    program.add_argument("policy", help="file of a trained policy")
    program.add_argument("--episodes", type=int, default=320, help="episodes, rounded up to a multiple of 32 [320]")
    options = program.parse_args(arguments)
    share = evaluate(policy(options.policy), options.episodes)
    print(f"{100 * share:.1f} % of the missions are complete")


if __name__ == "__main__":
    main()
