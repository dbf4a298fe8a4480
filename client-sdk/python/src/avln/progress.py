"""Run progress on the terminal."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from types import TracebackType

    from avln.summary import EpisodeEnd


class Bar:
    """A tqdm bar if tqdm is installed and the output is a terminal, otherwise a line per episode."""

    def __init__(self, episodes: int) -> None:
        self._bar = _tqdm(episodes) if sys.stderr.isatty() else None

    def tell(self, end: EpisodeEnd) -> None:
        """Reports an ended episode."""
        if self._bar is not None:
            self._bar.set_postfix_str(end.reason.value)
            self._bar.update()
        else:
            done, total = end.progress.done, end.progress.total
            print(f"episode {done} of {total}: {end.reason.value} after {end.steps} steps", file=sys.stderr)

    def __enter__(self) -> Bar:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.close()


def _tqdm(episodes: int) -> Any:
    try:
        from tqdm.auto import tqdm  # noqa: PLC0415, an optional dependency
    except ImportError:
        return None
    return tqdm(total=episodes or None, unit="episode")
