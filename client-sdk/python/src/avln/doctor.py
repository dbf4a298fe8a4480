"""Checks before a run: server, clock, token, phase, quota, speed."""

from __future__ import annotations

import statistics
import time
from dataclasses import asdict, dataclass, field
from datetime import datetime, timezone
from typing import TYPE_CHECKING

from avln.action import Action, Order
from avln.client import Client, connect, undone_on_error
from avln.errors import Error, PhaseError
from avln.version import API_MINOR, VERSION

if TYPE_CHECKING:
    from collections.abc import Iterator

    from avln.connect_options import ConnectOptions
    from avln.play import Play
    from avln.service import Phase, Quota
    from avln.task import Sensors

OK, WARNS, FAILS = "ok", "warning", "failure"
_ASKED = 20
_CLOCK_MAY_DIFFER_S = 2.0
_DAY_S = 86_400
_SOON_S = 7 * _DAY_S
_WINDOWS = {
    "day": "today (UTC)",
    "month": "this month (UTC)",
    "total": "in all",
    "uncharged": "without charge",
    "concurrent": "at the same time",
}
_LISTED = list(_WINDOWS)
_LASTING = {"concurrent": 0, "day": 1, "month": 2}
"""Windows with free runs after some time, by that time; the others need the organiser."""


@dataclass(frozen=True)
class Check:
    """A check and the result."""

    name: str
    """Name of the check."""
    verdict: str
    """`ok`, `warning`, or `failure`: a run would fail."""
    found: str
    """Finding."""
    next: str = ""
    """Next step; may be empty."""

    def as_dict(self) -> dict[str, str]:
        """Returns the fields by name."""
        return asdict(self)

    def __str__(self) -> str:
        return f"{self.verdict:8} {self.name}: {self.found}{f'; {self.next}' if self.next else ''}"


@dataclass(frozen=True)
class Tries:
    """Practice run settings."""

    episodes: int
    steps: int
    sensors: Sensors


@dataclass
class Played:
    """Practice run measurements."""

    max_steps: int
    begins_s: list[float] = field(default_factory=list)
    steps_s: list[float] = field(default_factory=list)


def examine(
    server: str,
    token: str,
    phase: str,
    *,
    connect_options: ConnectOptions,
    practice: str | None,
    episodes: int,
    steps: int,
    sensors: Sensors,
) -> Iterator[Check]:
    """Checks a server before a run, and plays episodes of the phase `practice` if it counts no runs.

    An empty `phase` is `Client.practice_phase`; the default for `practice` is `phase`.
    """
    try:
        client = connect(server, token, connect_options)
    except Error as error:
        yield Check("server", FAILS, str(error))
        return
    with client:
        yield from _server(client, server)
        yield _token(client)
        try:
            phase = phase or client.practice_phase()
        except PhaseError as error:
            yield Check("phase", FAILS, str(error))
            return
        yield _phase(client, phase)
        yield _quota(client, phase)
        yield from _practice(client, phase, practice or phase, Tries(episodes, steps, sensors))


def _server(client: Client, address: str) -> Iterator[Check]:
    took_s = []
    for _ in range(_ASKED):
        begun_s = time.monotonic()
        info = client.server_info()
        took_s.append(time.monotonic() - begun_s)
    yield Check("server", OK, f"{info.name or 'LH-AVLN Arena'} answers at {address}")
    own = f"this client {VERSION} with minor {API_MINOR}"
    yield Check("versions", OK, f"server {info.version} with avln.v1 minor {info.api_minor}, {own}")
    if info.draining:
        yield Check("state", FAILS, "the server is shutting down and begins no runs", "wait until the server is back")
    trip_ms = [1000 * trip_s for trip_s in took_s]
    yield Check("round trip", OK, f"{statistics.median(trip_ms):.1f} ms, maximum {max(trip_ms):.1f} ms")
    ahead_s = info.time_unix_ms / 1000 - time.time()
    found = f"the server's clock is {abs(ahead_s):.3f} s {'ahead of' if ahead_s > 0 else 'behind'} this machine's"
    differs = abs(ahead_s) > _CLOCK_MAY_DIFFER_S
    advice = "set this machine's clock; phases and tokens expire by the server's clock" if differs else ""
    yield Check("clock", WARNS if differs else OK, found, advice)


def _token(client: Client) -> Check:
    account = client.whoami()
    whose = f"of team {account.team!r} ({account.scope})"
    if account.expires_unix_s == 0:
        return Check("token", OK, f"{whose}, without expiry")
    left_s = account.expires_unix_s - time.time()
    if left_s > _SOON_S:
        return Check("token", OK, f"{whose}, valid for {left_s / _DAY_S:.0f} days")
    found = f"{whose}, valid for {left_s / 3600:.0f} hours"
    return Check("token", WARNS, found, "ask the organiser for a new token in time")


