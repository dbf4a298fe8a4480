"""How episodes and runs stand and end."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from avln.action import EndReason

if TYPE_CHECKING:
    from collections.abc import Iterable

    from avln.v1 import common_pb2, play_pb2


@dataclass(frozen=True)
class Progress:
    """How far a run is."""

    total: int = 0
    """Episodes of the run."""
    done: int = 0
    """Episodes that ended and are stored."""
    in_flight: int = 0
    """Episodes that are being played."""
    eta_s: int | None = None
    """Estimated seconds to the end; None until one episode has ended."""

    @property
    def waiting(self) -> int:
        """Episodes that did not begin."""
        return max(self.total - self.done - self.in_flight, 0)

    @classmethod
    def from_wire(cls, progress: common_pb2.RunProgress) -> Progress:
        """The progress of a message."""
        eta_s = progress.eta_s if progress.HasField("eta_s") else None
        return cls(progress.total, progress.done, progress.in_flight, eta_s)


@dataclass(frozen=True)
class Metric:
    """A number that a phase shows."""

    name: str
    """Name, lower snake case: sr, isr, osr, spl, soft_spl …"""
    value: float
    """Value, in the unit that the name ends in, else without unit."""
    interval: tuple[float, float] | None = None
    """Both ends of the 95 % interval, where there is one."""

    def __str__(self) -> str:
        text = f"{self.name} {self.value:.3f}"
        return text if self.interval is None else f"{text} [{self.interval[0]:.3f}, {self.interval[1]:.3f}]"


@dataclass(frozen=True)
class EpisodeEnd:
    """How an episode ended."""

    episode: str
    """Random handle of the episode, good for this run only."""
    reason: EndReason
    """Why it ended."""
    terminated: bool
    """Whether the task itself ended it; otherwise it was truncated."""
    steps: int
    """Steps taken."""
    metrics: list[Metric] | None
    """Its metrics; None where the phase shows none."""
    progress: Progress
    """How far the run is now."""

    @classmethod
    def from_wire(cls, end: play_pb2.EpisodeEnd) -> EpisodeEnd:
        """The end of a message."""
        shown = metrics(end.metrics) if end.HasField("metrics") else None
        progress = Progress.from_wire(end.progress)
        return cls(end.episode, EndReason.from_wire(end.reason), end.terminated, end.step, shown, progress)


@dataclass(frozen=True)
class RunSummary:
    """How a run ended; `print` shows it."""

    run: str = ""
    """Id of the run."""
    progress: Progress = Progress()
    """How far it came."""
    complete: bool = False
    """Whether every episode was played."""
    ends: list[tuple[EndReason, int]] = field(default_factory=list)
    """How its episodes ended, and how many of them."""
    metrics: list[Metric] | None = None
    """Its metrics; None where the phase shows none."""
    url: str = ""
    """Where people find the result; empty: nowhere."""

    def metric(self, name: str) -> Metric | None:
        """The metric called `name`, where the phase shows it."""
        return next((metric for metric in self.metrics or () if metric.name == name), None)

    @classmethod
    def from_wire(cls, end: play_pb2.RunEnd) -> RunSummary:
        """The summary of a message."""
        shown = metrics(end.metrics) if end.HasField("metrics") else None
        return cls(end.run, Progress.from_wire(end.progress), end.complete, ends(end.ends), shown, end.url)

    def __str__(self) -> str:
        state = "complete" if self.complete else "incomplete"
        head = f"{self.run}: {self.progress.done} of {self.progress.total} episodes, {state}"
        head += "".join(f"; {episodes} {reason.value}" for reason, episodes in self.ends)
        shown = ["this phase shows no metrics"] if self.metrics is None else [str(metric) for metric in self.metrics]
        return "\n  ".join([head, *shown, *([self.url] if self.url else [])])


@dataclass(frozen=True)
class Notice:
    """News from the server that needs no answer, for people: it drains, time runs low, maintenance is announced."""

    message: str
    """The text."""
    effective_unix_ms: int
    """When it takes effect, milliseconds since 1970 UTC; 0: now."""


def metrics(shown: common_pb2.PublicMetrics) -> list[Metric]:
    """The metrics of a message, in the order of the phase's columns."""
    return [Metric(m.name, m.value, _interval(m)) for m in shown.metrics]


def _interval(metric: common_pb2.Metric) -> tuple[float, float] | None:
    return (metric.low, metric.high) if metric.HasField("low") and metric.HasField("high") else None


def ends(counts: Iterable[play_pb2.EndCount]) -> list[tuple[EndReason, int]]:
    """How episodes ended, and how many of them."""
    return [(EndReason.from_wire(count.reason), count.episodes) for count in counts]
