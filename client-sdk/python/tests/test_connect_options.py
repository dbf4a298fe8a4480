"""Tests of addresses, TLS and connection errors; every error contains the next step."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import grpc
import pytest
from server import free_port

import avln
from avln.connect_options import parse_address
from avln.errors import from_call, from_fault, is_passing
from avln.task import word
from avln.v1 import common_pb2, play_pb2, task_pb2

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Endpoint


@pytest.mark.parametrize("address", ["localhost:50051", "ftp://x", "http://", "http://a b", "unix:relative.sock"])
def test_invalid_address_error_shows_syntax(address: str) -> None:
    with pytest.raises(avln.AddressError) as refused:
        avln.connect(address)
    assert address in str(refused.value)
    assert "http://127.0.0.1:50051" in str(refused.value)


@pytest.mark.parametrize(
    ("text", "target", "is_secure", "is_local"),
    [
        ("http://127.0.0.1:50051", "127.0.0.1:50051", False, True),
        ("https://arena.example", "arena.example:443", True, False),
        ("http://[::1]:7", "[::1]:7", False, True),
        ("unix:/run/arena.sock", "unix:/run/arena.sock", False, True),
    ],
)
def test_addresses_are_parsed(text: str, target: str, *, is_secure: bool, is_local: bool) -> None:
    address = parse_address(text)
    assert (address.target, address.is_secure, address.is_local) == (target, is_secure, is_local)


def test_unreachable_server_error_names_option() -> None:
    with pytest.raises(avln.UnreachableError, match="--server or AVLN_SERVER"):
        avln.connect(f"http://127.0.0.1:{free_port()}")


def test_web_port_error_mentions_grpc_port(endpoint: Endpoint) -> None:
    with pytest.raises((avln.UnreachableError, avln.NotArenaError), match="gRPC port"):
        avln.connect(f"http://127.0.0.1:{endpoint.server.web}")


def test_missing_tls_error_suggests_http(endpoint: Endpoint) -> None:
    with pytest.raises(avln.TlsError, match="use http://"):
        avln.connect(endpoint.url.replace("http:", "https:"))


def test_unusable_authority_file_error_has_path(tmp_path: Path) -> None:
    with pytest.raises(avln.TlsError, match=r"no-such-file.*--ca"):
        avln.connect("https://arena.example", connect_options=avln.ConnectOptions(ca=tmp_path / "no-such-file.pem"))
    empty = tmp_path / "empty.pem"
    empty.write_text("nothing")
    with pytest.raises(avln.TlsError, match="contains no certificate"):
        avln.connect("https://arena.example", connect_options=avln.ConnectOptions(ca=empty))


def test_token_with_line_break_is_rejected(endpoint: Endpoint) -> None:
    with pytest.raises(avln.TokenError, match="TOKEN_MALFORMED"):
        avln.connect(endpoint.url, "avln_a\nb")


def test_faults_become_errors_with_reason_and_delay() -> None:
    full = play_pb2.Fault(code=8, reason=common_pb2.REASON_NO_CAPACITY, message="full", retry_after_s=7, id="a1")
    error = from_fault("begin an episode", full)
    assert (error.reason, error.retry_after_s) == ("NO_CAPACITY", 7)
    assert is_passing(error)
    assert str(error) == "begin an episode: refused (NO_CAPACITY): full (server log a1); try again in 7 s"
    expired = from_fault("play", play_pb2.Fault(code=16, reason=common_pb2.REASON_TOKEN_EXPIRED))
    assert isinstance(expired, avln.TokenError)
    assert "AVLN_TOKEN" in str(expired)
    assert not is_passing(expired)
    unknown = play_pb2.Fault.FromString(play_pb2.Fault(code=7, message="no").SerializeToString() + b"\x28\x63")
    assert unknown.reason == 99
    newer = from_fault("play", unknown)
    assert (newer.reason, newer.retry_after_s) == ("", None)


def test_unknown_enum_values_are_other() -> None:
    assert word(task_pb2.PoseFrame, task_pb2.POSE_FRAME_WORLD) == "world"
    assert word(task_pb2.SoundClip, 0) == "unspecified"
    assert word(task_pb2.SoundClip, 77) == "other"
    assert avln.EndReason.from_wire(77) is avln.EndReason.OTHER
    assert avln.Feedback.from_wire(77) is avln.Feedback.NONE


def test_task_with_zero_length_is_rejected() -> None:
    with pytest.raises(avln.ProtocolError, match=r"forward_m: expected a positive number, got 0.0"):
        avln.TaskSpec.from_wire(task_pb2.TaskSpec())


def test_run_repr_hides_token() -> None:
    assert "secret" not in repr(avln.Run.from_token("avln_run_secret"))


def test_wire_numbers_are_index_plus_one() -> None:
    assert [action.to_wire() for action in avln.Action] == [index + 1 for index in range(5)]
    assert [order.to_wire() for order in avln.Order] == [common_pb2.ORDER_ORDERED, common_pb2.ORDER_UNORDERED]


class Reset(grpc.RpcError):
    """gRPC's error after the end of a call."""

    def __init__(self, code: grpc.StatusCode, message: str, reason: str = "") -> None:
        self._code, self._message = code, message
        self._trailers = (("avln-reason", reason),) if reason else ()

    def code(self) -> grpc.StatusCode:
        return self._code

    def details(self) -> str:
        return self._message

    def trailing_metadata(self) -> Any:
        return self._trailers


def test_proxy_reset_and_timeout_are_lost_connections() -> None:
    reset = "Received RST_STREAM with error code 2"
    assert is_passing(from_call("play", Reset(grpc.StatusCode.INTERNAL, reset)))
    assert is_passing(from_call("ask", Reset(grpc.StatusCode.DEADLINE_EXCEEDED, "Deadline Exceeded")))
    assert not is_passing(from_call("play", Reset(grpc.StatusCode.INTERNAL, reset, "INTERNAL")))
    assert not is_passing(from_call("play", Reset(grpc.StatusCode.INTERNAL, "inc_1")))
