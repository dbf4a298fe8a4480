"""Tests of run starts: once despite lost answers, and without unusable runs after errors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from server import PHASE

import avln
from avln.client import begin_run
from avln.errors import LostError, SensorsError
from avln.v1 import run_pb2

if TYPE_CHECKING:
    from conftest import Endpoint

TOO_SMALL = avln.Sensors.square(63)


def open_runs(client: avln.Client, method: str) -> list[str]:
    return [run.id for run in client.runs(PHASE) if run.method == method and run.state in ("created", "running")]


def test_invalid_sensors_start_no_run(endpoint: Endpoint, client: avln.Client) -> None:
    with pytest.raises(SensorsError, match="63 x 63"):
        avln.begin(endpoint.url, endpoint.token, PHASE, "too small", sensors=TOO_SMALL)
    assert not [run for run in client.runs(PHASE) if run.method == "too small"]


def test_unknown_method_type_starts_no_run(endpoint: Endpoint, client: avln.Client) -> None:
    with pytest.raises(ValueError, match=r"'magic' does not exist; use one of: training-free, .*, rl"):
        avln.begin(endpoint.url, endpoint.token, PHASE, "mystic", method_type="magic")
    assert not [run for run in client.runs(PHASE) if run.method == "mystic"]


def test_run_keeps_method_type(client: avln.Client) -> None:
    for declared in [None, *avln.MethodType]:
        run = client.start_run(PHASE, "typed", method_type=declared)
        assert client.cancel_run(run.id).method_type is declared
    run = client.start_run(PHASE, "typed", method_type="rl")
    assert client.cancel_run(run.id).method_type is avln.MethodType.RL


def test_method_types_match_protocol() -> None:
    numbers = [known.to_wire() for known in avln.MethodType]
    assert [0, *numbers] == run_pb2.MethodType.values()
    assert [avln.MethodType.from_wire(number) for number in numbers] == list(avln.MethodType)
    assert avln.MethodType.from_wire(0) is None
    assert avln.MethodType.from_wire(99) is None


def test_failed_stream_cancels_run(endpoint: Endpoint, client: avln.Client, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any) -> None:
        raise avln.Error("this stream is refused by the test")

    monkeypatch.setattr(avln.Client, "play", refuse)
    with pytest.raises(avln.Error, match="refused by the test"):
        avln.begin(endpoint.url, endpoint.token, PHASE, "unopened")
    runs = [run for run in client.runs(PHASE) if run.method == "unopened"]
    assert len(runs) == 1
    assert not open_runs(client, "unopened")


def test_lost_answer_is_retried_with_one_run(client: avln.Client, monkeypatch: pytest.MonkeyPatch) -> None:
    ask = client._ask_once
    asked: list[str] = []

    def lose_twice(attempted: str, method: str, request: Any) -> Any:
        answer = ask(attempted, method, request)
        if method.endswith("StartRun"):
            asked.append(request.client_request_id)
            if len(asked) < 3:
                raise LostError(attempted, "UNAVAILABLE")
        return answer

    monkeypatch.setattr(client, "_ask_once", lose_twice)
    run = client.start_run(PHASE, "lost and found", "ordered")  # type: ignore[arg-type]
    assert len(asked) == 3
    assert len(set(asked)) == 1
    assert open_runs(client, "lost and found") == [run.id]
    client.cancel_run(run.id)


def test_retries_stop_after_patience(endpoint: Endpoint, monkeypatch: pytest.MonkeyPatch) -> None:
    with avln.connect(endpoint.url, endpoint.token, avln.ConnectOptions(patience_s=0.2)) as client:
        asked: list[str] = []

        def lose(attempted: str, method: str, _: Any) -> Any:
            asked.append(method)
            raise LostError(attempted, "UNAVAILABLE")

        monkeypatch.setattr(client, "_ask_once", lose)
        with pytest.raises(LostError, match="token's account"):
            client.whoami()
        assert len(asked) > 1


def test_unknown_order_starts_no_run(endpoint: Endpoint) -> None:
    with pytest.raises(ValueError, match="sideways"):
        begin_run(endpoint.url, endpoint.token, PHASE, "sideways", "sideways")  # type: ignore[arg-type]


def test_play_token_continues_run(endpoint: Endpoint) -> None:
    play = avln.begin(endpoint.url, endpoint.token, PHASE, "crashed", sensors=avln.Sensors.square(64))
    token = play.token
    play.close()
    with avln.begin(endpoint.url, token, "", "", sensors=avln.Sensors.square(64)) as again:
        assert again.run == play.run
