"""Server connections and run management."""

from __future__ import annotations

import time
import uuid
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Callable

import grpc

from avln.action import Order
from avln.agreement import Agreement
from avln.backoff import Backoff
from avln.connect_options import CONNECT_TIMEOUT_S, ConnectOptions, open_channel, parse_address, unreachable
from avln.connection import CALL_TIMEOUT_S, Connection, Dialler
from avln.errors import Error, LostError, NotArenaError, ProtocolError, TokenError, from_call
from avln.method_type import MethodType
from avln.packing import Packing
from avln.play import Play
from avln.service import Account, Phase, Quota, Run, RunStatus, ServerInfo, phase_to_practise
from avln.task import Sensors
from avln.v1 import info_pb2, play_pb2, run_pb2
from avln.version import client_info

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import TracebackType

    from google.protobuf.message import Message

RUN_TOKEN = "avln_run_"
"""Run token prefix."""
_PATIENCE_S = 10.0
"""Retry time after a lost answer, seconds; `ConnectOptions.patience_s` if shorter."""
_ANSWERS: dict[str, Any] = {
    "InfoService/GetServerInfo": info_pb2.GetServerInfoResponse,
    "InfoService/ListPhases": info_pb2.ListPhasesResponse,
    "RunService/StartRun": run_pb2.StartRunResponse,
    "RunService/GetRun": run_pb2.GetRunResponse,
    "RunService/CancelRun": run_pb2.CancelRunResponse,
    "RunService/ListRuns": run_pb2.ListRunsResponse,
    "RunService/GetQuota": run_pb2.GetQuotaResponse,
    "RunService/WhoAmI": run_pb2.WhoAmIResponse,
}


