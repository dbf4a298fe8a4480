"""Pictures of episodes for people: the agent's view next to a map."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

HEIGHT_PX = 512
"""Height of pictures; the width is twice as large."""
GROUND = np.array([[250, 250, 250], [213, 222, 232], [126, 134, 145]], float)
"""Colours of unknown, walkable and blocked cells."""
WHITE = (255, 255, 255)
PATH = (37, 99, 235)
AGENT = (15, 40, 110)
OPEN = (220, 70, 20)
FOUND = (22, 150, 75)
SOUND = (190, 30, 160)
_MARGIN_CELLS = 8
_DIGITS = ("010110010010111", "111001111100111", "111001111001111", "101101111001001")
"""Bits of the digits 1 to 4, three per row."""


def draw(view: bytes, ground: bytes, details: str) -> NDArray[np.uint8]:
    """Returns the view and the map side by side, u8 [height, 2 * height, 3].

    The arguments are those of `NativeVector.overview`. The map has -z of the scene at the top.
    """
    overview = json.loads(details)
    cells = np.frombuffer(ground, np.uint8).reshape(overview["map_side"], -1)
    side = round((len(view) / 3) ** 0.5)
    plan, to_pixels = _ground(cells, overview, side)
    for path in overview["paths"]:
        for start, end in zip(path, path[1:]):
            _line(plan, to_pixels(start), to_pixels(end), side / 128, PATH)
    if overview["sound"]:
        for radius in (0.034, 0.048):
            _ring(plan, to_pixels(overview["sound"]), radius * side, side / 170, SOUND)
    for number, target in enumerate(overview["targets"]):
        if target["is_here"]:
            _target(plan, to_pixels(target["place"]), side, number, OPEN if target["is_open"] else FOUND)
    _agent(plan, to_pixels(overview["agent"]), side, overview["heading_rad"])
    right = np.rint(plan).astype(np.uint8)
    left = np.frombuffer(view, np.uint8).reshape(side, side, 3)
    return np.concatenate([left, right], axis=1)


def _ground(cells: NDArray[np.uint8], overview: dict[str, Any], side: int) -> tuple[NDArray[Any], Any]:
    """Returns the coloured part of the map with the storey, and a function from cells to pixels."""
    known = np.argwhere(cells)
    agent = np.array([overview["agent"][::-1]])
    places = np.concatenate([known, agent]) if len(known) else agent
    first, last = places.min(axis=0), places.max(axis=0)
    span = float((last - first).max()) + 2 * _MARGIN_CELLS
    corner = 0.5 * (first + last - span)
    rows, columns = (np.floor(corner[axis] + (np.arange(side) + 0.5) * span / side).astype(int) for axis in (0, 1))
    is_inside = [(numbers >= 0) & (numbers < len(cells)) for numbers in (rows, columns)]
    shown = cells[rows.clip(0, len(cells) - 1)][:, columns.clip(0, len(cells) - 1)]
    shown = np.where(is_inside[0][:, None] & is_inside[1], shown, 0)

    def to_pixels(place: list[float]) -> tuple[float, float]:
        return (place[0] - corner[1]) * side / span, (place[1] - corner[0]) * side / span

    return GROUND[shown], to_pixels


def _target(plan: NDArray[Any], place: tuple[float, float], side: int, number: int, colour: tuple[int, ...]) -> None:
    _disc(plan, place, 0.026 * side, WHITE)
    _disc(plan, place, 0.022 * side, colour)
    if number >= len(_DIGITS):
        return
    scale = max(side // 170, 1)
    bits = np.array([int(bit) for bit in _DIGITS[number]]).reshape(5, 3).repeat(scale, 0).repeat(scale, 1)
    left, top = round(place[0] - 1.5 * scale), round(place[1] - 2.5 * scale)
    bits = bits[max(-top, 0) :, max(-left, 0) :]
    spot = plan[max(top, 0) :, max(left, 0) :][: bits.shape[0], : bits.shape[1]]
    spot[bits[: spot.shape[0], : spot.shape[1]] > 0] = WHITE


def _agent(plan: NDArray[Any], place: tuple[float, float], side: int, heading_rad: float) -> None:
    """Draws an arrowhead with a white rim."""
    ahead = np.array([-np.sin(heading_rad), -np.cos(heading_rad)])
    across = np.array([-ahead[1], ahead[0]])
    for size, colour in ((0.036 * side, WHITE), (0.028 * side, AGENT)):
        corners = [
            np.array(place) + size * part
            for part in (1.2 * ahead, 0.8 * across - 0.6 * ahead, -0.8 * across - 0.6 * ahead)
        ]
        window, x, y = _window(plan, place, 1.5 * size)
        cover = np.ones_like(x)
        for one, other in zip(corners, corners[1:] + corners[:1]):
            along = (other - one) / np.linalg.norm(other - one)
            cover = np.minimum(cover, (along[0] * (y - one[1]) - along[1] * (x - one[0]) + 0.5).clip(0, 1))
        _blend(window, cover, colour)


def _disc(plan: NDArray[Any], place: tuple[float, float], radius: float, colour: tuple[int, ...]) -> None:
    window, x, y = _window(plan, place, radius)
    _blend(window, radius - np.hypot(x - place[0], y - place[1]) + 0.5, colour)


def _ring(plan: NDArray[Any], place: tuple[float, float], radius: float, width: float, colour: tuple[int, ...]) -> None:
    window, x, y = _window(plan, place, radius + width)
    _blend(window, 0.5 * width - abs(np.hypot(x - place[0], y - place[1]) - radius) + 0.5, colour)


def _line(
    plan: NDArray[Any], start: tuple[float, float], end: tuple[float, float], width: float, colour: tuple[int, ...]
) -> None:
    middle = (0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1]))
    along = np.subtract(end, start)
    window, x, y = _window(plan, middle, float(abs(along).max()) / 2 + width)
    dx, dy = x - start[0], y - start[1]
    share = ((dx * along[0] + dy * along[1]) / max(float(along @ along), 1e-9)).clip(0, 1)
    _blend(window, 0.5 * width - np.hypot(dx - share * along[0], dy - share * along[1]) + 0.5, colour)


def _window(
    plan: NDArray[Any], place: tuple[float, float], radius: float
) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Returns the part of the image around a place, and the x and y of its pixel centres."""
    left, top = (max(int(along - radius) - 1, 0) for along in place)
    right, bottom = (max(int(along + radius) + 2, 0) for along in place)
    window = plan[top:bottom, left:right]
    y, x = np.mgrid[0 : window.shape[0], 0 : window.shape[1]]
    return window, x + left + 0.5, y + top + 0.5


def _blend(window: NDArray[Any], cover: NDArray[Any], colour: tuple[int, ...]) -> None:
    window += cover.clip(0, 1)[..., None] * (np.array(colour) - window)
