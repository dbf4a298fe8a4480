"""Agents that need no loop of their own."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Callable, Protocol

if TYPE_CHECKING:
    from collections.abc import Sequence

    from avln.action import Action
    from avln.arena import Arena
    from avln.mission import Mission
    from avln.observation import Observation
    from avln.play import Play
    from avln.service import Run
    from avln.summary import EpisodeEnd, RunSummary
    from avln.task import Sensors, TaskSpec

OnEnd = Callable[["EpisodeEnd"], None]
"""Told about every episode that ended."""


class Agent(Protocol):
    """Something that plays. One agent plays one episode at a time."""

    def begin(self, task: TaskSpec, mission: Mission) -> None:
        """An episode begins: forget the last one."""

    def act(self, observation: Observation) -> Action:
        """What to do, seeing this."""


def evaluate(
    arena: Arena, run: Run, agent: Agent, sensors: Sensors | None = None, on_end: OnEnd | None = None
) -> RunSummary:
    """Plays a run to its end with one agent and says Goodbye.

    Raises:
        Error: when the server refuses something, breaks the protocol or the connection is lost.
    """
    return evaluate_slots(arena, run, [agent], sensors, on_end)


def evaluate_slots(
    arena: Arena,
    run: Run,
    agents: Sequence[Agent],
    sensors: Sensors | None = None,
    on_end: OnEnd | None = None,
) -> RunSummary:
    """Plays a run with as many episodes at the same time as there are agents, or fewer where fewer slots are granted.

    Each agent has a thread of its own; `on_end` is called from one thread at a time.

    Raises:
        Error: when the server refuses something, breaks the protocol or the connection is lost.
    """
    plays = arena.play_slots(run, len(agents), sensors)
    crew = _Crew(on_end)
    players = [threading.Thread(target=crew.play, args=pair, daemon=True) for pair in zip(plays[1:], agents[1:])]
    for player in players:
        player.start()
    crew.play(plays[0], agents[0])
    for player in players:
        player.join()
    if crew.failed is not None:
        plays[0].close()
        raise crew.failed
    return plays[0].finish()


class _Crew:
    """The threads that play the slots of one run."""

    def __init__(self, on_end: OnEnd | None) -> None:
        self._on_end = on_end
        self._lock = threading.Lock()
        self.failed: BaseException | None = None
        """What the first that failed raised."""

    def play(self, play: Play, agent: Agent) -> None:
        """Plays until no episode is left, or until one of the crew has failed."""
        try:
            self._play(play, agent)
        except BaseException as error:
            self.failed = self.failed or error
            play.close()

    def _play(self, play: Play, agent: Agent) -> None:
        for episode in play:
            agent.begin(play.task, episode.mission)
            for observation in episode:
                episode.act(agent.act(observation))
            with self._lock:
                if self._on_end is not None and episode.end is not None:
                    self._on_end(episode.end)
