"""Tests of other addresses: a Unix socket, as in sealed runs, and TLS."""

from __future__ import annotations

import shutil
import socket
import subprocess
import threading
from typing import TYPE_CHECKING

import pytest
from server import PHASE

import avln

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from conftest import Endpoint, Furnished


def pipe(source: socket.socket, sink: socket.socket) -> None:
    """Forwards bytes until the end."""
    try:
        while data := source.recv(1 << 16):
            sink.sendall(data)
    except OSError:
        pass
    finally:
        sink.close()


@pytest.fixture
def unix(endpoint: Endpoint, tmp_path: Path) -> Iterator[str]:
    """A Unix socket that is forwarded to the server's port."""
    path = tmp_path / "arena.sock"
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(path))
        listener.listen()

        def relay() -> None:
            with listener.accept()[0] as agent, socket.create_connection(("127.0.0.1", endpoint.server.grpc)) as server:
                threading.Thread(target=pipe, args=(server, agent), daemon=True).start()
                pipe(agent, server)

        thread = threading.Thread(target=relay, daemon=True)
        thread.start()
        yield f"unix:{path}"
        thread.join(timeout=5)


def test_run_token_plays_over_unix_socket(client: avln.Client, unix: str) -> None:
    run = client.start_run(PHASE, "socket")
    with avln.begin(unix, run.token, "", "", sensors=avln.Sensors.square(64)) as play:
        for episode in play:
            episode.act(avln.Action.STOP)
    assert play.summary is not None
    assert play.summary.complete


SUBJECT = "subjectAltName=DNS:localhost,IP:127.0.0.1\nbasicConstraints=CA:FALSE\n"


@pytest.fixture
def certificate(tmp_path: Path) -> Path:
    """A folder with `ca.pem`, and with `server.pem` and `server.key` signed by it."""
    openssl = shutil.which("openssl")
    if openssl is None:
        pytest.skip("openssl is missing; install it to create certificates")
    (tmp_path / "names").write_text(SUBJECT)
    for command in (
        "req -x509 -newkey rsa:2048 -nodes -keyout ca.key -out ca.pem -days 2 -subj /CN=test",
        "req -newkey rsa:2048 -nodes -keyout server.key -out server.csr -subj /CN=localhost",
        "x509 -req -in server.csr -CA ca.pem -CAkey ca.key -CAcreateserial -out server.pem -days 2 -extfile names",
    ):
        subprocess.run([openssl, *command.split()], cwd=tmp_path, capture_output=True, check=True)
    return tmp_path


def test_tls_server_needs_its_authority(furnished: Furnished, certificate: Path) -> None:
    server = furnished.copy(certificate / "data")
    server.start("--tls-cert", str(certificate / "server.pem"), "--tls-key", str(certificate / "server.key"))
    try:
        url = server.url.replace("http:", "https:")
        with avln.connect(url, furnished.token, avln.ConnectOptions(ca=certificate / "ca.pem")) as client:
            assert client.whoami().team == "Python"
        with pytest.raises(avln.TlsError, match="--ca or AVLN_CA"):
            avln.connect(url, furnished.token)
    finally:
        server.kill()
