"""Shared fixtures: a data folder with phases, and a server for tests that do not kill it."""

from __future__ import annotations

import os
import shutil
import signal
from typing import TYPE_CHECKING

import pytest
from server import WHAT_TO_DO, Server, program

import avln

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


def pytest_configure() -> None:
    """Makes Ctrl-C an exception, also in jobs in the background, which ignore it."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fails the session after a skipped test if AVLN_SKIP is `never`."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if os.environ.get("AVLN_SKIP") == "never" and reporter is not None and reporter.stats.get("skipped"):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


class Endpoint:
    """A running server and a team's token."""

    def __init__(self, server: Server, token: str) -> None:
        self.server, self.url, self.token = server, server.url, token

    def connect(self) -> avln.Client:
        return avln.connect(self.url, self.token)


class Furnished:
    """A data folder with phases and a team token, without a running server."""

    def __init__(self, binary: Path, folder: Path) -> None:
        self.binary, self.folder = binary, folder
        self.token = Server(binary, folder).furnish()

    def copy(self, to: Path) -> Server:
        """Returns a stopped server on a copy of the folder."""
        shutil.copytree(self.folder, to)
        return Server(self.binary, to)


@pytest.fixture(scope="session")
def furnished(tmp_path_factory: pytest.TempPathFactory) -> Furnished:
    binary = program()
    if binary is None:
        pytest.skip(WHAT_TO_DO)
    return Furnished(binary, tmp_path_factory.mktemp("furnished"))


@pytest.fixture(scope="session")
def endpoint(furnished: Furnished, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Endpoint]:
    server = furnished.copy(tmp_path_factory.mktemp("hosted") / "data")
    server.start()
    yield Endpoint(server, furnished.token)
    server.kill()


@pytest.fixture
def client(endpoint: Endpoint) -> Iterator[avln.Client]:
    with endpoint.connect() as client:
        yield client


@pytest.fixture(scope="session")
def native_module() -> None:
    """Skips a test without the native module of `avln.sim`."""
    pytest.importorskip("gymnasium", reason="pip install gymnasium")
    import avln.sim.options  # noqa: PLC0415, needs Gymnasium

    try:
        avln.sim.options.native()
    except ModuleNotFoundError as error:
        if "AVLN_NATIVE" in os.environ:
            raise
        pytest.skip(str(error))
