"""Errors between agent and server. Every message contains the attempted operation and the next step."""

from __future__ import annotations

from typing import TYPE_CHECKING, NoReturn, cast

import grpc

from avln.v1 import common_pb2

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
    """Whatever this package raises by itself."""

    reason: str = ""
    """Reason from the closed list of PROTOCOL.md, such as `QUOTA_DAY`; may be empty."""
    retry_after_s: int | None = None
    """Delay before a retry, seconds; None: waiting does not help."""


class AddressError(Error):
    """The server's address makes no sense."""

    def __init__(self, address: str, problem: str) -> None:
        super().__init__(f"server address '{address}': {problem}; write it like http://127.0.0.1:50051")


class UnreachableError(Error):
    """No answer at the server address."""

    def __init__(self, address: str, detail: str) -> None:
        super().__init__(
            f"cannot reach {address}: {detail}; is the server running there, is this its gRPC port, and does it speak "
            "TLS (https://) or not (http://)? Set the address with --server or AVLN_SERVER"
        )


class TlsError(Error):
    """The server cannot be spoken to in private."""

    def __init__(self, address: str, problem: str) -> None:
        super().__init__(f"{address}: {problem}")


class NotArenaError(Error):
    """Something answers, but not in `avln.v1`."""

    def __init__(self, address: str, detail: str) -> None:
        super().__init__(
            f"{address} answers, but not as an LH-AVLN Arena gRPC server ({detail}); use its gRPC port, not that of "
            "its web pages, and https:// where it speaks TLS"
        )


class LostError(Error):
    """The connection is lost: stored results remain, open episodes end as disconnected."""

    def __init__(self, attempted: str, detail: str) -> None:
        super().__init__(
            f"{attempted}: the connection to the server was lost ({detail}); what it has stored is safe, "
            "try again when it answers"
        )


class ProtocolError(Error):
    """The server said something that `avln.v1` does not allow."""

    def __init__(self, detail: str) -> None:
        super().__init__(
            f"the server broke the protocol: {detail}; this client and the server may not fit together, "
            "compare `avln-py doctor` with the organiser's version"
        )


class SensorsError(Error, ValueError):
    """The requested sensors are out of range for any server."""

    def __init__(self, width: int, height: int, hfov_rad: float) -> None:
        super().__init__(
            f"camera of {width} x {height} pixels with hfov {hfov_rad} rad: sides go from 64 to 1024 pixels, "
            "hfov from 0.35 to 2.4 rad"
        )


class PhaseError(Error):
    """No phase was given, and there is no or no unique default phase."""

    def __init__(self, free: list[str], known: list[str]) -> None:
        if free:
            found = f"there are several to practise in, {', '.join(free)}"
        elif known:
            found = f"runs are counted or cannot begin in all of them, which are {', '.join(known)}"
        else:
            found = "this server shows your team none"
        super().__init__(f"start a run without naming a phase: {found}; name one by phase= or --phase")


class EpisodeOverError(Error):
    """A step was asked for in an episode that is over."""

    def __init__(self) -> None:
        super().__init__("the episode is over; begin another with Play.next_episode")


class RunOverError(Error):
    """An episode was asked for in a run that has none left."""

    def __init__(self, run: str, phase: str, because: str = "none is left") -> None:
        where = f" in phase {phase}" if phase else ""
        super().__init__(f"run {run}{where} gives no episode: {because}; start another run")


class RefusedError(Error):
    """A refusal by the server; see `reason`."""

    def __init__(self, attempted: str, reason: str, message: str, retry_after_s: int | None = None) -> None:
        hint = "" if retry_after_s is None else f"; try again in {retry_after_s} s"
        super().__init__(f"{attempted}: refused ({reason or 'UNSPECIFIED'}): {message}{hint}")
        self.reason = reason
        self.retry_after_s = retry_after_s


class TokenError(Error):
    """The server rejects the token; see `reason`."""

    def __init__(self, attempted: str, reason: str, message: str) -> None:
        super().__init__(f"{attempted}: the server refused the token ({reason}): {message}{_token_hint(reason)}")
        self.reason = reason


class UnknownActionError(Error, ValueError):
    """An agent chose something that is no action."""

    def __init__(self, choice: object, known: str) -> None:
        super().__init__(f"take the action {choice!r}: it is none; use {known}")


def _token_hint(reason: str) -> str:
    if reason in _NEW_TOKEN:
        return "; ask the organiser for a new one and give it with --token or AVLN_TOKEN"
    if reason == "TOKEN_SCOPE":
        return "; account tokens start runs, run tokens play them"
    return "; give the account's token with --token or AVLN_TOKEN"


def is_passing(error: Error) -> bool:
    """Returns True for temporary errors: a lost connection, or a restarting server."""
    return isinstance(error, (LostError, UnreachableError)) or error.reason in _PASSING


def reason_word(number: int) -> str:
    """`common_pb2.Reason` word without prefix; empty for unknown reasons."""
    if number == common_pb2.REASON_UNSPECIFIED or number not in common_pb2.Reason.values():
        return ""
    return str(common_pb2.Reason.Name(cast("common_pb2.Reason", number))).replace("REASON_", "", 1)


def from_call(attempted: str, error: grpc.RpcError) -> Error:
    """Error for a gRPC call that failed during `attempted`."""
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
    """Error for a fault on a stream during `attempted`."""
    code = next((code.name for code in grpc.StatusCode if code.value[0] == fault.code), "UNKNOWN")
    message = f"{fault.message} (server log {fault.id})" if fault.id else fault.message
    retry_after_s = fault.retry_after_s if fault.HasField("retry_after_s") else None
    return _refused(attempted, code, reason_word(fault.reason), message, retry_after_s)


def _refused(attempted: str, code: str, reason: str, message: str, retry_after_s: int | None) -> Error:
    message = message or code
    if code == "UNAUTHENTICATED" or reason == "TOKEN_SCOPE":
        return TokenError(attempted, reason, message)
    return RefusedError(attempted, reason, message, retry_after_s)


def raise_call(attempted: str, error: grpc.RpcError) -> NoReturn:
    """Raises the error for a gRPC call that failed during `attempted`."""
    raise from_call(attempted, error) from None
