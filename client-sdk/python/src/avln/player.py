"""Agent classes named on the command line."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Callable

if TYPE_CHECKING:
    from types import ModuleType

CLASS = "Agent"
"""Default class name in an agent's file."""


class UnknownAgentError(ValueError):
    """An agent name without a usable class."""

    def __init__(self, name: str, problem: str) -> None:
        super().__init__(f"load agent {name}: {problem}; use FILE.py, FILE.py:CLASS or MODULE:CLASS")


def load_agent(name: str) -> Callable[[], Any]:
    """Returns the class named `agent.py`, `agent.py:Walker` or `package.module:Walker`.

    Raises:
        UnknownAgentError: if the file, module or class does not exist, or the class has no `begin` and `act`.
    """
    place, _, named = name.rpartition(":") if ":" in name else (name, "", CLASS)
    agent = getattr(_module(name, place), named, None)
    if agent is None:
        raise UnknownAgentError(name, f"there is no class {named} in {place}")
    missing = [method for method in ("begin", "act") if not callable(getattr(agent, method, None))]
    if missing:
        raise UnknownAgentError(name, f"class {named} has no method {' or '.join(missing)}")
    made: Callable[[], Any] = agent
    return made


def _module(name: str, place: str) -> ModuleType:
    if not place.endswith(".py"):
        _import_from(Path.cwd())
        try:
            return importlib.import_module(place)
        except ModuleNotFoundError as error:
            raise UnknownAgentError(name, str(error)) from None
    path = Path(place)
    own = f"_avln_agent_{path.stem}"  # the file may have the name of an installed module
    spec = importlib.util.spec_from_file_location(own, path)
    if not path.is_file() or spec is None or spec.loader is None:
        raise UnknownAgentError(name, f"there is no file {place}")
    _import_from(path.resolve().parent)
    module = importlib.util.module_from_spec(spec)
    sys.modules[own] = module
    spec.loader.exec_module(module)
    return module


def _import_from(folder: Path) -> None:
    """Adds an agent's folder to the import path; installed modules have priority."""
    if str(folder) not in sys.path:
        sys.path.append(str(folder))
