"""Run slots and their episodes."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from avln.action import Action
from avln.connection import Closed, Connection, Event
from avln.errors import (
    EpisodeOverError,
    Error,
    ProtocolError,
    UnknownActionError,
    from_fault,
)
from avln.mission import Mission
from avln.observation import Observation
from avln.summary import EpisodeEnd, Notice, Progress, RunSummary
from avln.v1 import play_pb2

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import TracebackType

    from avln.agreement import Agreement
    from avln.task import TaskSpec

_FAREWELL_S = 60.0
_BEGIN, _STEP, _ABANDON, _FINISH = (
    "begin an episode",
    "take a step",
    "abandon an episode",
    "finish the run",
)


@dataclass(frozen=True)
class TimeLeft:
    """Remaining time for the next action."""

    step_s: float | None
    """Thinking time that does not use the time bank, seconds; None: unlimited."""
    bank_s: float
    """Remaining time bank of the episode, in addition to `step_s`, seconds."""


class Episode:
    """An episode in progress. Iterating yields observations until the end.

    The body of the loop takes an action: `for observation in episode:
    episode.act(policy(observation))`.
    """

    def __init__(self, play: Play, start: play_pb2.EpisodeStart) -> None:
        if not start.HasField("observation"):
            raise ProtocolError("EpisodeStart has no observation")
        self._play = play
        self._connection = play.connection
        self._agreement = play.agreement
        self._awaits = False
        self.id: str = start.episode
        """Random episode handle, valid in this run only."""
        self.ordinal: int = start.ordinal
        """Episode number in start order, from 1."""
        self.mission: Mission = Mission.from_wire(start.mission)
        """The mission."""
        self.observation: Observation = Observation()
        """Latest observation: at the start, or after the last step."""
        self.end: EpisodeEnd | None = None
        """Episode result; None before its end."""
        self.fault: Error | None = None
        """Server failure that ended the episode with `EndReason.SERVER_FAULT`."""
        self.time_left: TimeLeft = TimeLeft(None, 0.0)
        """Time for the next action."""
        self._see(start.observation)

    @property
    def is_over(self) -> bool:
        """True after the end."""
        return self.end is not None

    @property
    def task(self) -> TaskSpec:
        """Task rules."""
        return self._agreement.task

    def __iter__(self) -> Iterator[Observation]:
        while not self.is_over:
            step = self.observation.step
            yield self.observation
            if not self.is_over and self.observation.step == step:
                raise Error(f"no action was taken after observation {step}; call Episode.act once per observation")

    def act(self, action: Action) -> Observation:
        """Takes a step and returns the next observation.

        If a limit ends the episode before the step, it returns the last observation.

        Raises:
            EpisodeOverError: after the end.
            UnknownActionError: if `action` is not 0 to 4.
            RefusedError: if the server rejects the step; the episode continues.
            Error: if the protocol is violated or the connection is lost.
        """
        self.send(action)
        return self.receive()

    def send(self, action: Action) -> None:
        """Sends an action without waiting, so that slots play in parallel; `receive` returns the result.

        Raises:
            EpisodeOverError: after the end.
            UnknownActionError: if `action` is not 0 to 4.
        """
        if self.is_over:
            raise EpisodeOverError
        number = _checked(action).to_wire()
        step = self.observation.step + 1
        self._connection.send(play_pb2.Act(slot=self._play.slot, episode=self.id, step=step, action=number))
        self._awaits = True

    def receive(self) -> Observation:
        """Waits for the result of the sent action and returns the observation.

        Raises:
            RefusedError: if the server rejects the step; the episode continues.
            Error: if the protocol is violated or the connection is lost.
        """
        step = self.observation.step + 1
        while self._awaits:
            event = self._connection.next(self._play.slot)
            if isinstance(event, play_pb2.Observation) and event.episode == self.id:
                self._take(event, step)
            else:
                self._settle(_STEP, event)
        return self.observation

    def abandon(self) -> None:
        """Abandons the episode, which counts with the current result. No effect after the end.

        Raises:
            Error: if the protocol is violated or the connection is lost.
        """
        if self.is_over:
            return
        self._connection.send(play_pb2.Abandon(slot=self._play.slot, episode=self.id, step=self.observation.step))
        self._await_end(_ABANDON)

    def _take(self, seen: play_pb2.Observation, step: int) -> None:
        if seen.step != step:
            raise ProtocolError(f"observation: expected step {step}, got {seen.step}")
        self._see(seen)
        self._awaits = False
        if seen.terminated or seen.truncated:
            self._await_end(_STEP)

    def _see(self, seen: play_pb2.Observation) -> None:
        self.observation = self._agreement.unpack(seen)
        step_ms = seen.time.step_ms
        self.time_left = TimeLeft(step_ms / 1000 if step_ms else None, seen.time.bank_ms / 1000)

    def _await_end(self, attempted: str) -> None:
        while not self.is_over:
            self._settle(attempted, self._connection.next(self._play.slot))

    def _settle(self, attempted: str, event: Event) -> None:
        """Handles an event while a reply is pending; ignores frames of the previous episode."""
        if isinstance(event, play_pb2.EpisodeEnd) and event.episode == self.id:
            self._awaits = False
            self.end = EpisodeEnd.from_wire(event)
        elif isinstance(event, play_pb2.Fault):
            self._weigh(attempted, event)
        elif isinstance(event, Closed):
            raise event.because(attempted)
        elif isinstance(event, (play_pb2.RunEnd, play_pb2.EpisodeStart)):
            raise ProtocolError(f"{event.DESCRIPTOR.name} arrived while an episode was open")

    def _weigh(self, attempted: str, fault: play_pb2.Fault) -> None:
        """Stores a fault that ends this episode, because EpisodeEnd follows; others are stale."""
        if fault.episode not in ("", self.id):
            return
        error = from_fault(attempted, fault)
        if fault.recoverable or not fault.HasField("slot"):
            self._awaits = False
            raise error
        self.fault = error


class Play:
    """A run slot, which plays episodes in sequence. Iterating yields every episode of the run.

    After a lost connection, the slot reconnects and resumes its episode within the server's time
    limit. As a context manager it sends Goodbye at the end; after an exception the run stays open
    and can be continued with the run token.
    """

    def __init__(self, connection: Connection, agreement: Agreement, slot: int) -> None:
        self.connection: Connection = connection
        """Connection shared by the run's slots."""
        self.agreement: Agreement = agreement
        """Settings agreed between client and server."""
        self.slot: int = slot
        """Slot number, from 0."""
        self.episode: Episode | None = None
        """Latest episode; None before the first."""
        self.summary: RunSummary | None = None
        """Run result; None before its end."""

    @property
    def task(self) -> TaskSpec:
        """Task rules."""
        return self.agreement.task

    @property
    def run(self) -> str:
        """Run id."""
        return self.agreement.run

    @property
    def token(self) -> str:
        """Run token; as the token of `begin` it continues the run after this program."""
        return self.connection.token

    @property
    def progress(self) -> Progress:
        """Latest run progress, reported on any slot."""
        return self.connection.progress

    def take_notices(self) -> list[Notice]:
        """Returns and clears the received notices, at most 64."""
        return self.connection.take_notices()

    def __iter__(self) -> Iterator[Episode]:
        while (episode := self.next_episode()) is not None:
            yield episode

    def next_episode(self) -> Episode | None:
        """Begins the next episode; None if no episode remains. Abandons an open episode first.

        The time limit for the first action starts immediately: load models before.

        Raises:
            Error: if the server rejects the request, violates the protocol, or the connection is lost.
        """
        self.request_episode()
        return self.receive_episode()

    def request_episode(self) -> None:
        """Requests the next episode without waiting; `receive_episode` returns it.

        Raises:
            Error: if an open episode cannot be abandoned.
        """
        if self.summary is not None:
            return
        if self.episode is not None:
            self.episode.abandon()
        self.connection.send(play_pb2.Ready(slot=self.slot))

    def receive_episode(self) -> Episode | None:
        """Waits for the requested episode; None after the last episode and the end of all slots.

        Raises:
            Error: if the server rejects the request, violates the protocol, or the connection is lost.
        """
        while self.summary is None:
            event = self.connection.next(self.slot)
            if isinstance(event, play_pb2.EpisodeStart):
                self.episode = Episode(self, event)
                return self.episode
            self._settle(_BEGIN, event)
        return None

    def _settle(self, attempted: str, event: Event) -> None:
        if isinstance(event, play_pb2.RunEnd):
            self.summary = RunSummary.from_wire(event)
        elif isinstance(event, play_pb2.Fault) and not event.episode:
            raise from_fault(attempted, event)
        elif isinstance(event, Closed):
            raise event.because(attempted)

    def finish(self) -> RunSummary:
        """Ends the run on all slots with Goodbye and closes the connection; abandons open episodes.

        Raises:
            Error: if the connection is lost or the server does not answer within a minute.
        """
        try:
            self.connection.send(play_pb2.Goodbye())
            until = time.monotonic() + _FAREWELL_S
            while self.summary is None:
                event = self.connection.next(self.slot, timeout_s=max(until - time.monotonic(), 0.001))
                self._settle_farewell(event)
            return self.summary
        finally:
            self.close()

    def _settle_farewell(self, event: Event) -> None:
        """Handles an event after Goodbye; ignores slot faults, because Goodbye has ended the episode."""
        if isinstance(event, play_pb2.Fault) and (event.HasField("slot") or event.recoverable):
            return
        self._settle(_FINISH, event)

    def close(self) -> None:
        """Closes the connection of all slots without Goodbye; the run token can continue the run."""
        self.connection.close()

    def __enter__(self) -> Play:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self.finish()
        else:
            self.close()


def _checked(action: Action) -> Action:
    try:
        return Action(action)
    except ValueError:
        known = ", ".join(f"Action.{known.name} ({known.value})" for known in Action)
        raise UnknownActionError(action, known) from None
