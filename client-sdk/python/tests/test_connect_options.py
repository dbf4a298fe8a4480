"""Addresses, TLS and what goes wrong on the way: every text says what to do next."""

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
def test_addresses_that_cannot_work_say_how_to_write_them(address: str) -> None:
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
def test_addresses_are_taken_apart(text: str, target: str, *, is_secure: bool, is_local: bool) -> None:
    address = parse_address(text)
    assert (address.target, address.is_secure, address.is_local) == (target, is_secure, is_local)


def test_a_silent_address_names_the_option() -> None:
    with pytest.raises(avln.UnreachableError, match="--server or AVLN_SERVER"):
        avln.connect(f"http://127.0.0.1:{free_port()}")


def test_the_port_of_the_pages_is_not_the_agents_door(endpoint: Endpoint) -> None:
    with pytest.raises((avln.UnreachableError, avln.NotArenaError), match="gRPC port"):
        avln.connect(f"http://127.0.0.1:{endpoint.server.web}")


def test_plain_text_and_tls_are_told_apart(endpoint: Endpoint) -> None:
    with pytest.raises(avln.TlsError, match="write http://"):
        avln.connect(endpoint.url.replace("http:", "https:"))


def test_files_of_authorities_that_are_no_use_are_named(tmp_path: Path) -> None:
    with pytest.raises(avln.TlsError, match=r"no-such-file.*--ca"):
        avln.connect("https://arena.example", connect_options=avln.ConnectOptions(ca=tmp_path / "no-such-file.pem"))
    empty = tmp_path / "empty.pem"
    empty.write_text("nothing")
    with pytest.raises(avln.TlsError, match="holds no certificate"):
        avln.connect("https://arena.example", connect_options=avln.ConnectOptions(ca=empty))


def test_a_token_with_a_line_break_is_never_sent(endpoint: Endpoint) -> None:
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


def test_words_of_newer_servers_are_other() -> None:
    assert word(task_pb2.PoseFrame, task_pb2.POSE_FRAME_WORLD) == "world"
    assert word(task_pb2.SoundClip, 0) == "unspecified"
    assert word(task_pb2.SoundClip, 77) == "other"
    assert avln.EndReason.from_wire(77) is avln.EndReason.OTHER
    assert avln.Feedback.from_wire(77) is avln.Feedback.NONE


def test_a_task_with_which_no_agent_could_calculate_is_refused() -> None:
    with pytest.raises(avln.ProtocolError, match=r"forward_m is 0.0"):
        avln.TaskSpec.from_wire(task_pb2.TaskSpec())


def test_a_run_shows_no_token() -> None:
    assert "secret" not in repr(avln.Run.from_token("avln_run_secret"))


def test_actions_have_the_numbers_of_action_spaces_and_of_the_wire() -> None:
    assert [action.to_wire() for action in avln.Action] == [index + 1 for index in range(5)]
    assert [order.to_wire() for order in avln.Order] == [common_pb2.ORDER_ORDERED, common_pb2.ORDER_UNORDERED]


class Reset(grpc.RpcError):
    """gRPC's error for an ended call."""

    def __init__(self, code: grpc.StatusCode, message: str, reason: str = "") -> None:
        self._code, self._message = code, message
        self._trailers = (("avln-reason", reason),) if reason else ()

    def code(self) -> grpc.StatusCode:
        return self._code

    def details(self) -> str:
        return self._message

    def trailing_metadata(self) -> Any:
        return self._trailers


def test_streams_that_a_proxy_gave_up_and_calls_without_an_answer_are_lost() -> None:
    reset = "Received RST_STREAM with error code 2"
    assert is_passing(from_call("play", Reset(grpc.StatusCode.INTERNAL, reset)))
    assert is_passing(from_call("ask", Reset(grpc.StatusCode.DEADLINE_EXCEEDED, "Deadline Exceeded")))
    assert not is_passing(from_call("play", Reset(grpc.StatusCode.INTERNAL, reset, "INTERNAL")))
    assert not is_passing(from_call("play", Reset(grpc.StatusCode.INTERNAL, "inc_1")))
