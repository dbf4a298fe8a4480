"""Connection settings: address, TLS, channel options."""

from __future__ import annotations

import ssl
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import grpc

from avln.errors import AddressError, Error, TlsError, UnreachableError
from avln.packing import Packing, is_this_machine
from avln.version import VERSION

MAX_MESSAGE_BYTES = 16 << 20
"""Maximum message size in both directions."""
CONNECT_TIMEOUT_S = 10.0
_KEEP_ALIVE_MS = 30_000
_KEEP_ALIVE_TIMEOUT_MS = 20_000
_STREAM_WINDOW_BYTES = 2 << 20
_FRAME_BYTES = 256 << 10
_RECONNECT_MS = (100, 5_000)
_UNIX = "unix:"
_BEGIN = b"-----BEGIN CERTIFICATE-----"


@dataclass(frozen=True)
class ConnectOptions:
    """Connection options."""

    ca: str | Path | None = None
    """PEM file with certificate authorities for `https://` servers; None for the system's."""
    packing: Packing | None = None
    """Image and sound encoding; None: raw on this machine, lossless otherwise."""
    patience_s: float | None = None
    """Reconnection time after a loss, seconds; None: as permitted by the server, at least three
    minutes.
    """


@dataclass(frozen=True)
class Address:
    """A parsed server address."""

    text: str
    target: str
    """gRPC target: `host:port` or `unix:/path`."""
    is_secure: bool
    is_local: bool


def parse_address(text: str) -> Address:
    """Parses `http://host:port`, `https://host:port` or `unix:/path`.

    Raises:
        AddressError: if the address is invalid.
    """
    if text.startswith(_UNIX):
        if not text[len(_UNIX) :].startswith("/"):
            raise AddressError(text, "the socket path is not absolute")
        return Address(text, text, is_secure=False, is_local=True)
    scheme, separator, _ = text.partition("://")
    if not separator:
        raise AddressError(text, "the scheme is missing")
    if scheme not in ("http", "https"):
        raise AddressError(text, f"unknown scheme '{scheme}'")
    return _host_address(text, is_secure=scheme == "https")


def _host_address(text: str, *, is_secure: bool) -> Address:
    try:
        parts = urlsplit(text)
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise AddressError(text, str(error)) from None
    if not host or " " in text:
        raise AddressError(text, "the host is missing or contains a space")
    host = f"[{host}]" if ":" in host else host
    default = 443 if is_secure else 80
    return Address(text, f"{host}:{port or default}", is_secure, is_this_machine(host))


def open_channel(address: Address, connect_options: ConnectOptions) -> grpc.Channel:
    """Creates a channel that connects at the first call.

    Raises:
        TlsError: if the authority file is invalid.
    """
    options = _options(address)
    if address.is_secure:
        credentials = grpc.ssl_channel_credentials(root_certificates=_authorities(address, connect_options))
        channel = grpc.secure_channel(address.target, credentials, options=options)
    else:
        channel = grpc.insecure_channel(address.target, options=options)
    return channel


def unreachable(address: str, detail: str) -> Error:
    """Returns the error for a failed connection, with a next step for known causes."""
    for word, advice in _ADVICE.items():
        if word in detail:
            return TlsError(address, f"{advice} ({detail})")
    return UnreachableError(address, detail)


_ADVICE = {
    "WRONG_VERSION_NUMBER": "the server does not use TLS; use http:// in the address",
    "CERTIFICATE_VERIFY_FAILED": "unknown certificate authority, or a certificate for another name; "
    "use the authority's PEM file with --ca or AVLN_CA, and the certificate's name in the address",
}


def _options(address: Address) -> list[tuple[str, Any]]:
    # gRPC derives the authority from the socket path, which is invalid in HTTP/2; servers reject it.
    named = [("grpc.default_authority", "localhost")] if address.target.startswith(_UNIX) else []
    return [
        *named,
        ("grpc.max_receive_message_length", MAX_MESSAGE_BYTES),
        ("grpc.max_send_message_length", MAX_MESSAGE_BYTES),
        ("grpc.http2.lookahead_bytes", _STREAM_WINDOW_BYTES),
        ("grpc.http2.max_frame_size", _FRAME_BYTES),
        ("grpc.keepalive_time_ms", _KEEP_ALIVE_MS),
        ("grpc.keepalive_timeout_ms", _KEEP_ALIVE_TIMEOUT_MS),
        ("grpc.initial_reconnect_backoff_ms", _RECONNECT_MS[0]),
        ("grpc.min_reconnect_backoff_ms", _RECONNECT_MS[0]),
        ("grpc.max_reconnect_backoff_ms", _RECONNECT_MS[1]),
        ("grpc.use_local_subchannel_pool", 1),
        ("grpc.enable_http_proxy", 0 if address.is_local else 1),
        ("grpc.primary_user_agent", f"avln-python/{VERSION}"),
    ]


def _authorities(address: Address, connect_options: ConnectOptions) -> bytes | None:
    """Returns the certificate authorities in PEM; None for gRPC's own if the system has none."""
    if connect_options.ca is None:
        system = ssl.get_default_verify_paths().cafile
        return Path(system).read_bytes() if system and Path(system).is_file() else None
    try:
        pem = Path(connect_options.ca).read_bytes()
    except OSError as error:
        problem = f"cannot read the certificate authorities in {connect_options.ca}: {error.strerror}"
        raise TlsError(address.text, f"{problem}; use a PEM file with --ca or AVLN_CA") from None
    if _BEGIN not in pem:
        problem = f"{connect_options.ca} contains no certificate"
        raise TlsError(address.text, f"{problem}; use a PEM file with --ca or AVLN_CA")
    return pem
