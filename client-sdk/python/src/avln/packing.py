"""Image and sound encoding."""

from __future__ import annotations

import enum
import ipaddress

from avln.v1 import common_pb2 as v1

_LOSSLESS = {
    v1.SENSOR_KIND_RGB: [v1.ENCODING_PACKED, v1.ENCODING_RAW],
    v1.SENSOR_KIND_DEPTH: [v1.ENCODING_PACKED, v1.ENCODING_RAW],
    v1.SENSOR_KIND_AUDIO: [v1.ENCODING_RAW],
}
_ROUNDED = {
    v1.SENSOR_KIND_RGB: [],
    v1.SENSOR_KIND_DEPTH: [v1.ENCODING_DEPTH_U16_MM_PACKED, v1.ENCODING_DEPTH_U16_MM],
    v1.SENSOR_KIND_AUDIO: [v1.ENCODING_AUDIO_I16],
}


class Packing(enum.Enum):
    """Image and sound encoding."""

    RAW = "raw"
    """Raw: fastest on the same machine."""
    LOSSLESS = "lossless"
    """Compressed without loss: fastest across a network."""
    ROUNDED = "rounded"
    """Depth in millimetres and sound in 16 bits if the phase permits it, otherwise LOSSLESS."""

    def wishes(self, kind: v1.SensorKind) -> list[v1.Encoding]:
        """Returns the encodings to request, best first; always with RAW."""
        if self is Packing.RAW:
            return [v1.ENCODING_RAW]
        if self is Packing.LOSSLESS:
            return _LOSSLESS[kind]
        return _ROUNDED[kind] + _LOSSLESS[kind]


def is_this_machine(host: str) -> bool:
    """Returns True if a host name is a loopback address."""
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"
