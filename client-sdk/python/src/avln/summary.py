"""Episode and run results."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from avln.action import EndReason

if TYPE_CHECKING:
    from collections.abc import Iterable

    from avln.v1 import common_pb2, play_pb2


@dataclass(frozen=True)
class Progress:
    """Run progress in episodes."""

    total: int = 0
    """Episodes in the run."""
    done: int = 0
    """Stored episodes."""
    in_flight: int = 0
    """Open episodes."""
    eta_s: int | None = None
    """Estimated seconds to the end; None until an episode has ended."""

    @property
    def waiting(self) -> int:
        """Episodes not started yet."""
        return max(self.total - self.done - self.in_flight, 0)

    @classmethod
    def from_wire(cls, progress: common_pb2.RunProgress) -> Progress:
        """Converts a message."""
        eta_s = progress.eta_s if progress.HasField("eta_s") else None
        return cls(progress.total, progress.done, progress.in_flight, eta_s)


@dataclass(frozen=True)
class Metric:
    """A public metric."""

    name: str
    """Name, lower snake case: sr, isr, osr, spl, soft_spl …"""
    value: float
    """Value, in the unit at the name's end; otherwise without unit."""
    interval: tuple[float, float] | None = None
    """95 % interval, if known."""

    def __str__(self) -> str:
        text = f"{self.name} {self.value:.3f}"
        return text if self.interval is None else f"{text} [{self.interval[0]:.3f}, {self.interval[1]:.3f}]"


@dataclass(frozen=True)
class EpisodeEnd:
    """An episode's result."""

    episode: str
    """Random episode handle, valid in this run only."""
    reason: EndReason
    """End reason."""
    terminated: bool
    """True if the task ended the episode; otherwise it was truncated."""
    steps: int
    """Steps taken."""
    metrics: list[Metric] | None
    """Metrics; None if the phase hides them."""
    progress: Progress
    """Run progress."""

    @classmethod
    def from_wire(cls, end: play_pb2.EpisodeEnd) -> EpisodeEnd:
        """Converts a message."""
        shown = metrics(end.metrics) if end.HasField("metrics") else None
        progress = Progress.from_wire(end.progress)
        return cls(end.episode, EndReason.from_wire(end.reason), end.terminated, end.step, shown, progress)


@dataclass(frozen=True)
class RunSummary:
    """A run's result, printable."""

    run: str = ""
    """Run id."""
    progress: Progress = Progress()
    """Final progress."""
    complete: bool = False
    """True if every episode was played."""
    ends: list[tuple[EndReason, int]] = field(default_factory=list)
    """Episode count by end reason."""
    metrics: list[Metric] | None = None
    """Metrics; None if the phase hides them."""
    url: str = ""
    """Result web page; may be empty."""

    def metric(self, name: str) -> Metric | None:
        """Returns the metric `name`, if public."""
        return next((metric for metric in self.metrics or () if metric.name == name), None)

    @classmethod
    def from_wire(cls, end: play_pb2.RunEnd) -> RunSummary:
        """Converts a message."""
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
    """An announcement for people, for example of a server stop, low time or maintenance."""

    message: str
    """Text."""
    effective_unix_ms: int
    """Effective time, milliseconds since 1970 UTC; 0: now."""


def metrics(shown: common_pb2.PublicMetrics) -> list[Metric]:
    """Converts metrics, in column order."""
    return [Metric(m.name, m.value, _interval(m)) for m in shown.metrics]


def _interval(metric: common_pb2.Metric) -> tuple[float, float] | None:
    return (metric.low, metric.high) if metric.HasField("low") and metric.HasField("high") else None


def ends(counts: Iterable[play_pb2.EndCount]) -> list[tuple[EndReason, int]]:
    """Converts episode counts by end reason."""
    return [(EndReason.from_wire(count.reason), count.episodes) for count in counts]
