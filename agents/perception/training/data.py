"""Pictures that `avln data dataset frames` took in training houses, as batches with what is to be learnt from them."""

import json
from pathlib import Path

import numpy as np
import torch
from torch.nn import functional as F

UNKNOWN = 255
# Categories before this number are the building itself, which has no instances.
BUILDING = 3
# An instance counts as seen in a picture from so many pixels of the file on.
SEEN_PX = 80
# More instances than any house has.
INSTANCES = 1024


class Frames:
    """The houses of a folder, mapped into memory."""

    def __init__(self, folder: str):
        manifest = json.loads((Path(folder) / "frames.json").read_text())
        if manifest["format"] != "avln-frames" or manifest["purpose"] != "training":
            raise SystemExit(f"{folder} is for {manifest['purpose']}; nothing is learnt from it")
        self.categories = manifest["categories"]
        self.recipe = {"name": manifest["recipe"], "split": manifest["split"], "views": manifest["views"]}
        self.seeds, self.houses, self.shared = [], [], []
        for house in manifest["houses"]:
            path = Path(folder) / house["file"]
            if path.exists():
                records = np.load(path, mmap_mode="r")
                self.houses.append(records)
                self.seeds.append(house["procedural"]["seed"])
                self.shared.append(shared(records))

    def pairs(self, rng, houses, count):
        """`count` pairs of views, the two of a pair in one house and with instances in common where there are such."""
        picked = []
        for _ in range(count):
            house = int(rng.choice(houses))
            chances = self.shared[house]
            first = int(rng.integers(len(chances)))
            weights = chances[first]
            second = rng.choice(len(weights), p=weights) if weights is not None else rng.integers(len(chances))
            picked += [(house, first), (house, int(second))]
        return picked


def shared(records):
    """For each view the chances with which another one is taken beside it."""
    seen = np.zeros((len(records), INSTANCES), np.float32)
    for view, record in enumerate(records):
        counts = np.bincount(record["instance"].ravel(), minlength=INSTANCES)
        seen[view] = counts >= SEEN_PX
    seen[:, 0] = 0
    common = np.minimum(seen @ seen.T, 4)
    np.fill_diagonal(common, 0)
    return [row / row.sum() if row.sum() > 0 else None for row in common]


def heights(records, depth_m):
    """Height of every pixel above the floor that the camera's body stands on, metres: N x S x S."""
    side = depth_m.shape[-1]
    across = (np.arange(side, dtype=np.float32) + 0.5 - side / 2) / (side / 2)
    tangent = np.tan(records["hfov_rad"] / 2)[:, None]
    up = -across[None, :] * tangent
    sin, cos = np.sin(records["pitch_rad"])[:, None], np.cos(records["pitch_rad"])[:, None]
    return records["height_m"][:, None, None] + depth_m * (up * cos + sin)[:, :, None]


def batch(frames, picked, rng, side, train=True, drop=0.3):
    """Pictures of `picked` (house, view) as the network sees them, `side` pixels wide, and their labels at half of that.

    In training each is flipped, cut and coloured at random, and goes without depth with the chance `drop`.
    """
    records = np.stack([frames.houses[house][view] for house, view in picked])
    depth_m = records["depth_mm"].astype(np.float32) / 1000
    rgb = torch.from_numpy(records["rgb"].astype(np.float32) / 255).permute(0, 3, 1, 2)
    solid = torch.from_numpy(np.stack([depth_m, heights(records, depth_m)], 1))
    labels = np.stack([records["category"], records["instance"]], 1).astype(np.float32)
    labels = torch.from_numpy(labels)
    dropped = torch.from_numpy(rng.random(len(picked)) < drop).float()[:, None, None, None]
    if train:
        rgb = colored(rgb, rng)
        rgb, solid, labels = cut(rng, side, rgb, solid, labels)
    labels = F.interpolate(labels, size=(side // 2, side // 2), mode="nearest").long()
    rgb = F.interpolate(rgb, size=(side, side), mode="bilinear") if rgb.shape[-1] != side else rgb
    solid = F.interpolate(solid, size=(side, side), mode="nearest") if solid.shape[-1] != side else solid
    depth = solid[:, :1] * (1 - dropped)
    houses = torch.tensor([house for house, _ in picked])
    return rgb, depth, solid[:, 1:], labels[:, 0], labels[:, 1], houses


def colored(rgb, rng):
    """Other light: the same for both pictures of a pair but for a little."""
    count = len(rgb)
    pairs = np.repeat(rng.uniform(-1, 1, (count // 2, 5)), 2, 0) + 0.1 * rng.uniform(-1, 1, (count, 5))
    draw = torch.from_numpy(pairs.astype(np.float32))[:, :, None, None]
    gain = 1 + 0.2 * draw[:, :1] + 0.06 * draw[:, 1:4]
    mean = rgb.mean((1, 2, 3), keepdim=True)
    return (((rgb - mean) * (1 + 0.15 * draw[:, 4:]) + mean) * gain).clamp(0, 1)


def cut(rng, side, *pictures):
    """A square of all pictures, no smaller than `side` or 0.85 of them, each mirrored with the chance of one half."""
    whole = pictures[0].shape[-1]
    width = int(rng.integers(min(side, int(0.85 * whole)), whole + 1))
    left, top = rng.integers(whole - width + 1, size=2)
    mirrored = torch.from_numpy(rng.random(len(pictures[0])) < 0.5)[:, None, None, None]
    squares = [picture[:, :, top : top + width, left : left + width] for picture in pictures]
    return [torch.where(mirrored, square.flip(3), square) for square in squares]
