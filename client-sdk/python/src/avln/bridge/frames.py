"""Message format of the authors: MessagePack in the first frame, array bytes in the following frames."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import msgpack
import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

_MARK = "__ndarray__"


def pack(message: dict[str, Any]) -> list[bytes]:
    """Packs a message into frames, with arrays at any depth."""
    arrays: list[bytes] = []
    tree = _without_arrays(message, arrays)
    return [msgpack.packb(tree, use_bin_type=True), *arrays]


def unpack(frames: Sequence[bytes]) -> Any:
    """Unpacks a message; the arrays are read-only views of the frames.

    Raises:
        ValueError: if the frames are not a valid message.
    """
    try:
        tree = msgpack.unpackb(frames[0], raw=False)
    except (msgpack.exceptions.UnpackException, ValueError, IndexError) as error:
        raise ValueError(f"the first frame is not MessagePack: {error}") from None
    return _with_arrays(tree, frames[1:])


def _without_arrays(value: Any, arrays: list[bytes]) -> Any:
    if isinstance(value, np.ndarray):
        arrays.append(np.ascontiguousarray(value).tobytes())
        return {_MARK: True, "dtype": value.dtype.name, "shape": list(value.shape), "frame": len(arrays) - 1}
    if isinstance(value, dict):
        return {str(key): _without_arrays(entry, arrays) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_without_arrays(entry, arrays) for entry in value]
    return value.item() if isinstance(value, np.generic) else value


def _with_arrays(value: Any, frames: Sequence[bytes]) -> Any:
    if isinstance(value, dict) and value.get(_MARK):
        return np.frombuffer(frames[value["frame"]], np.dtype(value["dtype"])).reshape(value["shape"])
    if isinstance(value, dict):
        return {key: _with_arrays(entry, frames) for key, entry in value.items()}
    return [_with_arrays(entry, frames) for entry in value] if isinstance(value, list) else value
