"""Exports a checkpoint as the crate's weights file, with examples of the expected output."""

import argparse
import json
import struct
from pathlib import Path

import numpy as np
import torch
from data import BUILDING, Frames, heights
from model import EMBEDDING, OFFSET_PX, VisionNetwork, channels
from train import BATCH, LARGE_PX

# Examples contain every third pixel of an image, and every fourth pixel of the output.
INPUT_STEP, OUTPUT_STEP = 3, 4


def folded(net):
    """Folds normalisation into the convolutions: taps x inputs x outputs and a bias, 16-bit floats."""
    tensors = {}
    for name, module in net.named_children():
        conv = getattr(module, "conv", module)
        weight, bias = conv.weight.detach(), conv.bias
        if hasattr(module, "norm"):
            norm = module.norm
            gain = norm.weight / torch.sqrt(norm.running_var + norm.eps)
            weight, bias = weight * gain[:, None, None, None], norm.bias - norm.running_mean * gain
        taps = weight.permute(2, 3, 1, 0).reshape(-1, weight.shape[1], weight.shape[0])
        tensors[f"{name}.weight"] = taps.detach().half().contiguous().numpy()
        tensors[f"{name}.bias"] = bias.detach().half().numpy()
    return tensors


def write(path, tensors, about):
    """Writes the safetensors layout: header length, header, numbers."""
    header, offset = {"__metadata__": {"avln-perception": json.dumps(about)}}, 0
    for name, values in tensors.items():
        end = offset + values.nbytes
        header[name] = {"dtype": "F16", "shape": list(values.shape), "data_offsets": [offset, end]}
        offset = end
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    path.write_bytes(struct.pack("<Q", len(text)) + text + b"".join(v.tobytes() for v in tensors.values()))


def rounded(net, tensors):
    """Returns the network with the exported (rounded) numbers and without normalisation."""
    for name, module in net.named_children():
        conv = getattr(module, "conv", module)
        taps = torch.from_numpy(tensors[f"{name}.weight"]).float()
        size = conv.kernel_size[0]
        conv.weight.data = taps.reshape(size, size, *taps.shape[1:]).permute(3, 2, 0, 1).contiguous()
        conv.bias = torch.nn.Parameter(torch.from_numpy(tensors[f"{name}.bias"]).float())
        if hasattr(module, "norm"):
            module.norm = torch.nn.Identity()
    return net.eval()


@torch.no_grad()
def example(net, record, with_depth):
    """Encodes a small image and the network's output: side, camera, colours, depth, numbers; little-endian."""
    rgb = np.ascontiguousarray(record["rgb"][::INPUT_STEP, ::INPUT_STEP])
    depth = record["depth_mm"][::INPUT_STEP, ::INPUT_STEP].astype("<f4") / 1000 * with_depth
    height = heights(record.reshape(1), depth[None])
    x = [torch.from_numpy(rgb.astype(np.float32) / 255).permute(2, 0, 1)[None]]
    x += [torch.from_numpy(values.astype(np.float32))[None] for values in (depth[None], height)]
    predicted = net(channels(*x))[0].permute(1, 2, 0)[::OUTPUT_STEP, ::OUTPUT_STEP]
    camera = [float(record[field]) for field in ("hfov_rad", "height_m", "pitch_rad")]
    head = struct.pack("<I3f", len(rgb), *camera)
    return head + rgb.tobytes() + depth.tobytes() + predicted.contiguous().numpy().astype("<f4").tobytes()


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("checkpoint")
    parser.add_argument("frames", help="folder written by `avln data dataset frames`")
    parser.add_argument("--crate", default=str(Path(__file__).parent.parent), help="folder of the crate")
    given = parser.parse_args()
    kept = torch.load(given.checkpoint, weights_only=True)
    net = VisionNetwork(len(kept["categories"]))
    net.load_state_dict(kept["net"])
    net.eval()
    recipe = kept["recipe"]
    about = {
        "version": 1,
        "categories": kept["categories"],
        "building": BUILDING,
        "embedding": EMBEDDING,
        "offset_px": OFFSET_PX,
        "side_px": LARGE_PX,
        "training": {
            "recipe": recipe["name"],
            "split": recipe["split"],
            "views": recipe["views"],
            "seeds": [int(seed) for seed in kept["seeds"]],
            "steps": kept["step"],
            "batch": BATCH,
        },
    }
    tensors = folded(net)
    crate = Path(given.crate)
    (crate / "weights").mkdir(exist_ok=True)
    write(crate / "weights" / "network.safetensors", tensors, about)
    net, frames = rounded(net, tensors), Frames(given.frames)
    (crate / "tests" / "examples").mkdir(parents=True, exist_ok=True)
    # The first houses of the folder are not used for training.
    for number, (house, view, with_depth) in enumerate([(0, 0, 1), (1, 5, 1), (2, 9, 0), (3, 17, 1)]):
        record = frames.houses[house][view]
        (crate / "tests" / "examples" / f"{number}.bin").write_bytes(example(net, record, with_depth))


if __name__ == "__main__":
    main()