class Client:
    """A connection to a server, created by `connect`; a context manager that closes it."""

    def __init__(self, channel: grpc.Channel, token: str, packing: Packing, patience_s: float | None) -> None:
        self._channel = channel
        self._token = token
        self._packing = packing
        self._patience_s = patience_s

    @classmethod
    def connect(cls, server: str, token: str = "", connect_options: ConnectOptions | None = None) -> Client:
        """Connects to a server and verifies the server and the account token.

        Args:
            server: address like `http://127.0.0.1:50051`, `https://arena.example:50051` or `unix:/run/arena.sock`.
            token: account token. Empty is sufficient for `server_info`, `phases` and a `Run.from_token`.
            connect_options: connection options.

        Raises:
            AddressError: if the address is invalid.
            UnreachableError: if no server answers within ten seconds.
            NotArenaError: if the answer is not from an Arena server.
            TokenError: if the server rejects the token.
        """
        connect_options = connect_options or ConnectOptions()
        address = parse_address(server)
        packing = connect_options.packing or (Packing.RAW if address.is_local else Packing.LOSSLESS)
        client = cls(open_channel(address, connect_options), token, packing, connect_options.patience_s)
        try:
            client._introduce(server)
        except BaseException:
            client.close()
            raise
        return client

    def _introduce(self, server: str) -> None:
        ask = self._call("InfoService/GetServerInfo")
        try:
            ask(info_pb2.GetServerInfoRequest(), timeout=CONNECT_TIMEOUT_S)
        except grpc.RpcError as error:
            code = error.code()
            detail = f"{code.name}: {error.details()}"
            unanswered = code in (grpc.StatusCode.UNAVAILABLE, grpc.StatusCode.DEADLINE_EXCEEDED)
            raise (unreachable if unanswered else NotArenaError)(server, detail) from None
        if self._token:
            self.whoami()

    def server_info(self) -> ServerInfo:
        """Returns server information.

        Raises:
            Error: if the connection is lost.
        """
        answer = self._ask("request server information", "InfoService/GetServerInfo", info_pb2.GetServerInfoRequest())
        return ServerInfo.from_wire(answer)

    def phases(self) -> list[Phase]:
        """Returns the phases visible to the team, in the organiser's order; without a token, the public phases.

        Raises:
            Error: if the connection is lost.
        """
        answer = self._ask("list phases", "InfoService/ListPhases", info_pb2.ListPhasesRequest())
        return [Phase.from_wire(phase) for phase in answer.phases]

    def practice_phase(self) -> str:
        """Returns the default phase's id.

        It is the only open phase with uncounted runs, or among several the phase `practice`.

        Raises:
            PhaseError: if no such phase exists.
            Error: if the connection is lost.
        """
        return phase_to_practise(self.phases(), self.quota())

    def whoami(self) -> Account:
        """Returns the token's account.

        Raises:
            TokenError: if the server rejects the token.
            Error: if the connection is lost.
        """
        answer = self._ask("request the token's account", "RunService/WhoAmI", run_pb2.WhoAmIRequest())
        return Account.from_wire(answer)

    def start_run(
        self,
        phase: str,
        method: str,
        order: Order = Order.UNORDERED,
        *,
        version: str = "",
        method_type: MethodType | str | None = None,
        description: str = "",
        code_url: str = "",
        request_id: str = "",
    ) -> Run:
        """Starts a run.

        Args:
            phase: id of the phase; empty for `practice_phase`.
            method: name on the leaderboard, 1 to 80 characters.
            order: order of the goals.
            version: version of the method, at most 40 characters.
            method_type: type of the method, `MethodType` or its value: `training-free`, `learnt-perception`,
                `foundation-models`, `imitation` or `rl`.
            description: text for people, at most 2000 characters.
            code_url: address of the code, http(s).
            request_id: idempotency key, at most 64 characters; a repeated key returns the same run. The default is a
                random key, so a lost answer does not start a second run.

        Raises:
            ValueError: if `method_type` is unknown.
            RefusedError: if the phase is unknown, closed or forbidden, the quota is used up, or the server is full.
            Error: if the connection is lost.
        """
        info = run_pb2.MethodInfo(
            name=method,
            version=version,
            method_type=None if method_type is None else MethodType(method_type).to_wire(),
            description=description,
            code_url=code_url,
        )
        request = run_pb2.StartRunRequest(
            phase=phase or self.practice_phase(),
            order=Order(order).to_wire(),
            method=info,
            client_request_id=request_id or uuid.uuid4().hex,
            client=client_info(),
        )
        answer = self._ask("start a run", "RunService/StartRun", request)
        if not answer.HasField("run"):
            raise ProtocolError("StartRun returned no run")
        return Run.from_wire(answer)

    def run(self, run: str) -> RunStatus:
        """Returns a run's state.

        Raises:
            RefusedError: if the run is unknown.
            Error: if the connection is lost.
        """
        answer = self._ask("request a run's state", "RunService/GetRun", run_pb2.GetRunRequest(run=run))
        return RunStatus.from_wire(answer.run)

    def watch(self, run: str) -> Iterator[RunStatus]:
        """Yields a run's state after every change, until it ends.

        Raises:
            RefusedError: if the run is unknown.
            Error: if the connection is lost.
        """
        call = self._channel.unary_stream(
            "/avln.v1.RunService/WatchRun",
            request_serializer=_serialize,
            response_deserializer=run_pb2.WatchRunResponse.FromString,
        )
        try:
            for answer in call(run_pb2.WatchRunRequest(run=run), metadata=self._metadata()):
                yield RunStatus.from_wire(answer.run)
        except grpc.RpcError as error:
            raise from_call("watch a run", error) from None

    def runs(self, phase: str = "") -> list[RunStatus]:
        """Returns the team's runs, newest first, optionally of a single phase.

        Raises:
            Error: if the connection is lost.
        """
        runs: list[RunStatus] = []
        page = ""
        while True:
            request = run_pb2.ListRunsRequest(phase=phase, page_size=200, page_token=page)
            answer = self._ask("list runs", "RunService/ListRuns", request)
            runs += [RunStatus.from_wire(run) for run in answer.runs]
            page = answer.next_page_token
            if not page:
                return runs

    def cancel_run(self, run: str) -> RunStatus:
        """Cancels a run; open episodes end as abandoned.

        Raises:
            RefusedError: if the run is unknown.
            Error: if the connection is lost.
        """
        answer = self._ask("cancel a run", "RunService/CancelRun", run_pb2.CancelRunRequest(run=run))
        return RunStatus.from_wire(answer.run)

    def quota(self, phase: str = "") -> list[Quota]:
        """Returns the remaining quota in all visible phases, or in a single phase.

        Raises:
            Error: if the connection is lost.
        """
        answer = self._ask("request the quota", "RunService/GetQuota", run_pb2.GetQuotaRequest(phase=phase))
        return [Quota.from_wire(quota) for quota in answer.quotas]

    def play(self, run: Run, sensors: Sensors | None = None) -> Play:
        """Opens the run stream for a single slot.

        Raises:
            SensorsError: if `sensors` are out of range.
            RefusedError: if they are forbidden, the run has ended, or the server rejects this client version.
            Error: if the protocol is violated or the connection is lost.
        """
        return self.play_slots(run, 1, sensors)[0]

    def play_slots(self, run: Run, slots: int, sensors: Sensors | None = None) -> list[Play]:
        """Opens the run stream for up to `slots` slots; returns the granted slots.

        Slots may be used from different threads, a slot from a single thread at a time.

        Raises:
            Error: as for `play`.
        """
        connection, agreement = self.connection(run, slots, sensors)
        return [Play(connection, agreement, slot) for slot in range(min(agreement.slots, max(slots, 1)))]

    def connection(self, run: Run, slots: int = 1, sensors: Sensors | None = None) -> tuple[Connection, Agreement]:
        """Opens the run's raw connection for `avln.v1` frames; it resumes the run after a loss.

        Raises:
            Error: as for `play`.
        """
        sensors = sensors or Sensors()
        hello = play_pb2.Hello(
            run=run.id, client=client_info(), slots=max(slots, 1), sensors=sensors.to_wire(self._packing)
        )
        dialler = Dialler(self._open_call(), run.token, hello, self._patience_s)
        stream = dialler.dial()
        try:
            if stream.welcome is None:
                raise ProtocolError("the run ended before Welcome")
            agreement = Agreement(stream.welcome, sensors, self._packing)
        except BaseException:
            stream.close()
            stream.forget()
            raise
        granted = min(agreement.slots, hello.slots)
        return Connection(dialler, stream, granted, agreement.may_be_away_s, agreement.progress), agreement

    def _open_call(self) -> Callable[..., Any]:
        return self._channel.stream_stream(
            "/avln.v1.PlayService/Play",
            request_serializer=_serialize,
            response_deserializer=_play_response,
        )

    def check_sensors(self, sensors: Sensors | None) -> None:
        """Checks the range of sensor settings.

        Raises:
            SensorsError: if they are out of range for any server.
        """
        (sensors or Sensors()).to_wire(self._packing)

    def _ask(self, attempted: str, method: str, request: Message) -> Any:
        """Makes an idempotent call, and retries it after a lost answer."""
        patience_s = _PATIENCE_S if self._patience_s is None else min(self._patience_s, _PATIENCE_S)
        until = time.monotonic() + patience_s
        backoff = Backoff()
        while True:
            try:
                return self._ask_once(attempted, method, request)
            except LostError as failure:
                pause_s = backoff.after(failure)
                if time.monotonic() + pause_s >= until:
                    raise
            time.sleep(pause_s)

    def _ask_once(self, attempted: str, method: str, request: Message) -> Any:
        try:
            return self._call(method)(request, timeout=CALL_TIMEOUT_S, metadata=self._metadata())
        except grpc.RpcError as error:
            raise from_call(attempted, error) from None

    def _call(self, method: str) -> Any:
        return self._channel.unary_unary(
            f"/avln.v1.{method}",
            request_serializer=_serialize,
            response_deserializer=_ANSWERS[method].FromString,
        )

    def _metadata(self) -> tuple[tuple[str, str], ...]:
        if not self._token:
            return ()
        if not (self._token.isascii() and self._token.isprintable()):
            detail = "it contains characters that are not allowed in tokens"
            raise TokenError("send the token", "TOKEN_MALFORMED", detail)
        return (("authorization", f"Bearer {self._token}"),)

    def close(self) -> None:
        """Closes the connection and the streams of its runs."""
        self._channel.close()

    def __enter__(self) -> Client:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def _serialize(message: Message) -> bytes:
    return message.SerializeToString()


