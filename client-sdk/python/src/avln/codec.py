"""Decoding of sensor data; PROTOCOL.md defines the layouts.

Arrays of RAW tensors are read-only views of the received message.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from avln.v1 import common_pb2 as v1

if TYPE_CHECKING:
    from numpy.typing import NDArray

_BLOCK = 16
_U8, _U16, _I16, _U32, _F32 = (np.dtype(name) for name in ("u1", "<u2", "<i2", "<u4", "<f4"))
_FULL_SCALE = np.float32(32_767.0)


class CodecError(ValueError):
    """Bytes that do not match their encoding."""


def decode_rgb(encoding: int, data: bytes, height: int, width: int) -> NDArray[np.uint8]:
    """Decodes colours, u8 [height, width, 3], RGB, first row on top.

    Raises:
        CodecError: if `data` is not a valid image in this encoding.
    """
    shape = (height, width, 3)
    if encoding == v1.ENCODING_RAW:
        return _view(data, _U8, shape)
    if encoding == v1.ENCODING_PACKED:
        return _unpack_rgb(data, height, width)
    raise _foreign(encoding, "colour images")


def decode_depth(encoding: int, data: bytes, height: int, width: int, unit_m: float = 1.0) -> NDArray[np.float32]:
    """Decodes depth, f32 [height, width], first row on top, in units of `unit_m` metres; 0: no hit in range.

    Raises:
        CodecError: if `data` is not a valid image in this encoding.
    """
    shape = (height, width)
    if encoding == v1.ENCODING_RAW:
        return _view(data, _F32, shape)
    if encoding == v1.ENCODING_PACKED:
        return _unpack_depth(data, height, width)
    if encoding == v1.ENCODING_DEPTH_U16_MM:
        millimetres = _view(data, _U16, shape)
    elif encoding == v1.ENCODING_DEPTH_U16_MM_PACKED:
        millimetres = _unpack_millimetres(data, height, width)
    else:
        raise _foreign(encoding, "depth images")
    return millimetres.astype(np.float32) / np.float32(1000.0 * unit_m)


def decode_audio(encoding: int, data: bytes, samples: int) -> NDArray[np.float32]:
    """Decodes sound pressure, f32 [2, samples], left ear first.

    Raises:
        CodecError: if `data` has a different sample count in this encoding.
    """
    if encoding == v1.ENCODING_RAW:
        return _view(data, _F32, (2, samples))
    if encoding == v1.ENCODING_AUDIO_I16:
        return _view(data, _I16, (2, samples)).astype(np.float32) / _FULL_SCALE
    raise _foreign(encoding, "sound")


def _foreign(encoding: int, what: str) -> CodecError:
    known = encoding in v1.Encoding.values()
    name = v1.Encoding.Name(encoding) if known else f"encoding {encoding}"
    return CodecError(f"{name} is not an encoding of {what} supported by this client")


def _view(data: bytes, dtype: np.dtype[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    expected = dtype.itemsize * int(np.prod(shape))
    if len(data) != expected:
        raise CodecError(f"expected {expected} bytes, got {len(data)}")
    return np.frombuffer(data, dtype).reshape(shape)


def unpack_blocks(data: bytes, count: int, most_bits: int) -> NDArray[np.uint32]:
    """Unpacks blocks of 16 numbers with a bit width per block: `count` numbers of at most `most_bits` bits.

    Raises:
        CodecError: if `data` has a different length.
    """
    blocks = -(-count // _BLOCK)
    packed = np.frombuffer(data, _U8)
    if len(packed) < blocks:
        raise CodecError(f"{len(packed)} bytes cannot contain the widths for {blocks} blocks")
    widths, body = packed[:blocks].astype(np.intp), packed[blocks:]
    if blocks and widths.max() > most_bits:
        raise CodecError(f"a block has {widths.max()} bits per number, the maximum is {most_bits}")
    expected = 2 * int(widths.sum())
    if len(body) != expected:
        raise CodecError(f"the widths announce {expected} bytes of blocks, got {len(body)}")
    return _pull(widths, body)[:count]


def _pull(widths: NDArray[np.intp], body: NDArray[np.uint8]) -> NDArray[np.uint32]:
    """Unpacks all blocks. A number is inside the 64 bits that start at the 32-bit word with the lowest bit."""
    padded = np.zeros(len(body) // 4 * 4 + 12, _U8)
    padded[: len(body)] = body
    words = padded.view(_U32).astype(np.uint64)
    pairs = words[:-1] | words[1:] << np.uint64(32)
    masks = (np.uint64(1) << widths.astype(np.uint64)) - np.uint64(1)
    numbers = np.empty((len(widths), _BLOCK), _U32)
    bits = _BLOCK * (np.cumsum(widths) - widths)
    for index in range(_BLOCK):
        numbers[:, index] = (pairs[bits >> 5] >> (bits & 31).astype(np.uint64)) & masks
        bits += widths
    return numbers.reshape(-1)


def _unfold(folded: NDArray[Any]) -> NDArray[Any]:
    """Converts folded differences to signed ones, modulo the range of the type."""
    one = folded.dtype.type(1)
    differences: NDArray[Any] = (folded >> one) ^ -(folded & one)
    return differences


def _unpack_rgb(data: bytes, height: int, width: int) -> NDArray[np.uint8]:
    folded = unpack_blocks(data, 3 * height * width, 8).astype(np.uint8)
    planes = np.cumsum(_unfold(folded).reshape(3, height, width), axis=1, dtype=np.uint8)
    picture = np.empty((height, width, 3), np.uint8)
    picture[..., 1] = planes[0]
    picture[..., 0] = planes[0] + planes[1]
    picture[..., 2] = planes[0] + planes[2]
    return picture


def _unpack_depth(data: bytes, height: int, width: int) -> NDArray[np.float32]:
    differences = _unfold(unpack_blocks(data, height * width, 32)).reshape(height, width)
    bits = np.empty((height, width), np.uint32)
    depth = bits.view(np.float32)
    bits[:1] = np.cumsum(differences[:1], axis=1, dtype=np.uint32)
    bits[1:2] = bits[:1] + differences[1:2]
    with np.errstate(all="ignore"):
        for row in range(2, height):
            above, farther = depth[row - 1], depth[row - 2]
            straight = above * farther / (farther + farther - above)
            is_usable = (straight > 0) & (straight < np.inf)
            predicted = np.where(is_usable, straight, above)
            bits[row] = predicted.view(np.uint32) + differences[row]
    return depth


def _unpack_millimetres(data: bytes, height: int, width: int) -> NDArray[np.uint16]:
    folded = unpack_blocks(data, height * width, 16).astype(np.uint16)
    rises = np.cumsum(_unfold(folded).reshape(height, width), axis=1, dtype=np.uint16)
    return np.cumsum(rises, axis=0, dtype=np.uint16)
