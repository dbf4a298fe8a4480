"""Demonstrations recorded by `avln lab rollout`, for imitation learning.

    from avln.rollouts import Rollouts

    for rollout in Rollouts("rollouts"):
        for observation, action in rollout:
            learn(rollout.mission, observation, action)

Arrays are read on access. The repository's `docs/DATASET.md` describes the files.
"""

from __future__ import annotations

import functools
import json
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from avln.action import Action, Order
from avln.errors import Error
from avln.mission import Goal, Mission, Modality
from avln.observation import Feedback, Observation, Pose

if TYPE_CHECKING:
    import os

    from numpy.typing import NDArray

FORMAT = "avln-rollouts"
"""`format` value in `rollouts.json`."""
VERSION = 1
"""Supported layout version."""


_DAMAGE = (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error)
"""Exceptions for a damaged archive."""


class RolloutsError(Error):
    """A folder or file not written by `avln lab rollout`."""


class Rollout:
    """An episode: the observation before every action, and the action."""

    def __init__(self, path: Path, manifest: dict[str, Any]) -> None:
        self.path = path
        """The file."""
        self._manifest = manifest
        try:
            with path.open("rb") as file, np.load(file) as archive:
                self._facts: dict[str, Any] = json.loads(archive["episode.json"])
                self._has = frozenset(archive.files)
        except _DAMAGE as error:
            raise RolloutsError(f"read rollout {path}: {error}; delete it and record it again") from None

    @property
    def id(self) -> str:
        """Episode id in its split."""
        return str(self._facts["episode"])

    @property
    def scene(self) -> str:
        """Scene name."""
        return str(self._facts["scene"])

    @property
    def is_complete(self) -> bool:
        """True if every goal was found."""
        return int(self._facts["found"]) == len(self._facts["goals"])

    @functools.cached_property
    def mission(self) -> Mission:
        """The mission."""
        return Mission(Order(self._facts["order"]), [self._goal(goal) for goal in self._facts["goals"]])

    @functools.cached_property
    def actions(self) -> NDArray[np.uint8]:
        """Action indices, u8 [steps]."""
        return self._array("action")

    @functools.cached_property
    def rgb(self) -> NDArray[np.uint8] | None:
        """Colours before every action, u8 [steps, height, width, 3]; None if not recorded."""
        return self._sense("rgb")

    @functools.cached_property
    def depth_mm(self) -> NDArray[np.uint16] | None:
        """Depth before every action, u16 [steps, height, width], millimetres; None if not recorded."""
        return self._sense("depth_mm")

    @functools.cached_property
    def pose(self) -> NDArray[np.float32] | None:
        """Poses before every action, f32 [steps, 4]: x, y, z in metres and heading in radians; None if not recorded."""
        return self._sense("pose")

    @functools.cached_property
    def audio(self) -> NDArray[np.float32] | None:
        """Sound before every action, f32 [steps, 2, samples]; None if not recorded."""
        return self._sense("audio")

    def __len__(self) -> int:
        return len(self.actions)

    def __iter__(self) -> Iterator[tuple[Observation, Action]]:
        submits, feedback = 0, self._array("feedback")
        for step, index in enumerate(self.actions):
            action = Action(int(index))
            yield self._observation(step, submits, Feedback(int(feedback[step]))), action
            submits += action is Action.SUBMIT

    def __repr__(self) -> str:
        return f"Rollout({self.id}, {self._facts['steps']} steps)"

    def _observation(self, step: int, submits: int, feedback: Feedback) -> Observation:
        scale = np.float32(self._manifest["depth_scale"])
        return Observation(
            step=step,
            rgb=None if self.rgb is None else self.rgb[step],
            depth=None if self.depth_mm is None else self.depth_mm[step].astype(np.float32) * scale,
            audio=None if self.audio is None else self.audio[step],
            pose=Pose() if self.pose is None else Pose(*map(float, self.pose[step])),
            remaining_steps=int(self._manifest["rules"]["max_steps"]) - step,
            remaining_submits=max(len(self._facts["goals"]) - 1 - submits, 0),
            feedback=feedback,
        )

    def _goal(self, goal: dict[str, str]) -> Goal:
        ((kind, value),) = goal.items()
        if kind == "image":
            return Goal(Modality.IMAGE, image=self._array(value))
        return Goal(Modality[kind.upper()], text=value)

    def _sense(self, name: str) -> NDArray[Any] | None:
        return self._array(name) if name in self._has else None

    def _array(self, name: str) -> NDArray[Any]:
        with np.load(self.path) as archive:
            found: NDArray[Any] = archive[name]
        return found


class Rollouts(Sequence[Rollout]):
    """A folder's episodes by file name."""

    def __init__(self, folder: str | os.PathLike[str], *, complete_only: bool = True) -> None:
        """Lists the recordings; `complete_only=False` includes episodes with missed goals.

        Raises:
            RolloutsError: if the folder was not written by `avln lab rollout`, or a file is damaged.
        """
        self.folder = Path(folder)
        """Recordings folder."""
        self.manifest = _manifest(self.folder / "rollouts.json")
        """`rollouts.json` content: split, order, sensors, rules."""
        paths = sorted((self.folder / "episodes").glob("*.npz"))
        read = (Rollout(path, self.manifest) for path in paths)
        self._paths = [rollout.path for rollout in read if rollout.is_complete or not complete_only]

    def __len__(self) -> int:
        return len(self._paths)

    @overload
    def __getitem__(self, index: int) -> Rollout: ...
    @overload
    def __getitem__(self, index: slice) -> list[Rollout]: ...
    def __getitem__(self, index: int | slice) -> Rollout | list[Rollout]:
        """Returns the episode at an index, or the episodes of a slice."""
        if isinstance(index, slice):
            return [Rollout(path, self.manifest) for path in self._paths[index]]
        return Rollout(self._paths[index], self.manifest)


def _manifest(path: Path) -> dict[str, Any]:
    try:
        manifest: dict[str, Any] = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise RolloutsError(
            f"read {path}: {error}; record rollouts with avln lab rollout --split SPLIT --out DIR"
        ) from None
    found = (manifest.get("format"), manifest.get("version"))
    if found != (FORMAT, VERSION):
        raise RolloutsError(
            f"read {path}: expected {FORMAT} version {VERSION}, got {found[0]} version {found[1]}; "
            "record the rollouts again"
        )
    return manifest
