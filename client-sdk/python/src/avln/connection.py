"""A run's connection.

A thread reads the stream, replies to pings, passes frames to slots, and reconnects after a loss.
"""

from __future__ import annotations

import atexit
import threading
import time
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, Callable, Union
from weakref import WeakSet

import grpc

from avln.backoff import Backoff
from avln.errors import Error, LostError, from_call, is_passing
from avln.resend_buffer import Arrived, ResendBuffer, Sent
from avln.summary import Notice, Progress
from avln.v1 import common_pb2, play_pb2

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

CALL_TIMEOUT_S = 30.0
PLAY = "open the run's stream"
_MAX_NOTICES = 64
_PATIENCE_S = 180.0


@dataclass(frozen=True)
class Closed:
    """The end of a connection: no further frames."""

    error: Error | None
    """The stream's error; None for success."""

    def because(self, attempted: str) -> Error:
        """Returns the pending call's error."""
        if self.error is not None:
            return self.error
        return LostError(attempted, "the server ended the stream without a reason")


Event = Union[Arrived, Closed]
"""Slot event: a frame, or the stream end."""


@dataclass
class Stream:
    """A run's open stream."""

    call: Any
    """gRPC call that yields `play_pb2.PlayResponse`; None after `forget`."""
    requests: SimpleQueue[play_pb2.PlayRequest | None]
    """Frames to send; None ends the stream."""
    welcome: play_pb2.Welcome | None = None
    """The server's Welcome; None if the run has ended."""
    first: tuple[Arrived, ...] = ()
    """Frames received instead of a Welcome."""

    def close(self) -> None:
        """Cancels the stream without a Goodbye."""
        self.requests.put(None)
        if self.call is not None:
            self.call.cancel()

    def forget(self) -> None:
        """Releases the call after the last reader.

        A call that survives until interpreter exit waits for a lock of a possibly dead gRPC
        thread. The call is also an exception, and the frames of the traceback reference it.
        """
        if isinstance(self.call, grpc.RpcError):
            self.call.__traceback__ = None
        self.call = None


@dataclass(frozen=True)
class Dialler:
    """Data for resuming a run."""

    open_call: Callable[..., Any]
    """`PlayService.Play` of a channel."""
    token: str
    """Run token."""
    hello: play_pb2.Hello
    """The first stream's Hello."""
    patience_s: float | None = None
    """Reconnection time; None: as permitted by the server, at least three minutes."""

    def dial(self, *, known: list[play_pb2.SlotPosition] | None = None) -> Stream:
        """Opens a stream and waits for Welcome; resumes a lost stream if `known` is given.

        Raises:
            Error: if the server refuses, does not answer within 30 seconds, or the connection is lost.
        """
        hello = play_pb2.Hello()
        hello.CopyFrom(self.hello)
        if known is not None:
            hello.resume = True
            hello.known.extend(known)
        requests: SimpleQueue[play_pb2.PlayRequest | None] = SimpleQueue()
        requests.put(play_pb2.PlayRequest(hello=hello))
        call = self.open_call(iter(requests.get, None), metadata=[("authorization", f"Bearer {self.token}")])
        return _await_welcome(Stream(call, requests))


def _await_welcome(stream: Stream) -> Stream:
    watchdog = threading.Timer(CALL_TIMEOUT_S, stream.call.cancel)
    watchdog.daemon = True
    watchdog.start()
    try:
        for frame in _frames(stream.call):
            if isinstance(frame, play_pb2.Welcome):
                stream.welcome = frame
                return stream
            if isinstance(frame, (play_pb2.EpisodeEnd, play_pb2.RunEnd)):
                stream.first += (frame,)
            if isinstance(frame, play_pb2.RunEnd):
                return stream
        raise Closed(None).because(PLAY)
    except grpc.RpcError as error:
        refused = from_call(PLAY, error)
    finally:
        watchdog.cancel()
    stream.close()
    stream.forget()
    raise refused


