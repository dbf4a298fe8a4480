"""Learning curves: success over training time, as CSV and as a chart.

    python examples/training/curve.py ppo.pt.csv dagger.pt.csv --out curves.svg

draws a line per file.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections import deque
from pathlib import Path

RECENT_EPISODES = 500
"""Episodes in a value of the curve."""
ROW_STEPS = 20_000
"""Training steps per row."""
COLOURS = ("#0b6e99", "#c4541d", "#3a7d44", "#7b4fa3", "#8a6d1d", "#b03060")
WIDTH, HEIGHT, LEFT, TOP, RIGHT, BOTTOM = 640, 320, 56, 16, 150, 44


class Curve:
    """The success of recent training episodes, written to a CSV file and printed."""

    def __init__(self, path: str | Path) -> None:
        """Creates the file; the time starts now."""
        self._path = Path(path)
        self._path.write_text("steps,minutes,success\n", encoding="utf-8")
        self._began_s = time.monotonic()
        self._steps = self._written = 0
        self._recent: deque[bool] = deque(maxlen=RECENT_EPISODES)

    def add(self, steps: int, successes: list[bool]) -> None:
        """Adds steps and the outcomes of ended episodes."""
        self._steps += steps
        self._recent.extend(successes)
        if self._steps - self._written < ROW_STEPS or not self._recent:
            return
        self._written = self._steps
        minutes, success = (time.monotonic() - self._began_s) / 60.0, sum(self._recent) / len(self._recent)
        with self._path.open("a", encoding="utf-8") as file:
            file.write(f"{self._steps},{minutes:.2f},{success:.3f}\n")
        speed = self._steps / (60.0 * minutes)
        print(
            f"{self._steps} steps in {minutes:.1f} min, {100 * success:.1f} % success, {speed:.0f} steps/s", flush=True
        )


def read(path: Path) -> list[tuple[float, float]]:
    """Returns minutes and success of all rows."""
    with path.open(encoding="utf-8") as file:
        return [(float(row["minutes"]), float(row["success"])) for row in csv.DictReader(file)]


def chart(curves: dict[str, list[tuple[float, float]]]) -> str:
    """Returns an SVG image with a line per curve."""
    longest = max([0.1, *(minutes for curve in curves.values() for minutes, _ in curve)])
    wide, high = WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM

    def place(minutes: float, success: float) -> tuple[float, float]:
        return LEFT + wide * minutes / longest, TOP + high * (1.0 - success)

    box = f'viewBox="0 0 {WIDTH} {HEIGHT}"'
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" {box} font-family="sans-serif" font-size="12">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>',
    ]
    for share in (0.0, 0.2, 0.4, 0.6, 0.8, 1.0):
        x, y = place(0.0, share)
        parts += [
            f'<line x1="{x}" x2="{x + wide}" y1="{y:.1f}" y2="{y:.1f}" stroke="#dddddd"/>',
            f'<text x="{x - 6}" y="{y + 4:.1f}" text-anchor="end">{100 * share:.0f} %</text>',
        ]
    for part in range(5):
        minutes = longest * part / 4
        x, y = place(minutes, 0.0)
        parts.append(f'<text x="{x:.1f}" y="{y + 18:.1f}" text-anchor="middle">{minutes:.1f}</text>')
    middle = LEFT + wide / 2
    parts.append(f'<text x="{middle}" y="{HEIGHT - 8}" text-anchor="middle">training time, minutes</text>')
    for number, (name, curve) in enumerate(curves.items()):
        colour = COLOURS[number % len(COLOURS)]
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in (place(*row) for row in curve))
        y = TOP + 14 + 18 * number
        parts += [
            f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.8"/>',
            f'<text x="{LEFT + wide + 10}" y="{y}" fill="{colour}">{name}</text>',
        ]
    return "\n".join([*parts, "</svg>", ""])


def main(arguments: list[str] | None = None) -> None:
    """Runs the command line."""
    program = argparse.ArgumentParser("curve", description="Draw learning curves")
    program.add_argument("files", nargs="+", type=Path, help="CSV files of trainings")
    program.add_argument("--out", type=Path, default=Path("curves.svg"), help="SVG file [curves.svg]")
    options = program.parse_args(arguments)
    names = [path.name.split(".")[0] for path in options.files]
    labels = [name if names.count(name) == 1 else str(path) for name, path in zip(names, options.files)]
    curves = {label: read(path) for label, path in zip(labels, options.files)}
    options.out.write_text(chart(curves), encoding="utf-8")
    print(f"wrote {options.out}")


if __name__ == "__main__":
    main()
