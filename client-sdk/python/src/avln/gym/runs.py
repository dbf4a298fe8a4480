"""Consecutive runs of an environment."""

from __future__ import annotations

from typing import TYPE_CHECKING

from avln.client import RUN_TOKEN, begin_run, undone_on_error
from avln.errors import Error, RunOverError
from avln.gym.spaces import ObservationSpace

if TYPE_CHECKING:
    from collections.abc import Sequence

    from avln.action import Order
    from avln.connect_options import ConnectOptions
    from avln.method_type import MethodType
    from avln.play import Play
    from avln.task import Sensors


class Runs:
    """Runs of a method in a phase: unlimited if runs are not counted, otherwise a single run."""

    def __init__(
        self,
        server: str,
        token: str,
        phase: str,
        method: str,
        order: Order,
        *,
        method_type: MethodType | str | None = None,
        sensors: Sensors,
        slots: int = 1,
        connect_options: ConnectOptions | None = None,
    ) -> None:
        self._method, self._method_type, self._order = method, method_type, order
        self._sensors, self._slots = sensors, slots
        self._client, self._run = begin_run(
            server,
            token,
            phase,
            method,
            order,
            method_type=method_type,
            sensors=sensors,
            connect_options=connect_options,
        )
        is_given = token.startswith(RUN_TOKEN)
        with undone_on_error(self._client, self._run, is_own=not is_given):
            self.phase = self._run.phase or phase
            """The phase; empty with a run token and no phase."""
            self.is_counted = is_given or any(quota.is_counted for quota in self._client.quota(self.phase))
            """True if the phase limits the number of runs."""
            self.plays = self._open()
            """The slots of the open run."""
        self.is_fresh = True
        """True if no episode of the open run has started."""

    def lay_out(self, keys: Sequence[str] | None, goal_side: int) -> ObservationSpace:
        """Returns the observation layout of these runs.

        Raises:
            ValueError: if a key is unknown; the run ends.
        """
        try:
            return ObservationSpace(self.plays[0].task, self._sensors, keys, goal_side)
        except ValueError:
            self.close()
            raise

    def begin_episode_of(self, play: Play) -> None:
        """Requests an episode for a slot."""
        play.request_episode()
        self.is_fresh = False

    def begin_anew(self, because: str) -> None:
        """Ends the open run and starts another.

        Raises:
            RunOverError: if runs are counted.
        """
        if self.is_fresh:
            return
        if self.is_counted:
            raise RunOverError(self.plays[0].run, self.phase, f"{because}, and counted runs cannot restart")
        self.plays[0].finish()
        self._run = self._client.start_run(self.phase, self._method, self._order, method_type=self._method_type)
        with undone_on_error(self._client, self._run, is_own=True):
            self.plays = self._open()
        self.is_fresh = True

    def close(self) -> None:
        """Ends the open run and closes the connection."""
        try:
            self.plays[0].finish()
        finally:
            self._client.close()

    def _open(self) -> list[Play]:
        plays = self._client.play_slots(self._run, self._slots, self._sensors)
        if len(plays) < self._slots:
            plays[0].finish()
            raise Error(
                f"play {self._slots} slots in phase {self.phase}: the phase grants {len(plays)}; "
                f"use num_envs={len(plays)}"
            )
        return plays
