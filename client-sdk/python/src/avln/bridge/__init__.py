"""Bridge for clients with the LH-AVLN authors' protocol; `pip install 'avln[bridge]'`.

avln-bridge zmq --bind tcp://127.0.0.1:5555 --server URL --token TOKEN --phase PHASE
"""

try:
    from avln.bridge.frames import pack, unpack
    from avln.bridge.program import main
    from avln.bridge.request_handler import RequestHandler
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(f"avln.bridge needs {error.name}; pip install 'avln[bridge]'", name=error.name) from None

__all__ = ["RequestHandler", "main", "pack", "unpack"]
