"""Whether a run will go well: server, clock, token, phase, quota, speed."""

from __future__ import annotations

import statistics
import time
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from avln.action import Action, Order
from avln.arena import Arena, connect
from avln.errors import Error
from avln.version import API_MINOR, VERSION

if TYPE_CHECKING:
    from collections.abc import Iterator

    from avln.link import Link
    from avln.play import Play
    from avln.service import Phase
    from avln.task import Sensors

OK, WARNS, FAILS = "ok", "warning", "failure"
_ASKED = 20
_CLOCK_MAY_DIFFER_S = 2.0
_COUNTING = ("day", "month", "total")


@dataclass(frozen=True)
class Check:
    """What was found out."""

    name: str
    """What was looked at."""
    verdict: str
    """`ok`, `warning`, or `failure`: a run would fail."""
    found: str
    """What was found."""
    next: str = ""
    """What to do about it; empty: nothing."""

    def as_dict(self) -> dict[str, str]:
        """For programs."""
        return asdict(self)

    def __str__(self) -> str:
        return f"{self.verdict:8} {self.name}: {self.found}{f'; {self.next}' if self.next else ''}"


def examine(
    server: str,
    token: str,
    phase: str,
    *,
    link: Link,
    practice: str,
    episodes: int,
    steps: int,
    sensors: Sensors,
) -> Iterator[Check]:
    """Looks at a server before a run, and plays some episodes of `practice` where it counts no runs."""
    try:
        arena = connect(server, token, link)
    except Error as error:
        yield Check("server", FAILS, str(error))
        return
    with arena:
        yield from _server(arena, server)
        yield _token(arena)
        yield _phase(arena, phase)
        yield _quota(arena, phase)
        yield from _practice(arena, practice, episodes, steps, sensors)


def _server(arena: Arena, address: str) -> Iterator[Check]:
    took_s = []
    for _ in range(_ASKED):
        begun_s = time.monotonic()
        info = arena.server_info()
        took_s.append(time.monotonic() - begun_s)
    yield Check("server", OK, f"{info.name or 'LH-AVLN Arena'} answers at {address}")
    versions = f"server {info.version} speaks avln.v1 minor {info.api_minor}, this client {VERSION} minor {API_MINOR}"
    yield Check("versions", OK, versions)
    if info.draining:
        yield Check("state", FAILS, "the server is about to stop", "begin a run when it is back")
    yield Check("round trip", OK, f"{1000 * statistics.median(took_s):.1f} ms, at worst {1000 * max(took_s):.1f} ms")
    ahead_s = info.time_unix_ms / 1000 - time.time()
    found = f"the server's is {abs(ahead_s):.3f} s {'ahead of' if ahead_s > 0 else 'behind'} this machine's"
    differs = abs(ahead_s) > _CLOCK_MAY_DIFFER_S
    advice = "set this machine's clock; runs are not harmed, dates that you compare are" if differs else ""
    yield Check("clock", WARNS if differs else OK, found, advice)


def _token(arena: Arena) -> Check:
    account = arena.whoami()
    expires_s = account.expires_unix_s
    until = "for ever" if expires_s == 0 else f"for {(expires_s - time.time()) / 86400:.1f} days"
    return Check("token", OK, f"of team {account.team!r} ({account.scope}), {until}")


def _phase(arena: Arena, wanted: str) -> Check:
    phases = {phase.id: phase for phase in arena.phases()}
    if wanted not in phases:
        return Check("phase", FAILS, f"there is no phase {wanted!r}", f"choose among {', '.join(phases) or 'none'}")
    phase = phases[wanted]
    found = f"{phase.id}: {phase.episodes} episodes by {phase.rules}, up to {phase.max_slots} slots, {phase.state}"
    return Check("phase", OK if phase.state == "open" else FAILS, found, _reopens(phase))


def _reopens(phase: Phase) -> str:
    return "" if phase.state == "open" else phase.state_reason or "ask the organiser when runs can begin"


def _quota(arena: Arena, phase: str) -> Check:
    limited = [quota for quota in _quotas(arena, phase) if quota.remaining is not None]
    if not limited:
        return Check("quota", OK, "any number of runs")
    least = min(limited, key=lambda quota: quota.remaining or 0)
    found = f"{least.remaining} of {least.limit} runs left ({least.window})"
    return Check(
        "quota", OK if least.remaining else FAILS, found, "" if least.remaining else "wait, or ask for a grant"
    )


def _quotas(arena: Arena, phase: str) -> list[Any]:
    try:
        return list(arena.quota(phase))
    except Error:
        return []


def _practice(arena: Arena, phase: str, episodes: int, steps: int, sensors: Sensors) -> Iterator[Check]:
    if any(quota.limit is not None and quota.window in _COUNTING for quota in _quotas(arena, phase)):
        advice = "name a phase that counts none with --practice"
        yield Check("practice", WARNS, f"nothing was played: {phase} counts runs", advice)
        return
    try:
        run = arena.start_run(phase, "avln-py doctor", _order(arena, phase))
        with arena.play(run, sensors) as play:
            took_s = _played(play, episodes, steps)
    except Error as error:
        yield Check("practice", FAILS, str(error))
        return
    if not took_s:
        yield Check("practice", WARNS, f"{phase} has no episode", "ask the organiser")
        return
    median_s = statistics.median(took_s)
    yield Check("practice", OK, f"{len(took_s)} steps, without a fault")
    yield Check(
        "speed", OK, f"{len(took_s) / sum(took_s):.1f} steps/s in one slot; a step takes {1000 * median_s:.1f} ms"
    )


def _order(arena: Arena, phase: str) -> Order:
    """An order that the phase has."""
    orders = [order for known in arena.phases() if known.id == phase for order in known.orders]
    return Order.UNORDERED if Order.UNORDERED in orders or not orders else orders[0]


def _played(play: Play, episodes: int, steps: int) -> list[float]:
    """Seconds of each step; the run is given up after so many episodes, so that it stands on no board."""
    took_s: list[float] = []
    for episode in play:
        while not episode.is_over and episode.observation.step < steps:
            action = Action.TURN_LEFT if episode.observation.step % 3 == 0 else Action.MOVE_FORWARD
            begun_s = time.monotonic()
            episode.act(action)
            took_s.append(time.monotonic() - begun_s)
        if episode.ordinal >= min(episodes, play.progress.total - 1):
            break
    return took_s
