"""Conformance of this client: broken streams, lost answers, invalid frames, produced by the server program."""

from __future__ import annotations

import socket
import subprocess
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest
from server import WHAT_TO_DO, free_port, program

import avln

if TYPE_CHECKING:
    from collections.abc import Iterator

ADDRESS = ("127.0.0.1", free_port())


@contextmanager
def kit(case: str) -> Iterator[subprocess.Popen[str]]:
    """Runs the test server for clients with a case of `avln lab conformance`."""
    binary = program()
    if binary is None:
        pytest.skip(WHAT_TO_DO)
    command = [str(binary), "lab", "conformance", "--client", f"{ADDRESS[0]}:{ADDRESS[1]}", "--case", case]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        yield process
        process.kill()


def connect() -> avln.Client:
    until = time.monotonic() + 10
    while time.monotonic() < until:
        try:
            socket.create_connection(ADDRESS, timeout=1).close()
        except OSError:
            time.sleep(0.05)
        else:
            break
    return avln.connect(f"http://{ADDRESS[0]}:{ADDRESS[1]}", "any-token")


class Walker:
    """An agent that walks straight ahead."""

    def begin(self, _task: avln.TaskSpec, _mission: avln.Mission) -> None:
        pass

    def act(self, _observation: avln.Observation) -> avln.Action:
        return avln.Action.MOVE_FORWARD


def failure_of_play(slots: int) -> str:
    """Plays a run and returns the reason of the failure; empty without a failure."""
    try:
        with connect() as client:
            run = client.start_run("any", "python")
            avln.evaluate_slots(client, run, [Walker() for _ in range(slots)], avln.Sensors.square(64))
    except avln.Error as error:
        return error.reason or str(error)
    return ""


@pytest.mark.parametrize(
    ("case", "slots", "failure"),
    [("faults", 1, ""), ("faults", 2, ""), ("ended", 1, ""), ("superseded", 1, "SUPERSEDED")],
)
def test_client_conforms_to_protocol(case: str, slots: int, failure: str) -> None:
    with kit(case) as process:
        assert failure_of_play(slots) == failure
        output, _ = process.communicate(timeout=60)
        assert process.returncode == 0, output