def _frames(call: Any) -> Iterator[Any]:
    """Yields a stream's frames, without unknown ones."""
    for response in call:
        kind = response.WhichOneof("frame")
        if kind is not None:
            yield getattr(response, kind)


class Connection:
    """The connection shared by a run's slots. It sends and receives frames, and resumes after a lost stream."""

    def __init__(self, dialler: Dialler, stream: Stream, slots: int, may_be_away_s: float, progress: Progress) -> None:
        self._dialler = dialler
        self._stream = stream
        self._lock = threading.Lock()
        self._resend_buffer = ResendBuffer(slots)
        self._queues: list[SimpleQueue[Event]] = [SimpleQueue() for _ in range(slots)]
        self._notices: list[Notice] = []
        self._closing = threading.Event()
        self.progress: Progress = progress
        """Latest run progress on any slot."""
        self.on_close: Callable[[], None] = lambda: None
        """Callback that closes the underlying channel."""
        self._patience_s = _patience_s(dialler.patience_s, may_be_away_s)
        self._reader = threading.Thread(target=self._read, name="avln-reader", daemon=True)
        self._reader.start()
        _open_connections.add(self)

    @property
    def token(self) -> str:
        """Run token."""
        return self._dialler.token

    def send(self, frame: Sent | play_pb2.Goodbye) -> None:
        """Sends a frame, after a loss on the next stream.

        A final loss is reported by `next` as `Closed`.
        """
        request = _request(frame)
        with self._lock:
            if isinstance(frame, play_pb2.Goodbye):
                self._resend_buffer.said_goodbye = not frame.pause
            else:
                self._resend_buffer.sending(frame)
            self._stream.requests.put(request)

    def next(self, slot: int, timeout_s: float | None = None) -> Event:
        """Waits for a slot's next event. After the end it is always `Closed`.

        Raises:
            LostError: if there is no event for `timeout_s` seconds.
        """
        queue = self._queues[slot]
        try:
            event = queue.get(timeout=timeout_s)
        except Empty:
            raise LostError("wait for the server", f"no frame within {timeout_s:g} s") from None
        if isinstance(event, Closed):
            queue.put(event)
        return event

    def take_notices(self) -> list[Notice]:
        """Returns and clears the received notices, at most 64."""
        with self._lock:
            notices, self._notices = self._notices, []
        return notices

    def close(self) -> None:
        """Closes without a Goodbye: open episodes can be resumed within the server's time limit."""
        self._closing.set()
        with self._lock:
            self._stream.close()
        if self._reader is not threading.current_thread():
            self._reader.join(timeout=CALL_TIMEOUT_S)
        self._stream.forget()
        _open_connections.discard(self)
        self.on_close()

    def _read(self) -> None:
        """Reads until the end. Every failure must reach the waiting callers, because no other thread reports it."""
        try:
            self._read_streams()
        except Exception as unforeseen:
            detail = f"{type(unforeseen).__name__}: {unforeseen}"
            self._to_all(Closed(LostError("read the run's stream", detail)))

    def _read_streams(self) -> None:
        while True:
            error = self._read_stream()
            try:
                if not self._come_back(error):
                    return self._to_all(Closed(error))
            except Error as final:
                return self._to_all(Closed(final))

    def _read_stream(self) -> Error | None:
        """Reads until the end of the stream and returns the error: None for success."""
        try:
            for frame in _frames(self._stream.call):
                self._deliver(frame)
        except grpc.RpcError as error:
            return from_call("play", error)
        return None

    def _come_back(self, error: Error | None) -> bool:
        """Reconnects until the server answers; returns False if the run needs no other stream."""
        is_lost = (error is None or is_passing(error)) and not self._resend_buffer.is_over
        if self._patience_s is None or not is_lost:
            return False
        until = time.monotonic() + self._patience_s
        backoff = Backoff()
        while not self._closing.is_set():
            try:
                return self._dial()
            except Error as failure:
                pause_s = backoff.after(failure)
                if not is_passing(failure) or time.monotonic() + pause_s >= until:
                    raise
            self._closing.wait(pause_s)
        return False

    def _dial(self) -> bool:
        """Opens the next stream and resends unanswered frames; returns False if the run has ended meanwhile."""
        with self._lock:
            known = self._resend_buffer.known()
        stream = self._dialler.dial(known=known)
        if stream.welcome is None:
            for frame in stream.first:
                self._deliver(frame)
            stream.close()
            return False
        with self._lock:
            old, self._stream = self._stream, stream
            old.requests.put(None)
            self._repeat(stream.welcome.resumed)
            if self._closing.is_set():
                stream.close()
        return True

    def _repeat(self, resumed: Iterable[play_pb2.SlotPosition]) -> None:
        for frame in self._resend_buffer.to_repeat(resumed):
            self._stream.requests.put(_request(frame))
        if self._resend_buffer.said_goodbye:
            self._stream.requests.put(_request(play_pb2.Goodbye()))

    def _deliver(self, frame: Any) -> None:
        if isinstance(frame, play_pb2.Ping):
            self._stream.requests.put(play_pb2.PlayRequest(pong=play_pb2.Pong(nonce=frame.nonce)))
        elif isinstance(frame, play_pb2.Notice):
            self._note(Notice(frame.message, frame.effective_unix_ms))
        elif not isinstance(frame, play_pb2.Welcome):  # a second Welcome changes nothing
            self._deliver_event(frame)

    def _deliver_event(self, frame: Arrived) -> None:
        with self._lock:
            is_gone = isinstance(frame, play_pb2.Fault) and self._resend_buffer.is_gone(frame)
            is_new = self._resend_buffer.arrived(frame)
            if not isinstance(frame, (play_pb2.Observation, play_pb2.Fault)):
                self.progress = Progress.from_wire(frame.progress)
        if isinstance(frame, play_pb2.RunEnd):
            self._to_all(frame)
        elif isinstance(frame, play_pb2.Fault) and not frame.HasField("slot"):
            # A stopping server also ends the stream, and the next stream continues.
            if frame.reason != common_pb2.REASON_DRAINING or self._patience_s is None:
                self._to_all(frame)
        elif isinstance(frame, play_pb2.Fault) and is_gone:
            self._to(frame.slot, _lost_by_the_server(frame))
        elif is_new:
            self._to(frame.slot, frame)

    def _note(self, notice: Notice) -> None:
        with self._lock:
            if len(self._notices) < _MAX_NOTICES:
                self._notices.append(notice)

    def _to(self, slot: int, event: Event) -> None:
        if slot < len(self._queues):
            self._queues[slot].put(event)

    def _to_all(self, event: Event) -> None:
        for queue in self._queues:
            queue.put(event)


