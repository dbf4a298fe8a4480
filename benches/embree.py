"""Depth and triangle numbers by Intel's Embree 4 in 16-ray packets on one thread, on a dump of the peers bench.

    pip install numpy embreex        # embreex brings libembree4.so
    python3 benches/embree.py FOLDER

Needs a C compiler (cc). AVLN_EMBREE names another libembree4.so.
"""

import ctypes
import importlib.util
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from dumped import Scene, folder_argument, np, report

ROUNDS = 5


def library():
    """Path of libembree4.so."""
    if "AVLN_EMBREE" in os.environ:
        return Path(os.environ["AVLN_EMBREE"])
    package = importlib.util.find_spec("embreex")
    if package is None:
        sys.exit("embreex, which brings libembree4.so, is missing: pip install embreex")
    found = sorted(Path(package.origin).parent.parent.glob("embreex.libs/libembree4*.so*"))
    if not found:
        sys.exit("this embreex holds no libembree4.so; name one by AVLN_EMBREE")
    return found[0]


def tracer(folder):
    """embree.c as a library."""
    source, out = Path(__file__).with_name("embree.c"), Path(folder) / "libtracer.so"
    embree = library()
    build = ["cc", "-O3", "-march=native", "-shared", "-fPIC", str(source), "-o", str(out), str(embree),
             f"-Wl,-rpath,{embree.parent}", "-Wl,--allow-shlib-undefined"]
    try:
        subprocess.run(build, check=True)
    except FileNotFoundError:
        sys.exit("cc, a C compiler, is missing: apt-get install gcc libc6-dev")
    made = ctypes.CDLL(str(out))
    made.prepare.restype = ctypes.c_void_p
    made.prepare.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p, ctypes.c_size_t]
    made.render.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p]
    return made


def main():
    scene = Scene(folder_argument())
    positions = np.append(scene.positions.ravel(), np.zeros(4, "<f4")).astype("<f4")
    with tempfile.TemporaryDirectory() as folder:
        embree = tracer(folder)
        start = time.perf_counter()
        world = embree.prepare(positions.ctypes.data, len(scene.positions), scene.triangles.ctypes.data,
                               len(scene.triangles))
        if not world:
            sys.exit("Embree makes no device on this machine")
        print(f"{len(scene.triangles)} triangles, tree in {time.perf_counter() - start:.2f} s")
        pixels = scene.side * scene.side
        depth, triangle = np.zeros(pixels, "<f4"), np.zeros(pixels, "<u4")
        fastest = np.full(scene.count, np.inf)
        differ = 0
        for turn in range(ROUNDS):
            for index, camera in enumerate(np.ascontiguousarray(scene.cameras)):
                start = time.perf_counter()
                embree.render(world, camera.ctypes.data, scene.side, depth.ctypes.data, triangle.ctypes.data)
                fastest[index] = min(fastest[index], time.perf_counter() - start)
                if turn == 0:
                    differ += int(np.sum(np.abs(depth - scene.depth[index]) > 1e-3 * np.maximum(depth, 0.1)))
        report("Embree 4, 16-ray packets, depth and triangles", scene, fastest)
        print(f"    {differ} of {pixels * scene.count} pixels differ by more than 0.1 %")


main()
