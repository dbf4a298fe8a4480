"""Build hook of the wheel: `packaging/wheel.sh` adds the native module and the program for a platform."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class PlatformWheel(BuildHookInterface[Any]):
    """Adds the files of the folder `AVLN_WHEEL_FILES`; without it, the wheel fits any platform."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Adds modules and programs, sets the tag `AVLN_WHEEL_TAG`, and requires the packages of avln.sim."""
        files = os.environ.get("AVLN_WHEEL_FILES")
        if files is None or version != "standard":
            return
        build_data["pure_python"] = False
        build_data["dependencies"] += ["gymnasium>=1.1", "pillow>=10"]
        build_data["tag"] = os.environ["AVLN_WHEEL_TAG"]
        build_data["force_include"][str(Path(files, "package"))] = "avln"
        for path in Path(files, "scripts").iterdir():
            build_data["shared_scripts"][str(path)] = path.name
