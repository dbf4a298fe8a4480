"""Command line options shared by this package's programs."""

from __future__ import annotations

import argparse
import os
from typing import TYPE_CHECKING

from avln.action import Order
from avln.client import Client, begin_run
from avln.connect_options import ConnectOptions
from avln.method_type import MethodType
from avln.packing import Packing
from avln.task import Sensors
from avln.version import VERSION

if TYPE_CHECKING:
    from avln.service import Run

PRACTICE = "[the practice phase, which does not limit runs]"
"""Default for `--phase` in help texts."""


def parser(name: str, about: str) -> argparse.ArgumentParser:
    """Creates a program's argument parser."""
    program = argparse.ArgumentParser(prog=name, description=about)
    program.add_argument("--version", action="version", version=f"{name} {VERSION}")
    return program


def add_connection(to: argparse.ArgumentParser, *, needs_token: bool = True) -> None:
    """Adds the options for server and token."""
    server = os.environ.get("AVLN_SERVER", "http://127.0.0.1:50051")
    to.add_argument("--server", default=server, help="server URL: http://, https:// or unix:/path [AVLN_SERVER]")
    token = os.environ.get("AVLN_TOKEN", "")
    required = needs_token and not token
    to.add_argument("--token", default=token, required=required, help="account token [AVLN_TOKEN]")
    ca = os.environ.get("AVLN_CA")
    to.add_argument("--ca", default=ca, help="PEM file with certificate authorities for https [AVLN_CA]")
    packings = [packing.value for packing in Packing]
    usual = "[raw on this machine, otherwise lossless]"
    to.add_argument("--packing", choices=packings, help=f"encoding of images and sound {usual}")


def add_run(to: argparse.ArgumentParser, *, method: str, method_type: MethodType | None = None) -> None:
    """Adds the options for the run."""
    to.add_argument("--phase", default="", help=f"phase to play in {PRACTICE}")
    to.add_argument("--order", type=Order, default=Order.UNORDERED, help="goal order: ordered or unordered [unordered]")
    to.add_argument("--method", default=method, help=f"method name on the leaderboard [{method}]")
    types = [known.value for known in MethodType]
    usual = method_type.value if method_type else None
    about = f"method type on the leaderboard [{usual or 'none'}]"
    to.add_argument("--method-type", choices=types, default=usual, help=about)


def add_camera(to: argparse.ArgumentParser, *, size: int) -> None:
    """Adds the options for the camera."""
    to.set_defaults(usual_size=size)
    to.add_argument("--size", type=int, help=f"image side in pixels, 64 to 1024 [{size}]")


def connect_options(options: argparse.Namespace) -> ConnectOptions:
    """Returns the connection options."""
    return ConnectOptions(ca=options.ca, packing=Packing(options.packing) if options.packing else None)


def sensors(options: argparse.Namespace) -> Sensors:
    """Returns all sensors with the requested image size."""
    return Sensors.square(options.usual_size if options.size is None else options.size)


def begin_from(options: argparse.Namespace, sensors: Sensors | None = None) -> tuple[Client, Run]:
    """Connects and begins a run with the options of `add_connection` and `add_run`.

    Raises:
        Error: as for `begin_run`.
    """
    return begin_run(
        options.server,
        options.token,
        options.phase,
        options.method,
        options.order,
        method_type=options.method_type,
        sensors=sensors,
        connect_options=connect_options(options),
    )