_play_response = play_pb2.PlayResponse.FromString


def connect(server: str, token: str = "", connect_options: ConnectOptions | None = None) -> Client:
    """Connects to a server: `Client.connect`."""
    return Client.connect(server, token, connect_options)


def begin(
    server: str,
    token: str,
    phase: str,
    method: str,
    order: Order = Order.UNORDERED,
    *,
    method_type: MethodType | str | None = None,
    sensors: Sensors | None = None,
    connect_options: ConnectOptions | None = None,
) -> Play:
    """Connects, begins a run and opens its stream for a single slot.

    A run token continues its run and ignores `phase`, `method`, `order` and `method_type`; sealed agents never
    see an account token.

    Raises:
        ValueError: if `method_type` is unknown; no run begins.
        Error: as for `Client.connect`, `Client.start_run` and `Client.play`.
    """
    client, run = begin_run(
        server,
        token,
        phase,
        method,
        order,
        method_type=method_type,
        sensors=sensors,
        connect_options=connect_options,
    )
    with undone_on_error(client, run, is_own=not token.startswith(RUN_TOKEN)):
        play = client.play(run, sensors)
    play.connection.on_close = client.close
    return play


def begin_run(
    server: str,
    token: str,
    phase: str,
    method: str,
    order: Order = Order.UNORDERED,
    *,
    method_type: MethodType | str | None = None,
    sensors: Sensors | None = None,
    connect_options: ConnectOptions | None = None,
) -> tuple[Client, Run]:
    """Connects and begins a run with `sensors`, or continues the run of a run token.

    Raises:
        Error: as for `Client.connect` and `Client.start_run`.
        SensorsError: if the sensor settings are out of range; no run begins.
        ValueError: if `method_type` is unknown; no run begins.
    """
    order = Order(order)
    method_type = None if method_type is None else MethodType(method_type)
    is_of_run = token.startswith(RUN_TOKEN)
    client = Client.connect(server, "" if is_of_run else token, connect_options)
    try:
        client.check_sensors(sensors)
        if is_of_run:
            return client, Run.from_token(token)
        return client, client.start_run(phase, method, order, method_type=method_type)
    except BaseException:
        client.close()
        raise


@contextmanager
def undone_on_error(client: Client, run: Run, *, is_own: bool) -> Iterator[None]:
    """Closes the connection if the block fails, and cancels a run started by this client."""
    try:
        yield
    except BaseException:
        try:
            if is_own:
                client.cancel_run(run.id)
        except Error:
            pass  # the first error is raised
        finally:
            client.close()
        raise
