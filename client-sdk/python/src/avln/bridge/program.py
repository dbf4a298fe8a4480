"""Command line of `avln-bridge`."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import zmq

from avln.bridge.frames import pack, unpack
from avln.bridge.request_handler import RequestHandler
from avln.client import begin
from avln.errors import Error
from avln.options import add_camera, add_connection, add_run, connect_options, parser, sensors

if TYPE_CHECKING:
    from avln.play import Play

_LOOK_UP_MS = 200


def main(arguments: list[str] | None = None) -> int:
    """Runs the program and returns the exit code."""
    options = _parser().parse_args(arguments)
    try:
        run = begin(
            options.server,
            options.token,
            options.phase,
            options.method,
            options.order,
            method_type=options.method_type,
            sensors=sensors(options),
            connect_options=connect_options(options),
        )
        return _serve(run, options.bind)
    except Error as error:
        print(error, file=sys.stderr)
        return 1


def _parser() -> Any:
    program = parser("avln-bridge", "Connect clients of the LH-AVLN authors' release to an LH-AVLN Arena server")
    protocols = program.add_subparsers(dest="protocol", required=True)
    protocol = protocols.add_parser("zmq", help="the authors' protocol: MessagePack over ZeroMQ")
    address = "tcp://127.0.0.1:5555"
    protocol.add_argument("--bind", default=address, help=f"ZeroMQ address for the client [{address}]")
    add_connection(protocol)
    add_run(protocol, method="bridge")
    add_camera(protocol, size=512)
    return program


def _serve(run: Play, address: str) -> int:
    with zmq.Context() as context, context.socket(zmq.REP) as socket:
        socket.setsockopt(zmq.LINGER, 1000)
        try:
            socket.bind(address)
        except zmq.ZMQError as error:
            run.finish()
            print(f"listen on {address}: {error}; choose another address with --bind", file=sys.stderr)
            return 1
        print(f"run {run.run}: listening on {socket.getsockopt_string(zmq.LAST_ENDPOINT)}", flush=True)
        try:
            answer_all(RequestHandler(run), socket)
        except KeyboardInterrupt:
            run.finish()
    return 0


def answer_all(request_handler: RequestHandler, socket: zmq.Socket[bytes]) -> None:
    """Answers requests until the client closes the session."""
    while not request_handler.is_closed:
        if socket.poll(_LOOK_UP_MS):
            socket.send_multipart(pack(_answer(request_handler, socket.recv_multipart())))


def _answer(request_handler: RequestHandler, frames: list[bytes]) -> dict[str, Any]:
    try:
        return request_handler.answer(unpack(frames))
    except (ValueError, KeyError, IndexError, TypeError) as error:
        return {"op": "error", "message": f"read a request: {error}; send MessagePack, with arrays in further frames"}
