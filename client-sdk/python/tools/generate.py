"""Writes `src/avln/v1` from the repository's `proto/avln/v1/*.proto`.

Run `python tools/generate.py` with grpcio-tools 1.62: what that version writes is loaded by every protobuf from 4.25
on, while newer ones write files that refuse an older protobuf.
"""

from __future__ import annotations

import sys
from importlib.metadata import version
from pathlib import Path

from grpc_tools import protoc

PACKAGE = Path(__file__).resolve().parents[1]
PROTO = PACKAGE.parents[1] / "proto"
GENERATOR = "1.62"


def main() -> int:
    """Writes messages and their types; returns the generator's exit code."""
    found = version("grpcio-tools")
    if not found.startswith(GENERATOR):
        print(
            f"grpcio-tools {found} would write files that older protobufs refuse; install grpcio-tools=={GENERATOR}.*"
        )
        return 1
    files = sorted(str(file) for file in (PROTO / "avln" / "v1").glob("*.proto"))
    out = PACKAGE / "src"
    return int(protoc.main(["protoc", f"-I{PROTO}", f"--python_out={out}", f"--pyi_out={out}", *files]))


if __name__ == "__main__":
    sys.exit(main())
