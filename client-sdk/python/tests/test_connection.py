"""Every waiting slot receives the end, for any cause."""

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
    """A stream that ends by what gRPC does not say."""

    def __iter__(self) -> Iterator[Any]:
        raise ValueError("a frame from nowhere")

    def cancel(self) -> None:
        pass


def test_what_nobody_foresaw_reaches_who_waits() -> None:
    dialler = Dialler(lambda *_, **__: Call(), "token", play_pb2.Hello())
    connection = Connection(dialler, Stream(Call(), SimpleQueue()), 2, 0.0, Progress(0, 0, 0, None))
    for slot in range(2):
        event = connection.next(slot, timeout_s=10)
        assert isinstance(event, Closed)
        with pytest.raises(LostError, match="ValueError: a frame from nowhere"):
            raise event.because("wait")
    connection.close()
    assert connection._stream.call is None, "the interpreter's end waits for calls that live on"


def test_the_end_is_told_as_often_as_it_is_asked_for() -> None:
    dialler = Dialler(lambda *_, **__: Call(), "token", play_pb2.Hello())
    connection = Connection(dialler, Stream(Call(), SimpleQueue()), 1, 0.0, Progress(0, 0, 0, None))
    for _ in range(3):
        assert isinstance(connection.next(0, timeout_s=10), Closed)
    connection.close()
