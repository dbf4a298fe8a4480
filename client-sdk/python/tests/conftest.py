"""What the tests share: one server for all that do not kill it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from server import WHAT_TO_DO, Server, program

import avln

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@pytest.fixture(scope="session")
def binary() -> Path:
    found = program()
    if found is None:
        pytest.skip(WHAT_TO_DO)
    return found


class Door:
    """A running server and a team's token."""

    def __init__(self, server: Server, token: str) -> None:
        self.server, self.url, self.token = server, server.url, token

    def connect(self) -> avln.Arena:
        return avln.connect(self.url, self.token)


@pytest.fixture(scope="session")
def door(binary: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Door]:
    server = Server(binary, tmp_path_factory.mktemp("data"))
    token = server.furnish()
    server.start()
    yield Door(server, token)
    server.kill()


@pytest.fixture
def arena(door: Door) -> Iterator[avln.Arena]:
    with door.connect() as arena:
        yield arena
