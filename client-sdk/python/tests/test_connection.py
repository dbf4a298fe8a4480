"""Tests of the connection's end: every waiting slot receives it."""

from __future__ import annotations

from queue import SimpleQueue
from typing import TYPE_CHECKING, Any

import pytest

from avln.connection import Closed, Connection, Dialler, Stream
from avln.errors import LostError
from avln.summary import Progress
from avln.v1 import play_pb2

if TYPE_CHECKING:
    from collections.abc import Iterator


class Call:
    """A stream that ends with an undocumented exception."""

    def __iter__(self) -> Iterator[Any]:
        raise ValueError("a frame from nowhere")

    def cancel(self) -> None:
        pass


def test_unexpected_error_reaches_all_slots() -> None:
    dialler = Dialler(lambda *_, **__: Call(), "token", play_pb2.Hello())
    connection = Connection(dialler, Stream(Call(), SimpleQueue()), 2, 0.0, Progress(0, 0, 0, None))
    for slot in range(2):
        event = connection.next(slot, timeout_s=10)
        assert isinstance(event, Closed)
        with pytest.raises(LostError, match="ValueError: a frame from nowhere"):
            raise event.because("wait")
    connection.close()
    assert connection._stream.call is None, "a remaining call would block the interpreter's exit"


def test_closed_connection_repeats_end_event() -> None:
    dialler = Dialler(lambda *_, **__: Call(), "token", play_pb2.Hello())
    connection = Connection(dialler, Stream(Call(), SimpleQueue()), 1, 0.0, Progress(0, 0, 0, None))
    for _ in range(3):
        assert isinstance(connection.next(0, timeout_s=10), Closed)
    connection.close()
