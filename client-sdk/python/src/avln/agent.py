"""Agents, and their evaluation on a run."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Callable, Protocol

if TYPE_CHECKING:
    from collections.abc import Sequence

    from avln.action import Action
    from avln.client import Client
    from avln.mission import Mission
    from avln.observation import Observation
    from avln.play import Play
    from avln.service import Run
    from avln.summary import EpisodeEnd, RunSummary
    from avln.task import Sensors, TaskSpec

OnEnd = Callable[["EpisodeEnd"], None]
"""Callback for every ended episode."""


class Agent(Protocol):
    """A policy. An agent plays a single episode at a time."""

    def begin(self, task: TaskSpec, mission: Mission) -> None:
        """Starts an episode and resets the agent's state."""

    def act(self, observation: Observation) -> Action:
        """Returns the action for an observation."""


def evaluate(
    client: Client, run: Run, agent: Agent, sensors: Sensors | None = None, on_end: OnEnd | None = None
) -> RunSummary:
    """Plays a whole run with a single agent and finishes it.

    Raises:
        Error: if the server refuses a request or violates the protocol, or the connection is lost.
    """
    return evaluate_slots(client, run, [agent], sensors, on_end)


def evaluate_slots(
    client: Client,
    run: Run,
    agents: Sequence[Agent],
    sensors: Sensors | None = None,
    on_end: OnEnd | None = None,
) -> RunSummary:
    """Plays a run with an episode per agent in parallel, or fewer if the server grants fewer slots.

    Every agent has a thread; `on_end` is called from a single thread at a time.

    Raises:
        Error: if the server refuses a request or violates the protocol, or the connection is lost.
    """
    plays = client.play_slots(run, len(agents), sensors)
    threads = _SlotThreads(on_end)
    players = [threading.Thread(target=threads.play, args=pair, daemon=True) for pair in zip(plays[1:], agents[1:])]
    for player in players:
        player.start()
    threads.play(plays[0], agents[0])
    for player in players:
        player.join()
    if threads.failed is not None:
        plays[0].close()
        raise threads.failed
    return plays[0].finish()


class _SlotThreads:
    """Threads for a run's slots."""

    def __init__(self, on_end: OnEnd | None) -> None:
        self._on_end = on_end
        self._lock = threading.Lock()
        self.failed: BaseException | None = None
        """The first failed thread's exception."""

    def play(self, play: Play, agent: Agent) -> None:
        """Plays until no episode remains or a thread has failed."""
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
