"""Reads what `cargo bench -p avln-render --bench peers -- --dump FOLDER` writes."""

import json
import sys
from pathlib import Path

try:
    import numpy as np
except ImportError:
    sys.exit("numpy is missing: pip install numpy")


class Scene:
    """Mesh, materials, cameras and our own frames of one dump."""

    def __init__(self, folder):
        self.folder = Path(folder)
        if not (self.folder / "scene.json").is_file():
            sys.exit(f"{folder} holds no scene.json; write one with: "
                     "cargo bench -p avln-render --bench peers -- --dump FOLDER")
        about = json.loads((self.folder / "scene.json").read_text())
        self.side, self.count, self.ours_fps = about["side"], about["cameras"], about["ours_fps"]
        self.materials, self.sizes = about["materials"], about["textures"]
        self.positions = self.array("positions.f32", "<f4", 3)
        self.uvs = self.array("uvs.f32", "<f4", 2)
        self.colors = self.array("colors.u8", "u1", 3)
        self.triangles = self.array("triangles.u32", "<u4", 3)
        self.material_of = self.array("materials.u32", "<u4")
        self.instance_of = self.array("instances.u32", "<u4")
        self.cameras = self.array("cameras.f32", "<f4", 13)
        pixels = self.side * self.side
        self.depth = self.array("depth.f32", "<f4", pixels)
        self.rgb = self.array("rgb.u8", "u1", pixels * 3)
        self.ids = self.array("ids.u32", "<u4", pixels)

    def array(self, name, kind, columns=None):
        flat = np.fromfile(self.folder / name, dtype=kind)
        return flat if columns is None else flat.reshape(-1, columns)

    def texture(self, index):
        return (self.folder / f"texture-{index}.rgba").read_bytes()


def folder_argument():
    """The folder named on the command line."""
    if len(sys.argv) != 2:
        sys.exit(f"usage: {sys.argv[0]} FOLDER")
    return sys.argv[1]


def report(name, scene, seconds):
    """Prints frame rate and ratio; `seconds` holds the fastest time of each camera."""
    mean_s = float(np.mean(seconds))
    pixels_m = scene.side * scene.side / mean_s / 1e6
    print(f"{name}: {1 / mean_s:.1f} frames/s at {scene.side} x {scene.side} ({pixels_m:.2f} M pixels/s); "
          f"ours, RGB, depth and ids: {scene.ours_fps:.1f}, {scene.ours_fps * mean_s:.2f} times as fast")
