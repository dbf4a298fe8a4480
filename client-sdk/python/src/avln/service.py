"""Server, phases, runs, quota and account."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from avln.action import EndReason, Order
from avln.errors import PhaseError
from avln.method_type import MethodType
from avln.summary import Metric, Progress, ends, metrics
from avln.task import word
from avln.v1 import common_pb2, info_pb2, run_pb2, task_pb2

if TYPE_CHECKING:
    from collections.abc import Iterable

_OVER = {"completed", "failed", "cancelled", "expired"}
_UNCOUNTED = {"concurrent", "uncharged"}


@dataclass(frozen=True)
class ServerInfo:
    """Server information."""

    name: str
    """Server name, chosen by the organiser."""
    version: str
    """Server program version."""
    api_minor: int
    """Highest supported minor number in `avln.v1`."""
    benchmark: str
    """Benchmark version; changes if scores may change."""
    draining: bool
    """True if the server is stopping and accepts no new runs."""
    notice: str
    """Announcement for people; empty: none."""
    time_unix_ms: int
    """The server's clock when it answered, milliseconds since 1970 UTC."""

    @classmethod
    def from_wire(cls, info: info_pb2.GetServerInfoResponse) -> ServerInfo:
        """Converts a message."""
        draining = info.state == info_pb2.SERVER_STATE_DRAINING
        return cls(
            info.name,
            info.version,
            info.api_minor,
            info.benchmark,
            draining,
            info.notice,
            info.server_time_unix_ms,
        )


@dataclass(frozen=True)
class Phase:
    """A phase: episodes under equal conditions."""

    id: str
    """Id for `Client.start_run`."""
    title: str
    """Name for people."""
    description: str
    """Text for people."""
    orders: list[Order]
    """Orders available to a run."""
    episodes: int
    """Episodes in a run."""
    max_slots: int
    """Most slots per run."""
    max_side: int
    """Most pixels per image side."""
    feedback: str
    """Feedback to a Submit: `none`, `accepted` or `verdict`."""
    state: str
    """Acceptance of new runs: `upcoming`, `open`, `paused` or `closed`."""
    state_reason: str
    """Reason for the state, for people; may be empty."""
    rules: str
    """Rule set name and version."""

    @classmethod
    def from_wire(cls, phase: info_pb2.Phase) -> Phase:
        """Converts a message."""
        return cls(
            id=phase.id,
            title=phase.title,
            description=phase.description,
            orders=_orders(phase.orders),
            episodes=phase.episodes,
            max_slots=phase.max_slots,
            max_side=phase.max_side or 1024,
            feedback=word(task_pb2.FeedbackRule, phase.feedback),
            state=word(info_pb2.PhaseState, phase.state),
            state_reason=phase.state_reason,
            rules=phase.rules,
        )


def _orders(numbers: Iterable[int]) -> list[Order]:
    words = [word(common_pb2.Order, number) for number in numbers]
    return [order for order in Order if order.value in words]


@dataclass(frozen=True)
class Run:
    """A run with its token."""

    id: str
    """Id; empty when only the token is known."""
    token: str
    """Token for this run only."""
    episodes: int = 0
    """Episode count; 0 when only the token is known."""
    max_slots: int = 0
    """Most slots; 0 when only the token is known."""
    phase: str = ""
    """The phase; empty when only the token is known."""

    @classmethod
    def from_token(cls, token: str) -> Run:
        """Creates a run from its token, as in a sealed container."""
        return cls("", token)

    @classmethod
    def from_wire(cls, started: run_pb2.StartRunResponse) -> Run:
        """Converts a message."""
        run = started.run
        return cls(run.id, started.run_token, run.progress.total, started.max_slots, run.phase)

    def __repr__(self) -> str:
        return f"Run({self.id or 'unknown id'}, {self.episodes} episodes)"


@dataclass(frozen=True)
class RunStatus:
    """Run state."""

    id: str
    """Id."""
    phase: str
    """Phase."""
    method: str
    """Method name."""
    method_type: MethodType | None
    """Method type; None if it is undeclared or unknown to this client."""
    state: str
    """`created`, `running`, `draining`, `completed`, `failed`, `cancelled` or `expired`."""
    state_reason: str
    """Reason for the state, for people."""
    progress: Progress
    """Progress."""
    ends: list[tuple[EndReason, int]]
    """Episode count by end reason."""
    metrics: list[Metric] | None
    """Metrics; None if the phase hides them."""
    charged: bool
    """True if the run counts against the quota."""
    charge_reason: str
    """Reason for charging or not charging, for people."""
    url: str
    """Web page; may be empty."""

    @property
    def is_over(self) -> bool:
        """True if the run has ended."""
        return self.state in _OVER

    @classmethod
    def from_wire(cls, run: run_pb2.Run) -> RunStatus:
        """Converts a message."""
        return cls(
            id=run.id,
            phase=run.phase,
            method=run.method.name,
            method_type=MethodType.from_wire(run.method.method_type),
            state=word(run_pb2.RunState, run.state),
            state_reason=run.state_reason,
            progress=Progress.from_wire(run.progress),
            ends=ends(run.ends),
            metrics=metrics(run.metrics) if run.HasField("metrics") else None,
            charged=run.charged,
            charge_reason=run.charge_reason,
            url=run.url,
        )


@dataclass(frozen=True)
class Quota:
    """A team's remaining quota."""

    phase: str
    """Phase."""
    window: str
    """Window: `day`, `month`, `total`, `concurrent` or `uncharged`."""
    limit: int | None
    """Runs granted in the window; None: unlimited."""
    used: int
    """Runs counted in the window."""
    remaining: int | None
    """Runs left; None: unlimited."""
    next_increase_unix_s: int
    """Time when `remaining` next increases, seconds since 1970 UTC; 0: never."""
    charges: list[tuple[str, str]]
    """Counted runs and reasons, oldest first."""

    @property
    def is_counted(self) -> bool:
        """True if the quota limits the number of started runs, in total or per time."""
        return self.limit is not None and self.window not in _UNCOUNTED

    @classmethod
    def from_wire(cls, quota: run_pb2.Quota) -> Quota:
        """Converts a message."""
        return cls(
            phase=quota.phase,
            window=word(run_pb2.QuotaWindow, quota.window),
            limit=quota.limit if quota.HasField("limit") else None,
            used=quota.used,
            remaining=quota.remaining if quota.HasField("remaining") else None,
            next_increase_unix_s=quota.next_increase_unix_s,
            charges=[(charge.run, charge.reason) for charge in quota.charges],
        )


@dataclass(frozen=True)
class Account:
    """A token and its owner."""

    team: str
    """Team name."""
    token_name: str
    """Token name."""
    scope: str
    """Scope: `participant`, `read_only`, `organiser` or `run`."""
    expires_unix_s: int
    """Expiry time, seconds since 1970 UTC; 0: never."""

    @classmethod
    def from_wire(cls, answer: run_pb2.WhoAmIResponse) -> Account:
        """Converts a message."""
        scope = word(run_pb2.TokenScope, answer.scope)
        return cls(answer.team, answer.token_name, scope, answer.expires_unix_s)


def phase_to_practise(phases: list[Phase], quotas: list[Quota]) -> str:
    """Returns the default phase's id.

    Raises:
        PhaseError: if there is no or no unique default phase.
    """
    counted = {quota.phase for quota in quotas if quota.is_counted}
    free = [phase.id for phase in phases if phase.state == "open" and phase.id not in counted]
    if len(free) == 1:
        return free[0]
    if "practice" in free:
        return "practice"
    raise PhaseError(free, [phase.id for phase in phases])
