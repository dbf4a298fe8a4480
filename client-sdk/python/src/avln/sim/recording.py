"""Films of episodes."""

from __future__ import annotations

import importlib
import shutil
import subprocess
from collections.abc import Mapping
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, Callable

import numpy as np

from avln.sim.env import Env
from avln.sim.options import SimError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

Policy = Callable[[dict[str, Any], dict[str, Any]], Any]
"""Function from observation and info to an action."""


def record(
    path: str | Path, env: Env | Mapping[str, Any], policy: Policy, *, episodes: int = 1, fps: float = 4.0
) -> Path:
    """Records episodes: MP4 if ffmpeg is on the PATH, otherwise or for `.gif` an animated GIF.

    Args:
        path: file; its ending changes to `.gif` without ffmpeg.
        env: environment with `render_mode="rgb_array"`; or options of `Env`, for an environment of this film.
        policy: function from observation and info to an action.
        episodes: episodes, each from `reset`.
        fps: frames per second, one per step; 4 is the pace of the simulated time.

    Returns:
        The written file.

    Raises:
        ModuleNotFoundError: without ffmpeg and Pillow.
        SimError: if an episode or ffmpeg fails.
        ValueError: if the environment has no render mode.
    """
    ffmpeg = None if Path(path).suffix == ".gif" else shutil.which("ffmpeg")
    to = Path(path) if ffmpeg else Path(path).with_suffix(".gif")
    images = None if ffmpeg else _pillow()
    played = Env(**{"render_mode": "rgb_array", **env}) if isinstance(env, Mapping) else env
    try:
        if played.render_mode is None:
            raise ValueError('the environment has no render mode; create it with render_mode="rgb_array"')
        frames = _frames(played, policy, episodes)
        if ffmpeg:
            _write_mp4(to, frames, fps, ffmpeg)
        else:
            _write_gif(to, frames, fps, images)
    finally:
        if played is not env:
            played.close()
    return to


def _frames(env: Env, policy: Policy, episodes: int) -> Iterator[NDArray[Any]]:
    for _ in range(episodes):
        seen, info = env.reset()
        yield np.asarray(env.render())
        is_over = False
        while not is_over:
            seen, _, terminated, truncated, info = env.step(policy(seen, info))
            is_over = terminated or truncated
            yield np.asarray(env.render())


def _pillow() -> Any:
    try:
        return importlib.import_module("PIL.Image")
    except ModuleNotFoundError as error:
        message = "avln.sim.record needs ffmpeg for MP4 or Pillow for GIF; pip install pillow"
        raise ModuleNotFoundError(message, name=error.name) from None


def _write_gif(path: Path, frames: Iterator[NDArray[Any]], fps: float, images: Any) -> None:
    pictures = (images.fromarray(frame).quantize(256) for frame in frames)
    next(pictures).save(path, save_all=True, append_images=pictures, duration=round(1000 / fps), loop=0)


def _write_mp4(path: Path, frames: Iterator[NDArray[Any]], fps: float, ffmpeg: str) -> None:
    first = next(frames)
    height, width, _ = first.shape
    raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", str(fps), "-i", "-"]
    command = [ffmpeg, "-y", "-loglevel", "error", *raw, "-pix_fmt", "yuv420p", str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        if process.stdin is None or process.stderr is None:
            raise SimError("ffmpeg has no pipes")
        try:
            for frame in chain([first], frames):
                process.stdin.write(frame.tobytes())
            process.stdin.close()
        except BrokenPipeError:
            pass  # ffmpeg ended with an error, which follows.
        message = process.stderr.read().decode(errors="replace").strip()
    if process.returncode:
        raise SimError(f"ffmpeg cannot write {path}: {message}")
