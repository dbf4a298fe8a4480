"""Checks of received tensors against Welcome."""

import pytest

from avln import ProtocolError
from avln.agreement import _check_tensor
from avln.v1 import common_pb2 as v1
from avln.v1 import task_pb2

SHAPE = [2, 2, 3]
AGREED = task_pb2.TensorSpec(name="rgb", dtype=v1.DTYPE_U8, shape=SHAPE, encoding=v1.ENCODING_PACKED)


def test_raw_numbers_may_replace_the_agreed_encoding() -> None:
    for encoding in (v1.ENCODING_PACKED, v1.ENCODING_RAW):
        _check_tensor(AGREED, v1.Tensor(dtype=v1.DTYPE_U8, shape=SHAPE, encoding=encoding))


def test_other_encodings_and_shapes_are_refused() -> None:
    with pytest.raises(ProtocolError, match=r"got \[2, 2, 3\] as ENCODING_PNG"):
        _check_tensor(AGREED, v1.Tensor(dtype=v1.DTYPE_U8, shape=SHAPE, encoding=v1.ENCODING_PNG))
    with pytest.raises(ProtocolError):
        _check_tensor(AGREED, v1.Tensor(dtype=v1.DTYPE_F32, shape=SHAPE, encoding=v1.ENCODING_RAW))
    with pytest.raises(ProtocolError, match=r"got \[12\]"):
        _check_tensor(AGREED, v1.Tensor(dtype=v1.DTYPE_U8, shape=[12], encoding=v1.ENCODING_RAW))
