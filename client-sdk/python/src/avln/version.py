"""Client version."""

from __future__ import annotations

from avln.v1 import common_pb2

VERSION = "0.1.0"
"""Version of this package."""
API_MINOR = 0
"""Highest minor number of `avln.v1` that it speaks."""


def client_info() -> common_pb2.ClientInfo:
    """Client information for the server."""
    return common_pb2.ClientInfo(name="avln-python", version=VERSION, api_minor=API_MINOR)
