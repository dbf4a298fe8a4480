"""An agent that explores the nearest unseen area, on a map from depth and pose; it ignores the goals.

python examples/frontier.py --token TOKEN
"""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np
from shell import main

import avln

if TYPE_CHECKING:
    from numpy.typing import NDArray

CELL_M = 0.1
SIDE_CELLS = 600
UNKNOWN, FREE, BLOCKED = 0, 1, 2
LOW_M, HIGH_M = 0.15, 1.4
"""Height range of obstacles above the base."""
REACH_CELLS = 2
NEIGHBOURS = [(-1, 0), (1, 0), (0, -1), (0, 1)]
Cell = tuple[int, int]


class Map:
    """A grid of 10 cm cells around the start: rows in +Z, columns in +X."""

    def __init__(self, task: avln.TaskSpec) -> None:
        self.task = task
        self.cells = np.zeros((SIDE_CELLS, SIDE_CELLS), np.uint8)
        focal = task.width / 2 / math.tan(task.hfov_rad / 2)
        self.right = (np.arange(task.width) + 0.5 - task.width / 2) / focal
        self.down = (np.arange(task.height) + 0.5 - task.height / 2) / focal

    def cell(self, x_m: float, z_m: float) -> Cell:
        """Returns the cell of a position."""
        middle = SIDE_CELLS // 2
        return round(z_m / CELL_M) + middle, round(x_m / CELL_M) + middle

    def see(self, pose: avln.Pose, depth: NDArray[np.float32]) -> None:
        """Updates the map from depth: free on the ray, blocked at hits within body height."""
        height_m = self.task.camera_height_m - self.down[:, None] * depth
        is_obstacle = (depth > 0) & (height_m > LOW_M) & (height_m < HIGH_M)
        near_m = np.where(is_obstacle, depth, np.inf).min(axis=0)
        floor_m = np.where((depth > 0) & (height_m <= LOW_M), depth, 0).max(axis=0)
        free_m = np.minimum(near_m - CELL_M, np.maximum(floor_m, 1.0))
        for share in np.linspace(0, 1, 64):
            self._mark(pose, self.right, share * free_m, FREE)
        hit = np.isfinite(near_m)
        self._mark(pose, self.right[hit], near_m[hit], BLOCKED)
        self.cells[self.cell(pose.x_m, pose.z_m)] = FREE

    def _mark(
        self, pose: avln.Pose, right: NDArray[np.floating[Any]], ahead_m: NDArray[np.floating], what: int
    ) -> None:
        sine, cosine = math.sin(pose.heading_rad), math.cos(pose.heading_rad)
        aside_m = right * ahead_m
        x_m = pose.x_m + cosine * aside_m - sine * ahead_m
        z_m = pose.z_m - sine * aside_m - cosine * ahead_m
        rows = np.clip(np.rint(z_m / CELL_M) + SIDE_CELLS // 2, 0, SIDE_CELLS - 1).astype(np.intp)
        columns = np.clip(np.rint(x_m / CELL_M) + SIDE_CELLS // 2, 0, SIDE_CELLS - 1).astype(np.intp)
        here = self.cells[rows, columns]
        self.cells[rows, columns] = np.where((what == FREE) & (here == BLOCKED), here, what)

    def path_to_frontier(self, start: Cell) -> list[Cell]:
        """Returns the shortest path over free cells to an unknown cell; empty if there is none."""
        came_from: dict[Cell, Cell] = {start: start}
        queue = deque([start])
        while queue:
            cell = queue.popleft()
            for row, column in NEIGHBOURS:
                beside = cell[0] + row, cell[1] + column
                if not (0 <= beside[0] < SIDE_CELLS and 0 <= beside[1] < SIDE_CELLS):
                    continue
                if self.cells[beside] == UNKNOWN and cell != start:
                    return _way(came_from, cell)
                if beside not in came_from and self.cells[beside] == FREE:
                    came_from[beside] = cell
                    queue.append(beside)
        return []


def _way(came_from: dict[Cell, Cell], cell: Cell) -> list[Cell]:
    way = [cell]
    while came_from[cell] != cell:
        cell = came_from[cell]
        way.append(cell)
    return way[::-1]


class Frontier:
    """An agent that explores the nearest unseen area."""

    sensors = avln.Sensors(rgb=False, audio=False, width=64, height=64)

    def begin(self, task: avln.TaskSpec, mission: avln.Mission) -> None:
        """Resets the map for an episode."""
        self.map = Map(task)
        self.turn_rad = task.turn_rad
        self.last: tuple[avln.Action, avln.Pose] | None = None

    def act(self, seen: avln.Observation) -> avln.Action:
        """Takes a step on the path to the nearest frontier."""
        assert seen.depth is not None
        if seen.remaining_steps == 1:
            return avln.Action.STOP
        self.note_bump(seen.pose)
        self.map.see(seen.pose, seen.depth)
        action = self.follow(seen.pose)
        self.last = (action, seen.pose)
        return action

    def note_bump(self, pose: avln.Pose) -> None:
        """Marks the obstacle after a blocked step."""
        if self.last is None or self.last[0] is not avln.Action.MOVE_FORWARD:
            return
        before = self.last[1]
        if math.hypot(pose.x_m - before.x_m, pose.z_m - before.z_m) < CELL_M:
            ahead = 2 * CELL_M
            x_m, z_m = -ahead * math.sin(pose.heading_rad), -ahead * math.cos(pose.heading_rad)
            self.map.cells[self.map.cell(pose.x_m + x_m, pose.z_m + z_m)] = BLOCKED

    def follow(self, pose: avln.Pose) -> avln.Action:
        """Returns a turn or move towards the frontier; without a path, a turn."""
        here = self.map.cell(pose.x_m, pose.z_m)
        way = self.map.path_to_frontier(here)
        if not way:
            return avln.Action.TURN_RIGHT
        row, column = way[min(REACH_CELLS, len(way) - 1)]
        wanted_rad = math.atan2(-(column - here[1]), -(row - here[0]))
        off_rad = math.remainder(wanted_rad - pose.heading_rad, 2 * math.pi)
        if abs(off_rad) <= self.turn_rad:
            return avln.Action.MOVE_FORWARD
        return avln.Action.TURN_LEFT if off_rad > 0 else avln.Action.TURN_RIGHT


if __name__ == "__main__":
    main(Frontier)
