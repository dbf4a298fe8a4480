"""Trains the network on a folder of images; see README.md."""

import argparse
import csv
import signal
import time
from pathlib import Path

import numpy as np
import torch
from data import BUILDING, NOISY, UNKNOWN, Frames, batch
from losses import class_weights, loss
from model import VisionNetwork, channels

# Images per batch, two per house.
BATCH = 16
WARM_UP_STEPS = 200
PEAK_RATE = 3e-3
# Image sides: small ones first, then those of agents.
SMALL_PX, LARGE_PX = 128, 192
# The first houses are held out for the training curve, the last ones for shapes.py.
HELD_OUT, FOR_SHAPES = 4, 40
MEASURED_VIEWS = 12


def options():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("frames", help="folder written by `avln data dataset frames`")
    parser.add_argument("--out", default="run", help="folder for checkpoint.pt and curve.csv")
    parser.add_argument("--steps", type=int, default=12000, help="total number of steps")
    parser.add_argument("--settle", type=int, default=9000, help="final steps in which the learning rate falls to 0")
    parser.add_argument("--large", type=int, default=1500, help="final steps on images of 192 pixels")
    parser.add_argument("--noise", action="store_true", help="add the sensor noise of the rules to most images")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--resume", action="store_true", help="continue from checkpoint.pt")
    parser.add_argument("--every", type=int, default=250, help="steps between checkpoints")
    return parser.parse_args()


def rate(step, steps, settle):
    """Returns the learning rate: warm-up, plateau, decay."""
    return PEAK_RATE * min(1, (step + 1) / WARM_UP_STEPS, max(steps - step, 0) / max(settle, 1))


@torch.no_grad()
def measure(net, frames, houses, drop, noisy):
    """Returns the mean IoU and the share of instances whose majority category is correct."""
    net.eval()
    rng, count = np.random.default_rng(0), len(frames.categories)
    table, right, all_ = torch.zeros(count, count), 0, 0
    for house in houses:
        views = [(house, view) for view in range(min(MEASURED_VIEWS, len(frames.houses[house])))]
        rgb, depth, height, categories, instances, _ = batch(frames, views, rng, LARGE_PX, False, drop, noisy)
        predicted = net.split(net(channels(rgb, depth, height)))[0].argmax(1)
        known = categories != UNKNOWN
        pairs = categories[known] * count + predicted[known]
        table += torch.bincount(pairs, minlength=count * count).view(count, count)
        for picture in range(len(views)):
            for instance in instances[picture].unique():
                mask = (instances[picture] == instance) & (categories[picture] >= BUILDING) & known[picture]
                if instance > 0 and mask.sum() >= 25:
                    right += int(predicted[picture][mask].mode().values == categories[picture][mask][0])
                    all_ += 1
    net.train()
    union = table.sum(0) + table.sum(1) - table.diagonal()
    there = table.sum(1) > 0
    return (table.diagonal() / union.clamp(min=1))[there].mean().item(), right / max(all_, 1)


def main():
    given = options()
    torch.set_num_threads(1)
    torch.manual_seed(given.seed)
    frames = Frames(given.frames)
    learnt, held_out = np.arange(HELD_OUT, len(frames.houses) - FOR_SHAPES), range(HELD_OUT)
    net = VisionNetwork(len(frames.categories)).to(memory_format=torch.channels_last)
    optimiser = torch.optim.AdamW(net.parameters(), PEAK_RATE, weight_decay=1e-3)
    out = Path(given.out)
    out.mkdir(parents=True, exist_ok=True)
    begin, noisy = 0, NOISY if given.noise else 0.0
    if given.resume:
        kept = torch.load(out / "checkpoint.pt", weights_only=True)
        if kept.get("noisy", 0.0) != noisy:
            raise SystemExit("the checkpoint was trained with another --noise")
        net.load_state_dict(kept["net"])
        optimiser.load_state_dict(kept["optimiser"])
        begin = kept["step"]
    rng, weights = np.random.default_rng([given.seed, begin]), class_weights(frames)
    stop = []
    signal.signal(signal.SIGTERM, lambda *_: stop.append(True))
    curve, parts = (out / "curve.csv").open("a", newline=""), []
    rows, began_s = csv.writer(curve), time.process_time()
    for step in range(begin, given.steps):
        side = LARGE_PX if step >= given.steps - given.large else SMALL_PX
        for group in optimiser.param_groups:
            group["lr"] = rate(step, given.steps, given.settle)
        rgb, depth, height, categories, instances, houses = batch(
            frames, frames.pairs(rng, learnt, BATCH // 2), rng, side, noisy=noisy
        )
        x = channels(rgb, depth, height).contiguous(memory_format=torch.channels_last)
        total, part = loss(net, net(x), categories, instances, houses, weights)
        optimiser.zero_grad()
        total.backward()
        torch.nn.utils.clip_grad_norm_(net.parameters(), 5.0)
        optimiser.step()
        parts.append(part)
        last = step + 1 == given.steps or bool(stop)
        if (step + 1) % given.every == 0 or last:
            means = [f"{value:.4f}" for value in np.mean(parts, 0)]
            seen = [
                f"{value:.4f}" for drop in (0, 1) for value in measure(net, frames, held_out, drop, float(given.noise))
            ]
            rows.writerow([step + 1, f"{time.process_time() - began_s:.0f}", side, *means, *seen])
            curve.flush()
            print(step + 1, side, *means, *seen, flush=True)
            parts = []
            kept = {"net": net.state_dict(), "optimiser": optimiser.state_dict(), "step": step + 1}
            about = {"categories": frames.categories, "recipe": frames.recipe, "seed": given.seed, "noisy": noisy}
            seeds = [str(frames.seeds[house]) for house in learnt]
            torch.save({**kept, **about, "seeds": seeds}, out / "checkpoint.part")
            (out / "checkpoint.part").replace(out / "checkpoint.pt")
        if last:
            return


if __name__ == "__main__":
    main()
