"""Trains the shape classifier on segments of the network, and adds it to the weights."""

import argparse
import json
import struct
from pathlib import Path

import numpy as np
import torch
from export import write
from torch import nn

# A row: house and category (HEAD), shape features (SHAPE), then log-probabilities.
HEAD, SHAPE, HIDDEN = 2, 14, 64
EPOCHS, BATCH, PEAK_RATE = 30, 128, 2e-3
FOLDS = 4


class Shapes(nn.Module):
    def __init__(self, features):
        super().__init__()
        self.mean = features.mean(0)
        self.spread = features.std(0).clamp(min=0.05)
        kinds = features.shape[1] - SHAPE
        self.first, self.second = nn.Linear(features.shape[1], HIDDEN), nn.Linear(HIDDEN, kinds)
        self.second.weight.data *= 0.1
        self.trust = nn.Parameter(torch.ones(1))

    def forward(self, features):
        hidden = torch.relu(self.first((features - self.mean) / self.spread))
        hidden = nn.functional.dropout(hidden, 0.2, self.training)
        return self.second(hidden) + self.trust * features[:, SHAPE:]

    def tensors(self):
        """Returns inputs x outputs and biases with folded feature normalisation, as 16-bit floats."""
        weight = (self.first.weight / self.spread).detach()
        bias = self.first.bias.detach() - weight @ self.mean
        tensors = {
            "shapes.first.weight": weight.T,
            "shapes.first.bias": bias,
            "shapes.second.weight": self.second.weight.T,
            "shapes.second.bias": self.second.bias,
            "shapes.trust": self.trust,
        }
        return {name: values.detach().half().contiguous().numpy() for name, values in tensors.items()}


def learn(features, categories, seed):
    torch.manual_seed(seed)
    net = Shapes(features)
    optimiser = torch.optim.AdamW(net.parameters(), PEAK_RATE, weight_decay=1e-3)
    for epoch in range(EPOCHS):
        for group in optimiser.param_groups:
            group["lr"] = PEAK_RATE * (1 - epoch / EPOCHS)
        for picked in torch.randperm(len(features)).split(BATCH):
            optimiser.zero_grad()
            nn.functional.cross_entropy(net(features[picked]), categories[picked]).backward()
            optimiser.step()
    return net.eval()


@torch.no_grad()
def right(logits, categories):
    return (logits.argmax(1) == categories).float().mean().item()


def read(path):
    """Reads the tensors and description of a weights file, without the shape classifier."""
    raw = path.read_bytes()
    (length,) = struct.unpack("<Q", raw[:8])
    header, values = json.loads(raw[8 : 8 + length]), raw[8 + length :]
    about = json.loads(header.pop("__metadata__")["avln-perception"])
    tensors = {}
    for name, tensor in header.items():
        if not name.startswith("shapes."):
            start, end = tensor["data_offsets"]
            tensors[name] = np.frombuffer(values[start:end], "<f2").reshape(tensor["shape"])
    return tensors, about


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("segments", help="file written by the crate's example `shapes`")
    parser.add_argument("frames", help="folder of its images")
    parser.add_argument("--crate", default=str(Path(__file__).parent.parent), help="folder of the crate")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    torch.set_num_threads(1)
    weights = Path(given.crate) / "weights" / "network.safetensors"
    tensors, about = read(weights)
    rows = np.fromfile(given.segments, "<f4").reshape(-1, HEAD + SHAPE + len(about["categories"]))
    houses = torch.from_numpy(rows[:, 0].astype(np.int64))
    categories = torch.from_numpy(rows[:, 1].astype(np.int64))
    features = torch.from_numpy(rows[:, HEAD:].copy())
    before = right(features[:, SHAPE:], categories)
    folds = []
    for fold in range(FOLDS):
        other = houses % FOLDS == fold
        net = learn(features[~other], categories[~other], given.seed)
        folds.append(right(net(features[other]), categories[other]))
    print(
        f"{len(rows)} segments: accuracy {before:.3f} by appearance, {np.mean(folds):.3f} with shape, in held-out houses"
    )
    manifest = json.loads((Path(given.frames) / "frames.json").read_text())
    seeds = [manifest["houses"][house]["procedural"]["seed"] for house in houses.unique().tolist()]
    about["training"]["seeds"] = sorted({*about["training"]["seeds"], *seeds})
    write(weights, {**tensors, **learn(features, categories, given.seed).tensors()}, about)


if __name__ == "__main__":
    main()
