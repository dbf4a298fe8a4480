"""Measures a detector with classes on labelled images of houses: recall, precision, time per image.

`avln data dataset frames --measure` writes the images; docs/models.md has the commands.
"""

import argparse
import json
import time
import tomllib
from pathlib import Path

import numpy as np
import onnxruntime

# Instances below this share of the image neither count nor make a box wrong.
LEAST_SHARE = 0.005
# Intersection over union of a correct box.
SAME = 0.3


def houses(folder):
    """Yields red, green and blue (1 x 3 x side x side, 0 to 1), categories and instances of each image."""
    manifest = json.loads((folder / "frames.json").read_text())
    side = manifest["side_px"]
    record = np.dtype(
        [
            ("camera", "<f4", 7),
            ("rgb", "u1", (side, side, 3)),
            ("depth", "<u2", (side, side)),
            ("category", "u1", (side, side)),
            ("instance", "<u2", (side, side)),
        ]
    )
    for house in manifest["houses"]:
        data = (folder / house["file"]).read_bytes()
        start = 10 + int.from_bytes(data[8:10], "little")
        for image in np.frombuffer(data[start:], record):
            yield image["rgb"], image["category"], image["instance"], manifest["categories"]


def resized(image, side):
    """Resizes an image to a square, bilinearly."""
    height, width, _ = image.shape
    taps = []
    for length in (height, width):
        at = np.clip((np.arange(side) + 0.5) * length / side - 0.5, 0, length - 1)
        low = at.astype(int)
        taps.append((low, np.minimum(low + 1, length - 1), (at - low).astype(np.float32)))
    (top, bottom, down), (left, right, across) = taps
    image = image.astype(np.float32)
    image = image[top] * (1 - down)[:, None, None] + image[bottom] * down[:, None, None]
    return image[:, left] * (1 - across)[None, :, None] + image[:, right] * across[None, :, None]


def instances(category, instance, names, wanted):
    """Returns category, box and size test (large enough to count) of an image's instances."""
    side, found = len(category), []
    for number in np.unique(instance[instance > 0]):
        rows, columns = np.nonzero(instance == number)
        kind = category[rows[0], columns[0]]
        if kind < len(names) and names[kind] in wanted:
            box = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]) / side
            found.append((names[kind], box, len(rows) >= LEAST_SHARE * side * side))
    return found


def overlap(a, b):
    low, high = np.maximum(a[:2], b[:2]), np.minimum(a[2:], b[2:])
    both = np.prod(np.maximum(high - low, 0))
    return both / (np.prod(a[2:] - a[:2]) + np.prod(b[2:] - b[:2]) - both)


def percent(part, whole):
    return f"{100 * part / whole:.0f}" if whole else ""


class Tally:
    """Counts of a category: instances, found ones, boxes, correct ones."""

    def __init__(self):
        self.all, self.found, self.boxes, self.right = 0, 0, 0, 0

    def add(self, boxes, there):
        open_ones = list(there)
        for box in boxes:
            best = max(open_ones, key=lambda one: overlap(box, one[1]), default=None)
            is_right = best is not None and overlap(box, best[1]) >= SAME
            if is_right:
                open_ones = [one for one in open_ones if one is not best]
            if is_right and not best[2]:
                continue
            self.boxes += 1
            self.right += is_right
            self.found += is_right
        self.all += sum(is_large for _, _, is_large in there)

    def line(self, name):
        recall, precision = percent(self.found, self.all), percent(self.right, self.boxes)
        return f"| {name} | {self.all} | {recall} | {self.boxes} | {precision} |"


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("models", type=Path, help="models file")
    arguments.add_argument("frames", type=Path, help="folder of images")
    arguments.add_argument("--least-score", type=float, help="instead of the value of the models file")
    given = arguments.parse_args()
    detector = tomllib.loads(given.models.read_text())["detector"]
    least_score = given.least_score if given.least_score is not None else detector["least_score"]
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(given.models.parent / detector["file"], options)
    classes = detector["classes"]
    tallies, seconds = {}, []
    for rgb, category, instance, names in houses(given.frames):
        wanted = sorted(set(names) & set(classes))
        planes = (resized(rgb, detector["side_px"]) / 255 - detector["mean"]) / detector["std"]
        start = time.process_time()
        picture = planes.transpose(2, 0, 1)[None].astype(np.float32)
        boxes, scores = session.run(None, {session.get_inputs()[0].name: picture})
        seconds.append(time.process_time() - start)
        best = scores[0].argmax(axis=1)
        is_accepted = scores[0].max(axis=1) >= least_score
        there = instances(category, instance, names, wanted)
        for name in wanted:
            is_class = is_accepted & np.array([classes[kind] == name for kind in best], bool)
            of_class = boxes[0][is_class]
            tallies.setdefault(name, Tally()).add(of_class, [one for one in there if one[0] == name])
    cost_ms = 1000 * np.median(seconds)
    print(f"{len(seconds)} images; {cost_ms:.0f} ms of CPU time per image; score at least {least_score}\n")
    print("| category | instances | recall, % | boxes | precision, % |\n|---|---|---|---|---|")
    for name, tally in sorted(tallies.items(), key=lambda entry: -entry[1].all):
        print(tally.line(name))


if __name__ == "__main__":
    main()
