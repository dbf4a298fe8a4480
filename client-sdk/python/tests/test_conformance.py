"""Conformance of this client: broken streams, lost answers, invalid frames, produced by the server program."""

from __future__ import annotations

import socket
import subprocess
import time
from typing import TYPE_CHECKING

import pytest
from server import WHAT_TO_DO, free_port, program

import avln

if TYPE_CHECKING:
    from collections.abc import Iterator

ADDRESS = ("127.0.0.1", free_port())


@pytest.fixture
def host() -> Iterator[subprocess.Popen[str]]:
    binary = program()
    if binary is None:
        pytest.skip(WHAT_TO_DO)
    command = [str(binary), "lab", "conformance", "--client", f"{ADDRESS[0]}:{ADDRESS[1]}"]
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


def test_client_conforms_to_protocol(host: subprocess.Popen[str]) -> None:
    with connect() as client, client.play(client.start_run("any", "python"), avln.Sensors.square(64)) as run:
        for episode in run:
            while not episode.is_over:
                episode.act(avln.Action.MOVE_FORWARD)
    output, _ = host.communicate(timeout=60)
    assert host.returncode == 0, output