_open_connections: WeakSet[Connection] = WeakSet()


@atexit.register
def _close_connections() -> None:
    """Closes open connections while their threads still run."""
    for connection in list(_open_connections):
        connection.close()


def _patience_s(wanted_s: float | None, may_be_away_s: float) -> float | None:
    """Returns the reconnection time after a loss; None disables reconnection."""
    if may_be_away_s == 0:
        return None
    return max(may_be_away_s, _PATIENCE_S) if wanted_s is None else wanted_s


def _request(frame: Sent | play_pb2.Goodbye) -> play_pb2.PlayRequest:
    if isinstance(frame, play_pb2.Act):
        return play_pb2.PlayRequest(act=frame)
    if isinstance(frame, play_pb2.Ready):
        return play_pb2.PlayRequest(ready=frame)
    if isinstance(frame, play_pb2.Abandon):
        return play_pb2.PlayRequest(abandon=frame)
    return play_pb2.PlayRequest(goodbye=frame)


def _lost_by_the_server(fault: play_pb2.Fault) -> play_pb2.EpisodeEnd:
    """Returns the end of an episode that the server could not restore and will reissue."""
    return play_pb2.EpisodeEnd(
        slot=fault.slot, episode=fault.episode, step=fault.step, reason=common_pb2.END_REASON_SERVER_FAULT
    )
