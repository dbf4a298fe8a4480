"""Client version."""

from __future__ import annotations

from avln.v1 import common_pb2

VERSION = "0.2.0"
"""Package version."""
API_MINOR = 0
"""Highest supported minor number in `avln.v1`."""


def client_info() -> common_pb2.ClientInfo:
    """Returns the client information for the server."""
    return common_pb2.ClientInfo(name="avln-python", version=VERSION, api_minor=API_MINOR)
