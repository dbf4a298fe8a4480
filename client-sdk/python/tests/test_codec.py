"""Tests of decoding as defined in PROTOCOL.md."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from avln import codec
from avln.packing import Packing, is_this_machine
from avln.v1 import common_pb2 as v1

RAW, PACKED = v1.ENCODING_RAW, v1.ENCODING_PACKED


def fold(difference: int) -> int:
    """Maps differences to small numbers: 0, -1, 1, -2, 2 become 0, 1, 2, 3, 4."""
    return 2 * difference if difference >= 0 else -2 * difference - 1


def pack(numbers: list[int]) -> bytes:
    """Packs blocks of 16 by the definition in PROTOCOL.md: number by number, bit by bit."""
    numbers = numbers + [0] * (-len(numbers) % 16)
    widths, body = [], b""
    for first in range(0, len(numbers), 16):
        block = numbers[first : first + 16]
        width = max(number.bit_length() for number in block)
        bits = sum(number << (width * index) for index, number in enumerate(block))
        widths.append(width)
        body += bits.to_bytes(2 * width, "little")
    return bytes(widths) + body


def signed(difference: int, bits: int) -> int:
    difference %= 1 << bits
    return difference - (1 << bits) if difference >> (bits - 1) else difference


def bits_of(number: float) -> int:
    return int(struct.unpack("<I", struct.pack("<f", number))[0])


def test_block_layout_matches_protocol() -> None:
    golden = bytes([3, 1, 0b0001_0101, 0, 0, 0, 0, 0b1110_0000, 1, 0])
    numbers = [5, 2] + [0] * 13 + [7, 1]
    assert pack(numbers) == golden
    assert codec.unpack_blocks(golden, 17, 3).tolist() == numbers


@pytest.mark.parametrize("width", range(33))
def test_every_width_round_trips(width: int) -> None:
    most = (1 << width) - 1
    numbers = [most >> (index % (width + 1)) for index in range(45)]
    assert codec.unpack_blocks(pack(numbers), 45, width).tolist() == numbers


@pytest.mark.parametrize(
    ("data", "complaint"),
    [(b"", "widths"), (b"\x09\x00", "9 bits"), (b"\x08\x00\x00", "announce"), (b"\0\0", "announce")],
)
def test_inconsistent_bytes_are_rejected(data: bytes, complaint: str) -> None:
    with pytest.raises(codec.CodecError, match=complaint):
        codec.unpack_blocks(data, 16, 8)


def test_packed_colours_use_row_differences() -> None:
    picture = np.array([[[10, 20, 30], [255, 0, 1]], [[12, 19, 30], [0, 255, 255]]], np.uint8)
    planes = [picture[..., 1], picture[..., 0] - picture[..., 1], picture[..., 2] - picture[..., 1]]
    numbers = [
        fold(signed(int(plane[row, column]) - (int(plane[row - 1, column]) if row else 0), 8))
        for plane in planes
        for row in range(2)
        for column in range(2)
    ]
    # Green 20, 0, then 19 - 20 = -1 and 255 - 0 = -1; red minus green is 246 = -10 …
    assert numbers[:5] == [40, 0, 1, 1, 19]
    np.testing.assert_array_equal(codec.decode_rgb(PACKED, pack(numbers), 2, 2), picture)


def test_packed_depth_is_predicted_from_two_rows() -> None:
    depth = np.array([[1.0, 2.0], [2.0, 0.0], [5.0, 3.0], [7.0, 0.0]], np.float32)
    # Third row: a = 2, b = 1: 2 / (1 + 1 - 2) is not finite, so 2; a = 0, b = 2: 0 is not positive, so 0.
    # Fourth row: a = 5, b = 2: 10 / (2 + 2 - 5) = -10, so 5; a = 3, b = 0: 0 / -3, so 3.
    predicted = [[0.0, 1.0], [1.0, 2.0], [2.0, 0.0], [5.0, 3.0]]
    differences = [
        signed(bits_of(own) - bits_of(prediction), 32)
        for own, prediction in zip(depth.reshape(-1).tolist(), np.reshape(predicted, -1).tolist())
    ]
    packed = pack([fold(difference) for difference in differences])
    np.testing.assert_array_equal(codec.decode_depth(PACKED, packed, 4, 2), depth)


def test_plane_depth_is_predicted_exactly() -> None:
    column = [2.0, 3.0, 6.0]  # 1/d decreases by a sixth per row: 6 = 3 · 2 / (2 + 2 - 3)
    differences = [bits_of(2.0), bits_of(3.0) - bits_of(2.0), 0]
    packed = pack([fold(difference) for difference in differences])
    assert codec.decode_depth(PACKED, packed, 3, 1).reshape(-1).tolist() == column


def test_millimetres_are_predicted_from_three_neighbours() -> None:
    millimetres = np.array([[1000, 1001], [900, 65535]], np.uint16)
    numbers = [fold(1000), fold(1), fold(-100), fold(signed(65535 - (900 + 1001 - 1000), 16))]
    depth = codec.decode_depth(v1.ENCODING_DEPTH_U16_MM_PACKED, pack(numbers), 2, 2)
    np.testing.assert_allclose(depth, millimetres / 1000, rtol=1e-6)
    plain = codec.decode_depth(v1.ENCODING_DEPTH_U16_MM, millimetres.astype("<u2").tobytes(), 2, 2, unit_m=10.0)
    np.testing.assert_allclose(plain, millimetres / 10_000, rtol=1e-6)


def test_16_bit_sound_has_full_scale_one() -> None:
    samples = struct.pack("<4h", 32767, -32767, 0, 16384)
    audio = codec.decode_audio(v1.ENCODING_AUDIO_I16, samples, 2)
    np.testing.assert_allclose(audio, [[1.0, -1.0], [0.0, 16384 / 32767]], rtol=1e-6)


def test_raw_arrays_are_views_of_message() -> None:
    data = bytes(range(24))
    picture = codec.decode_rgb(RAW, data, 2, 4)
    assert np.shares_memory(picture, np.frombuffer(data, np.uint8))
    assert picture[1, 0].tolist() == [12, 13, 14]
    depth = codec.decode_depth(RAW, struct.pack("<2f", 1.5, 0.0), 1, 2)
    assert depth.tolist() == [[1.5, 0.0]]


def test_wrong_lengths_and_encodings_are_rejected() -> None:
    with pytest.raises(codec.CodecError, match="expected 12 bytes, got 11"):
        codec.decode_rgb(RAW, bytes(11), 2, 2)
    with pytest.raises(codec.CodecError, match="ENCODING_PNG is not an encoding of sound"):
        codec.decode_audio(v1.ENCODING_PNG, b"", 4)
    with pytest.raises(codec.CodecError, match="encoding 99"):
        codec.decode_rgb(99, b"", 2, 2)
    with pytest.raises(codec.CodecError, match="ENCODING_QOI"):
        codec.decode_depth(v1.ENCODING_QOI, b"", 2, 2)


def test_raw_is_always_requested_and_rounding_optional() -> None:
    rounding = {v1.ENCODING_DEPTH_U16_MM, v1.ENCODING_DEPTH_U16_MM_PACKED, v1.ENCODING_AUDIO_I16}
    for kind in (v1.SENSOR_KIND_RGB, v1.SENSOR_KIND_DEPTH, v1.SENSOR_KIND_AUDIO):
        for packing in Packing:
            wishes = packing.wishes(kind)
            assert RAW in wishes
            rounds = packing is Packing.ROUNDED and kind != v1.SENSOR_KIND_RGB
            assert bool(rounding & set(wishes)) == rounds


def test_loopback_addresses_are_local() -> None:
    assert all(map(is_this_machine, ["localhost", "127.0.0.1", "127.8.0.1", "[::1]"]))
    assert not any(map(is_this_machine, ["arena.example", "10.0.0.1", "[2001:db8::1]", "localhost.example"]))
