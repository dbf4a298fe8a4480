"""Generation of `src/avln/v1` from the repository's `proto/avln/v1/*.proto`.

Run `python tools/generate.py` with grpcio-tools 1.62: its output works with protobuf 4.25 and later. Newer
versions generate code that rejects older protobuf versions.
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
    """Generates messages and type stubs; returns the generator's exit code."""
    found = version("grpcio-tools")
    if not found.startswith(GENERATOR):
        print(
            f"grpcio-tools {found} generates code that older protobuf versions reject; "
            f"install grpcio-tools=={GENERATOR}.*"
        )
        return 1
    files = sorted(str(file) for file in (PROTO / "avln" / "v1").glob("*.proto"))
    out = PACKAGE / "src"
    return int(protoc.main(["protoc", f"-I{PROTO}", f"--python_out={out}", f"--pyi_out={out}", *files]))


if __name__ == "__main__":
    sys.exit(main())