def _phase(client: Client, wanted: str) -> Check:
    phases = {phase.id: phase for phase in client.phases()}
    if wanted not in phases:
        return Check("phase", FAILS, f"there is no phase {wanted!r}", f"choose one of: {', '.join(phases) or 'none'}")
    phase = phases[wanted]
    found = f"{phase.id}: {phase.episodes} episodes by {phase.rules}, up to {phase.max_slots} slots, {phase.state}"
    return Check("phase", OK if phase.state == "open" else FAILS, found, _reopens(phase))


def _reopens(phase: Phase) -> str:
    return "" if phase.state == "open" else phase.state_reason or "runs start only in open phases"


def _quota(client: Client, phase: str) -> Check:
    return quota_check(_quotas(client, phase))


def quota_check(quotas: list[Quota]) -> Check:
    """Checks that every limited window has a run left."""
    known = sorted(quotas, key=lambda quota: _LISTED.index(quota.window) if quota.window in _LISTED else len(_LISTED))
    limited = [quota for quota in known if quota.limit is not None]
    if not limited:
        return Check("quota", OK, "unlimited runs")
    left = (f"{quota.remaining or 0} of {quota.limit} {_WINDOWS.get(quota.window, quota.window)}" for quota in limited)
    found = f"runs left: {', '.join(left)}"
    used_up = [quota for quota in limited if quota.remaining == 0]
    if not used_up:
        return Check("quota", OK, found)
    # Waiting does not help against the longest window, so its advice comes first.
    longest = max(used_up, key=lambda quota: _LASTING.get(quota.window, len(_LASTING)))
    return Check("quota", FAILS, found, _advice(longest))


def _advice(quota: Quota) -> str:
    if quota.window == "concurrent":
        return "finish or cancel the open run"
    if quota.window in _LASTING and quota.next_increase_unix_s:
        moment = datetime.fromtimestamp(quota.next_increase_unix_s, timezone.utc)
        return f"wait until {moment.strftime('%Y-%m-%dT%H:%M:%SZ')}"
    return "ask the organiser for more runs"


def _quotas(client: Client, phase: str) -> list[Quota]:
    try:
        return client.quota(phase)
    except Error:
        return []


def _practice(client: Client, wanted: str, place: str, tries: Tries) -> Iterator[Check]:
    if any(quota.is_counted for quota in _quotas(client, place)):
        advice = "name a phase without quotas with --practice PHASE"
        yield Check("practice", WARNS, f"no practice in phase {place!r}, which counts runs", advice)
        return
    phases = {phase.id: phase for phase in client.phases()}
    if place in phases and phases[place].episodes < 2:
        found = f"no practice in phase {place!r}, whose only episode would complete a run"
        yield Check("practice", WARNS, found, "name another phase with --practice PHASE")
        return
    try:
        played = _play(client, place, _order(phases.get(place)), tries)
    except Error as error:
        yield Check("practice", FAILS, str(error))
        return
    yield from _measured(played, phases.get(wanted))


def _order(phase: Phase | None) -> Order:
    """Returns an order available in the phase."""
    orders = phase.orders if phase else []
    return Order.UNORDERED if Order.UNORDERED in orders or not orders else orders[0]


def _play(client: Client, phase: str, order: Order, tries: Tries) -> Played:
    """Plays some episodes and always cancels the run, so that it counts on no leaderboard and in no quota."""
    run = client.start_run(phase, "avln-py doctor", order)
    with undone_on_error(client, run, is_own=True), client.play(run, tries.sensors) as play:
        played = _played(play, tries)
    client.cancel_run(run.id)
    return played


def _played(play: Play, tries: Tries) -> Played:
    played = Played(play.task.max_steps)
    # The last episode is never played: a complete run would appear on leaderboards.
    few = min(tries.episodes, play.progress.total - 1)
    before_s = time.monotonic()
    for episode in play:
        played.begins_s.append(time.monotonic() - before_s)
        while not episode.is_over and episode.observation.step < tries.steps:
            action = Action.TURN_LEFT if episode.observation.step % 3 == 0 else Action.MOVE_FORWARD
            begun_s = time.monotonic()
            episode.act(action)
            played.steps_s.append(time.monotonic() - begun_s)
        if len(played.begins_s) >= few:
            break
        if not episode.is_over:
            episode.abandon()
        before_s = time.monotonic()
    return played


def _measured(played: Played, phase: Phase | None) -> Iterator[Check]:
    if not played.steps_s:
        yield Check("practice", WARNS, "the server assigned no episode", "name another phase with --practice PHASE")
        return
    per_s = len(played.steps_s) / sum(played.steps_s)
    step_ms = 1000 * statistics.median(played.steps_s)
    yield Check("practice", OK, f"{len(played.steps_s)} steps, no errors")
    yield Check("speed", OK, f"{per_s:.1f} steps/s in one slot; median step {step_ms:.1f} ms")
    if phase is None:
        return
    longest_s = phase.episodes * (statistics.median(played.begins_s) + played.max_steps / per_s)
    slots = max(phase.max_slots, 1)
    found = f"at most {_span(longest_s)} with one slot, {_span(longest_s / slots)} at best with {slots}"
    yield Check("run time", OK, f"{found}, plus the agent's own time")


def _span(seconds: float) -> str:
    """Formats a duration in seconds, minutes or hours."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
