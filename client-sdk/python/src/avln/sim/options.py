"""Options of training environments."""

from __future__ import annotations

import importlib.machinery
import importlib.util
import json
import math
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from gymnasium.vector import AutoresetMode

SENSES = ("rgb", "depth", "audio")
"""Senses of the benchmark."""


class SimError(RuntimeError):
    """An environment failed: an invalid action, a scene without missions, or a state of other episodes."""


@dataclass(frozen=True)
class Folder:
    """A split of a data set from `avln data dataset build`."""

    path: str | Path
    """Folder with `dataset.json`."""
    split: str = "train"
    """Split name."""
    training: bool = False
    """True to confirm that scenes from files are for training; houses record their pool."""


@dataclass(frozen=True)
class Scan:
    """A scene file, such as a scan."""

    path: str | Path
    """The file or folder."""


def native() -> Any:
    """Returns the native module; `AVLN_NATIVE` can name a file of a local build.

    Raises:
        ModuleNotFoundError: in a package without it.
    """
    path = os.environ.get("AVLN_NATIVE")
    if path:
        loader = importlib.machinery.ExtensionFileLoader("_native", path)
        spec = importlib.util.spec_from_file_location("_native", path, loader=loader)
        if spec is None:
            raise ModuleNotFoundError(f"cannot load AVLN_NATIVE={path}")
        module = importlib.util.module_from_spec(spec)
        loader.exec_module(module)
        return module
    try:
        return importlib.import_module("avln.sim._native")
    except ModuleNotFoundError as error:
        message = "avln.sim needs the package avln; avln-client contains only the client: pip install avln"
        raise ModuleNotFoundError(message, name=error.name) from None


def to_json(
    source: str | Folder | Scan,
    *,
    num_envs: int,
    threads: int | None,
    seed: int,
    size: int | tuple[int, int],
    senses: Sequence[str],
    order: str | None,
    goals: tuple[int, int],
    distance_m: tuple[float, float],
    autoreset_mode: AutoresetMode,
    **rest: Any,
) -> str:
    """Returns the options of the native module.

    Raises:
        ValueError: if a sense is unknown.
    """
    unknown = [sense for sense in senses if sense not in SENSES]
    if unknown:
        raise ValueError(f"`senses` has {unknown}; use {', '.join(SENSES)}")
    width, height = (size, size) if isinstance(size, int) else size
    options = {
        "num_envs": num_envs,
        "threads": threads or os.cpu_count() or 1,
        "source": _source(source),
        "seed": seed,
        "order": order,
        "goals": list(goals),
        "distance_m": list(distance_m),
        "width": width,
        "height": height,
        "hfov_rad": 0.5 * math.pi,
        "autoreset": autoreset_mode.value,
        **{sense: sense in senses for sense in SENSES},
        **rest,
    }
    return json.dumps(options)


def _source(source: str | Folder | Scan) -> dict[str, Any]:
    if isinstance(source, Folder):
        return {"folder": {"path": str(source.path), "split": source.split, "training": source.training}}
    if isinstance(source, Scan):
        return {"scan": str(source.path)}
    return {"recipe": source}
