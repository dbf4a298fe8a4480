"""Errors between agent and server. Every message contains the attempted operation and the next step."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import grpc

from avln.v1 import common_pb2
from avln.version import VERSION

if TYPE_CHECKING:
    from avln.v1 import play_pb2

REASON_KEY = "avln-reason"
RETRY_AFTER_KEY = "avln-retry-after-s"
_LOST_CODES = {
    grpc.StatusCode.UNAVAILABLE,
    grpc.StatusCode.CANCELLED,
    grpc.StatusCode.UNKNOWN,
    grpc.StatusCode.DEADLINE_EXCEEDED,
}
_RESET = "RST_STREAM"
"""gRPC message of a stream reset by a proxy after its server stopped."""
_PASSING = {"DRAINING", "NO_CAPACITY", "RATE_LIMIT"}
_NEW_TOKEN = {"TOKEN_EXPIRED", "TOKEN_REVOKED"}


class Error(Exception):
    """Base class of this package's errors."""

    reason: str = ""
    """Reason from the closed list of PROTOCOL.md, such as `QUOTA_DAY`; may be empty."""
    retry_after_s: int | None = None
    """The server's requested delay before a retry, seconds; None: not given."""


class AddressError(Error):
    """Invalid server address."""

    def __init__(self, address: str, problem: str) -> None:
        super().__init__(f"server address '{address}': {problem}; write it like http://127.0.0.1:50051")


class UnreachableError(Error):
    """No answer at the server address."""

    def __init__(self, address: str, detail: str) -> None:
        super().__init__(
            f"cannot reach {address}: {detail}; is the server running there, is this its gRPC port, and does it use "
            "TLS (https://) or not (http://)? Set the address with --server or AVLN_SERVER"
        )


class TlsError(Error):
    """No secure connection to the server."""

    def __init__(self, address: str, problem: str) -> None:
        super().__init__(f"{address}: {problem}")


class NotArenaError(Error):
    """No Arena server at the address."""

    def __init__(self, address: str, detail: str) -> None:
        super().__init__(
            f"{address} is not an LH-AVLN Arena gRPC server ({detail}); "
            "use the gRPC port instead of the web port, and https:// for a server with TLS"
        )


class LostError(Error):
    """The connection is lost: stored results remain, open episodes end as disconnected."""

    def __init__(self, attempted: str, detail: str) -> None:
        super().__init__(
            f"{attempted}: the connection to the server was lost ({detail}); stored episodes are safe; "
            "play the run again for the others"
        )


class ProtocolError(Error):
    """The server violated `avln.v1`."""

    def __init__(self, detail: str) -> None:
        super().__init__(
            f"the server violated the protocol: {detail}; client {VERSION} may be incompatible with the server; "
            "compare the versions with avln-py doctor"
        )


class SensorsError(Error, ValueError):
    """The requested sensors are out of range for any server."""

    def __init__(self, width: int, height: int, hfov_rad: float) -> None:
        super().__init__(
            f"invalid camera of {width} x {height} pixels with hfov {hfov_rad} rad; "
            "use 64 to 1024 pixels and 0.35 to 2.4 rad"
        )


class PhaseError(Error):
    """No phase was given, and there is no or no unique default phase."""

    def __init__(self, free: list[str], known: list[str]) -> None:
        if free:
            found = f"several phases have no quota: {', '.join(free)}"
        elif known:
            found = f"no open phase is without a quota; known phases: {', '.join(known)}"
        else:
            found = "the server has no phase for your team"
        super().__init__(f"start a run without naming a phase: {found}; choose a phase with phase= or --phase")


class EpisodeOverError(Error):
    """A step after the end of the episode."""

    def __init__(self) -> None:
        super().__init__("the episode is over; call Play.next_episode for the next")


class RunOverError(Error):
    """A request for an episode in a run without remaining episodes."""

    def __init__(self, run: str, phase: str, because: str = "no episode remains") -> None:
        where = f" in phase {phase}" if phase else ""
        super().__init__(f"begin an episode of run {run}{where}: {because}; start another run")


class RefusedError(Error):
    """The server refused a request; see `reason`."""

    def __init__(self, attempted: str, reason: str, message: str, retry_after_s: int | None = None) -> None:
        hint = "" if retry_after_s is None else f"; try again in {retry_after_s} s"
        super().__init__(f"{attempted}: refused ({reason or 'UNSPECIFIED'}): {message}{hint}")
        self.reason = reason
        self.retry_after_s = retry_after_s


class TokenError(Error):
    """The server refused the token; see `reason`."""

    def __init__(self, attempted: str, reason: str, message: str) -> None:
        super().__init__(f"{attempted}: the server refused the token ({reason}): {message}{_token_hint(reason)}")
        self.reason = reason


class UnknownActionError(Error, ValueError):
    """An invalid action."""

    def __init__(self, choice: object, known: str) -> None:
        super().__init__(f"take a step: invalid action {choice!r}; use {known}")


def _token_hint(reason: str) -> str:
    if reason in _NEW_TOKEN:
        return "; ask the organiser for a new one and use it with --token or AVLN_TOKEN"
    if reason == "TOKEN_SCOPE":
        return "; account tokens start runs, run tokens play them"
    return "; use the account's token with --token or AVLN_TOKEN"


def is_passing(error: Error) -> bool:
    """Returns True for temporary errors: a lost connection, or a restarting server."""
    return isinstance(error, (LostError, UnreachableError)) or error.reason in _PASSING


def reason_word(number: int) -> str:
    """Returns the name of a `common_pb2.Reason` without prefix; empty for unknown reasons."""
    if number == common_pb2.REASON_UNSPECIFIED or number not in common_pb2.Reason.values():
        return ""
    return str(common_pb2.Reason.Name(cast("common_pb2.Reason", number))).replace("REASON_", "", 1)


def from_call(attempted: str, error: grpc.RpcError) -> Error:
    """Returns the error for a gRPC call that failed during `attempted`."""
    call = cast("grpc.Call", error)
    code, message = call.code(), call.details() or ""
    trailers = {key: value for key, value in call.trailing_metadata() or () if isinstance(value, str)}
    reason = trailers.get(REASON_KEY, "")
    retry = trailers.get(RETRY_AFTER_KEY, "")
    is_lost = code in _LOST_CODES or (code is grpc.StatusCode.INTERNAL and _RESET in message)
    if not reason and is_lost:
        return LostError(attempted, f"{code.name}: {message}")
    return _refused(attempted, code.name, reason, message, int(retry) if retry.isdigit() else None)


def from_fault(attempted: str, fault: play_pb2.Fault) -> Error:
    """Returns the error for a fault on a stream during `attempted`."""
    code = next((code.name for code in grpc.StatusCode if code.value[0] == fault.code), "UNKNOWN")
    message = f"{fault.message} (server log {fault.id})" if fault.id else fault.message
    retry_after_s = fault.retry_after_s if fault.HasField("retry_after_s") else None
    return _refused(attempted, code, reason_word(fault.reason), message, retry_after_s)


def _refused(attempted: str, code: str, reason: str, message: str, retry_after_s: int | None) -> Error:
    message = message or code
    if code == "UNAUTHENTICATED" or reason == "TOKEN_SCOPE":
        return TokenError(attempted, reason, message)
    return RefusedError(attempted, reason, message, retry_after_s)
