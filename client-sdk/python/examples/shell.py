"""Command line of the examples."""

from __future__ import annotations

from typing import Any, Callable

import avln
from avln.options import add_connection, add_run, begin_from, parser


def main(agent: Callable[[], Any]) -> None:
    """Plays a run with an agent and prints the summary; `agent.sensors` selects the sensors."""
    name = agent.__name__.lower()
    program = parser(name, agent.__doc__ or "")
    add_connection(program)
    add_run(program, method=f"example-{name}", method_type=avln.MethodType.TRAINING_FREE)
    options = program.parse_args()
    client, run = begin_from(options)
    with client:
        player = agent()
        print(avln.evaluate(client, run, player, player.sensors, on_end=lambda end: print(end.reason.value, end.steps)))
