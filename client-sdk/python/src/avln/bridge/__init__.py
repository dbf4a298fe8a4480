"""A door for clients that speak the protocol of the LH-AVLN authors' release; `pip install 'avln[bridge]'`.

avln-bridge zmq --bind tcp://127.0.0.1:5555 --server URL --token TOKEN --phase PHASE
"""

from avln.bridge.desk import Desk
from avln.bridge.frames import pack, unpack

__all__ = ["Desk", "main", "pack", "unpack"]


def main() -> int:
    """The program `avln-bridge`; gives back its exit code."""
    from avln.bridge.program import main as program  # noqa: PLC0415, so that the rest needs no ZeroMQ

    return program()
