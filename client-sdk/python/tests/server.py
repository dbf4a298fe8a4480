"""The server program with a private data folder."""

from __future__ import annotations

import contextlib
import os
import random
import re
import socket
import subprocess
import time
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[3]
WHAT_TO_DO = "the server program is missing; build it with `cargo build --release`, or set AVLN_BIN to its path"
PHASE = "practice"
CHALLENGE = "challenge"


def program() -> Path | None:
    """Returns the path of the server program: AVLN_BIN, otherwise this repository's build."""
    if "AVLN_BIN" in os.environ:
        return Path(os.environ["AVLN_BIN"])
    built = (REPOSITORY / "target" / profile / "avln" for profile in ("release", "debug"))
    return next((path for path in built if path.is_file()), None)


def free_port() -> int:
    """Returns a free port below the ephemeral range, so that no outgoing connection uses it first."""
    for port in random.sample(range(10_000, 32_000), 100):
        with contextlib.suppress(OSError), socket.socket() as probe:
            probe.bind(("127.0.0.1", port))
            return port
    raise AssertionError("none of 100 ports is free")


class Server:
    """The server program on a data folder, with a public and a hidden phase."""

    def __init__(self, binary: Path, folder: Path) -> None:
        self.binary, self.folder = binary, folder
        self.grpc, self.web = free_port(), free_port()
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.grpc}"

    def furnish(self, *, houses: int = 1, missions: int = 3) -> str:
        """Creates scenes and missions, opens the phases and returns a team token."""
        size = ("--houses", str(houses), "--missions", str(missions))
        self.command("data", "split", "make", "trial", *size, "--seed", "5")
        self.command("data", "split", "make", "hidden", *size)
        self.command("data", "split", "prepare", "trial")
        self.command("challenge", "phase", "open", PHASE, "--split", "trial", "--max-slots", "4")
        limits = ("--quota", "50", "--concurrent", "50")
        self.command("challenge", "phase", "open", CHALLENGE, "--split", "hidden", "--scores", "organiser", *limits)
        answer = self.command("challenge", "team", "add", "Python")
        found = re.search(r"avln_\S+", answer)
        assert found, answer
        return found.group()

    def command(self, *arguments: str) -> str:
        """Runs a command of the program and returns the output."""
        command = [str(self.binary), "--data", str(self.folder), *arguments]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=280)
        assert done.returncode == 0, f"{command}: {done.stderr}"
        return done.stdout

    def start(self, *more: str) -> None:
        """Starts the server and waits until it serves: its ports accept connections earlier."""
        ports = ["--grpc", f"127.0.0.1:{self.grpc}", "--web", f"127.0.0.1:{self.web}", "--admin", "off"]
        said = self.folder / "server.out"
        with (self.folder / "server.log").open("ab") as log, said.open("wb") as out:
            command = [str(self.binary), "--data", str(self.folder), "serve", *ports, *more]
            self._process = subprocess.Popen(command, stdout=out, stderr=log)
        until = time.monotonic() + 30
        while time.monotonic() < until:
            if "Stop with Ctrl-C." in said.read_text():
                return
            time.sleep(0.05)
        log_text = (self.folder / "server.log").read_text(errors="replace")
        raise AssertionError(f"the server does not answer within 30 s ({self._process.poll()}); its log:\n{log_text}")

    def kill(self) -> None:
        """Kills the server with SIGKILL, as in a crash."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None
