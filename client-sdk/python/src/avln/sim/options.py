"""Options of training environments."""

from __future__ import annotations

import importlib.machinery
import importlib.util
import json
import math
import os
import sys
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.vector import AutoresetMode

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

SENSES = ("rgb", "depth", "audio")
"""Senses of the benchmark."""
CHEAP_SENSES = ("lidar", "ears", "map")
"""Senses for training only (docs/training.md)."""
PRIVILEGED = ("targets", "ids", "top_down")
"""Groups of privileged information."""


class SimError(RuntimeError):
    """An environment failed: an invalid action, a scene without missions, or a state of other episodes."""

    results: Any = None
    """What the failed `step_wait` or `recv` would have returned: valid for the other environments, without rewards of a
    function."""


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
    training: bool = False
    """True to confirm that the scene is for training."""


@dataclass(frozen=True)
class Curriculum:
    """Limits for missions and houses; the defaults are those of the benchmark."""

    goals: tuple[int, int] = (2, 4)
    """Fewest and most goals, 1 to 4."""
    distance_m: tuple[float, float] = (3.0, 1000.0)
    """Smallest and largest walking distance from the start to each target, metres."""
    order: str | None = None
    """`ordered` or `unordered`; drawn per episode by default."""
    max_steps: int | None = None
    """Step limit; that of the rules by default."""
    rooms: tuple[int, int] | None = None
    """Fewest and most rooms per house of a recipe, 1 to 64; those of the recipe by default."""
    storeys: tuple[int, int] | None = None
    """Fewest and most storeys per house of a recipe, 1 to 4; those of the recipe by default."""
    added_submits: int = 0
    """Submits beyond those of the rules, which are one fewer than goals; 0 to 100."""


@dataclass(frozen=True)
class Progress:
    """Coefficients of the reward `progress`; the defaults are those of the released code of the paper's authors."""

    slack: float = -0.01
    """Every step."""
    per_m: float = 1.0
    """Per metre of progress on the shortest way to the routed goal."""
    submit: float = -2.0
    """Submit, right or wrong."""
    stop: float = -5.0
    """Stop."""
    found: float = 10.0
    """Goal found by a Submit or Stop."""
    complete: float = 20.0
    """Stop after which all goals are found."""


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
        try:
            module = importlib.util.module_from_spec(spec)
            loader.exec_module(module)
        except ImportError as error:
            raise ModuleNotFoundError(f"cannot load AVLN_NATIVE={path}: {error}") from None
        return module
    try:
        return importlib.import_module("avln.sim._native")
    except ModuleNotFoundError as error:
        message = (
            "avln.sim needs its native module: install the wheel for Linux, or "
            "cargo build --release -p avln-native and set AVLN_NATIVE to its path"
        )
        raise ModuleNotFoundError(message, name=error.name) from None


def _processors() -> int:
    """Returns the number of processors that this process may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def to_json(
    source: str | Folder | Scan,
    *,
    num_envs: int,
    threads: int | None,
    seed: int,
    size: int | tuple[int, int],
    senses: Sequence[str],
    curriculum: Curriculum,
    reward: object,
    privileged: bool | Sequence[str],
    autoreset_mode: AutoresetMode,
    **rest: Any,
) -> str:
    """Returns the options of the native module, which checks the numbers.

    Raises:
        ValueError: if an option has another form, or an unknown name.
    """
    groups = (PRIVILEGED[:1] if privileged else ()) if isinstance(privileged, bool) else privileged
    _check_names("senses", senses, SENSES + CHEAP_SENSES)
    _check_names("privileged", groups, PRIVILEGED)
    if not all(map(math.isfinite, curriculum.distance_m)):
        raise ValueError(f"`distance_m` is {curriculum.distance_m}; use two distances from 0 to 1000")
    options = {
        "num_envs": num_envs,
        "threads": _processors() if threads is None else threads,
        "source": _source(source),
        "seed": seed,
        **asdict(curriculum),
        "size": _sides(size),
        "hfov_rad": 0.5 * math.pi,
        "reward": _reward(reward),
        "privileged": "targets" in groups,
        "ids": "ids" in groups,
        "top_down": "top_down" in groups,
        "autoreset": AutoresetMode(autoreset_mode).value,
        **{sense: sense in senses for sense in SENSES + CHEAP_SENSES},
        **rest,
    }
    return json.dumps(options, default=_number)


def _check_names(option: str, names: Sequence[str], known: Sequence[str]) -> None:
    if isinstance(names, str):
        raise ValueError(f"`{option}` is {names!r}; use a list of names, such as [{names!r}]")
    if unknown := [name for name in names if name not in known]:
        raise ValueError(f"`{option}` has {unknown}; use {', '.join(known)}")


def _sides(size: int | tuple[int, int]) -> list[int]:
    """Returns width and height."""
    sides = np.asarray(size)
    if sides.shape not in {(), (2,)}:
        raise ValueError(f"`size` is {size}; use a side, or width and height")
    return [int(side) for side in np.broadcast_to(sides, 2)]


def _number(value: Any) -> Any:
    """Returns a NumPy number as one of Python."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"cannot use the option {value!r}: a {type(value).__name__} is neither a number nor a text")


def known_render_mode(mode: str | None) -> str | None:
    """Returns the mode; raises `ValueError` if it is unknown."""
    if mode not in {None, "rgb_array"}:
        raise ValueError(f"`render_mode` is {mode!r}; use 'rgb_array' or None")
    return mode


def _reward(reward: object) -> str | dict[str, float]:
    if not isinstance(reward, (str, Progress)) and not callable(reward):
        raise ValueError(f"`reward` is {reward!r}; use a name, coefficients of `progress` or a function")
    if isinstance(reward, Progress):
        coefficients = asdict(reward)
        if not all(map(math.isfinite, coefficients.values())):
            raise ValueError(f"`reward` is {reward}; use finite coefficients")
        return coefficients
    return reward if isinstance(reward, str) else "none"


def _source(source: str | Folder | Scan) -> dict[str, Any]:
    if isinstance(source, Folder):
        return {"folder": {"path": str(source.path), "split": source.split, "training": source.training}}
    if isinstance(source, Scan):
        return {"scan": {"path": str(source.path), "training": source.training}}
    return {"recipe": source}
