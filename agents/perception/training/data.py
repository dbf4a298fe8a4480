"""Batches of labelled images, rendered in training houses by `avln data dataset frames`."""

import json
from pathlib import Path

import numpy as np
import torch
from torch.nn import functional as F

UNKNOWN = 255
# Lower categories are the building itself, without instances.
BUILDING = 3
# Fewest pixels of an instance that counts as visible.
SEEN_PX = 80
# Upper bound of instance ids in a house.
INSTANCES = 1024
# Share of training images with the sensor noise of the rules. The others keep descriptors of both kinds comparable: goal images
# have no noise.
NOISY = 0.75
# Sides of noisy images: every pixel of a camera has the same noise, so that small images contain more of it.
CAMERAS_PX = (128, 160, 192)
# Deviation of colours, and the constants of depth: sideways shift, disparity at 1 m and its deviation in pixels, steps per pixel, range.
RGB_NOISE = 0.2
SHIFT_PX, DISPARITY_PX_M, DISPARITY_NOISE_PX, STEPS_PER_PX, REACH_M = 0.25, 35.13, 1 / 36, 8, 10


class Frames:
    """The houses of a folder, memory-mapped."""

    def __init__(self, folder: str):
        manifest = json.loads((Path(folder) / "frames.json").read_text())
        if manifest["format"] != "avln-frames" or manifest["purpose"] != "training":
            raise SystemExit(f"{folder} is for {manifest['purpose']}, not for training")
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
        """Draws `count` pairs of views of one house, with common instances if possible."""
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
    """Returns, for each view, the probability of every other view as its partner."""
    seen = np.zeros((len(records), INSTANCES), np.float32)
    for view, record in enumerate(records):
        counts = np.bincount(record["instance"].ravel(), minlength=INSTANCES)
        seen[view] = counts >= SEEN_PX
    seen[:, 0] = 0
    common = np.minimum(seen @ seen.T, 4)
    np.fill_diagonal(common, 0)
    return [row / row.sum() if row.sum() > 0 else None for row in common]


def heights(records, depth_m):
    """Returns the height of every pixel above the floor of the camera's body, metres: N x S x S."""
    side = depth_m.shape[-1]
    across = (np.arange(side, dtype=np.float32) + 0.5 - side / 2) / (side / 2)
    tangent = np.tan(records["hfov_rad"] / 2)[:, None]
    up = -across[None, :] * tangent
    sin, cos = np.sin(records["pitch_rad"])[:, None], np.cos(records["pitch_rad"])[:, None]
    return records["height_m"][:, None, None] + depth_m * (up * cos + sin)[:, :, None]


def batch(frames, picked, rng, side, train=True, drop=0.3, noisy=0.0):
    """Returns the inputs of `picked` (house, view), `side` pixels wide, and their labels at half the size.

    Images have sensor noise with probability `noisy`. In training, images are flipped, cropped and recoloured at random, and lose
    their depth with probability `drop`.
    """
    records = np.stack([frames.houses[house][view] for house, view in picked])
    depth_m = records["depth_mm"].astype(np.float32) / 1000
    rgb = torch.from_numpy(records["rgb"].astype(np.float32) / 255).permute(0, 3, 1, 2)
    dropped = torch.from_numpy(rng.random(len(picked)) < drop).float()[:, None, None, None]
    if train:
        rgb = colored(rgb, rng)
    for image in np.flatnonzero(rng.random(len(picked)) < noisy) if noisy else ():
        rgb[image], depth_m[image] = observed(rgb[image], depth_m[image], int(rng.choice(CAMERAS_PX)), rng)
    solid = torch.from_numpy(np.stack([depth_m, heights(records, depth_m)], 1))
    labels = np.stack([records["category"], records["instance"]], 1).astype(np.float32)
    labels = torch.from_numpy(labels)
    if train:
        rgb, solid, labels = cut(rng, side, rgb, solid, labels)
    labels = F.interpolate(labels, size=(side // 2, side // 2), mode="nearest").long()
    rgb = F.interpolate(rgb, size=(side, side), mode="bilinear") if rgb.shape[-1] != side else rgb
    solid = F.interpolate(solid, size=(side, side), mode="nearest") if solid.shape[-1] != side else solid
    depth = solid[:, :1] * (1 - dropped)
    houses = torch.tensor([house for house, _ in picked])
    return rgb, depth, solid[:, 1:], labels[:, 0], labels[:, 1], houses


def observed(rgb, depth_m, side, rng):
    """Returns an image as seen by a camera of `side` pixels with sensor noise, enlarged to the size of the image."""
    whole = len(depth_m)
    seen = np.arange(side) * whole // side
    back = np.arange(whole) * side // whole
    small = gaussian(rgb[:, seen][:, :, seen], rng)
    large = F.interpolate(small[None], size=(whole, whole), mode="bilinear")[0]
    return large, redwood(depth_m[np.ix_(seen, seen)], rng)[np.ix_(back, back)]


def gaussian(rgb, rng):
    """Adds the colour noise `gaussian` of the rules."""
    deviates = torch.from_numpy(rng.standard_normal(tuple(rgb.shape), np.float32))
    return (rgb + RGB_NOISE * deviates).clamp(0, 1)


def redwood(depth_m, rng):
    """Adds the depth noise `redwood` of the rules: every pixel reads every other pixel and row, with a rounded disparity."""
    right, down, of_disparity = rng.standard_normal((3, *depth_m.shape), np.float32)
    rows, columns = np.indices(depth_m.shape, np.float32)
    y, x = ((at + SHIFT_PX * shift + 0.5).astype(np.int64) for at, shift in ((rows, down), (columns, right)))
    read_m = depth_m[y.clip(0, len(depth_m) - 1) & ~1, x.clip(0, len(depth_m) - 1) & ~1]
    seen = (depth_m > 0) & (read_m > 0) & (read_m < REACH_M)
    disparity_px = DISPARITY_PX_M / np.where(seen, read_m, 1) + of_disparity * DISPARITY_NOISE_PX
    steps = np.floor(disparity_px * STEPS_PER_PX + 0.5)
    noisy_m = DISPARITY_PX_M * STEPS_PER_PX / np.maximum(steps, 1)
    return np.where(seen & (steps > 0) & (noisy_m <= REACH_M), noisy_m, 0).astype(np.float32)


def colored(rgb, rng):
    """Changes the light, nearly equally for both images of a pair."""
    count = len(rgb)
    pairs = np.repeat(rng.uniform(-1, 1, (count // 2, 5)), 2, 0) + 0.1 * rng.uniform(-1, 1, (count, 5))
    draw = torch.from_numpy(pairs.astype(np.float32))[:, :, None, None]
    gain = 1 + 0.2 * draw[:, :1] + 0.06 * draw[:, 1:4]
    mean = rgb.mean((1, 2, 3), keepdim=True)
    return (((rgb - mean) * (1 + 0.15 * draw[:, 4:]) + mean) * gain).clamp(0, 1)


def cut(rng, side, *pictures):
    """Crops a common square of at least `side` or 0.85 of the images, and mirrors each with probability 0.5."""
    whole = pictures[0].shape[-1]
    width = int(rng.integers(min(side, int(0.85 * whole)), whole + 1))
    left, top = rng.integers(whole - width + 1, size=2)
    mirrored = torch.from_numpy(rng.random(len(pictures[0])) < 0.5)[:, None, None, None]
    squares = [picture[:, :, top : top + width, left : left + width] for picture in pictures]
    return [torch.where(mirrored, square.flip(3), square) for square in squares]
