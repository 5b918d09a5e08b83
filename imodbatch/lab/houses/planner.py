"""A way through the room that a round robot can take: a grid, A*, and a string pulled smooth."""

import heapq
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from imodbatch.lab.houses.world import House

Array = NDArray[np.float64]
ROBOT_RADIUS_M = 0.22
CELL_M = 0.05
STEP_M = 0.03
SMOOTHINGS_M = (0.3, 0.2, 0.12, 0.06)


class FreeSpace:
    """Where the robot's middle may be."""

    def __init__(self, house: House) -> None:
        half = (house.shell.half_x_m, house.shell.half_y_m)
        self.origin = -np.array(half)
        n = [int(np.ceil(2 * h / CELL_M)) for h in half]
        free = np.ones((n[1], n[0]), np.uint8)
        for placed in house.furniture:
            corners = np.round((placed.corners() - self.origin) / CELL_M * 256).astype(np.int32)
            cv2.fillConvexPoly(free, corners, 0, shift=8)
        for target in house.targets:
            if target.place < 0:
                at = np.round((target.world_from_object[:2, 3] - self.origin) / CELL_M).astype(int)
                radius = int(np.ceil(target.radius_m / CELL_M))
                cv2.circle(free, (int(at[0]), int(at[1])), radius, 0, -1)
        bordered = np.pad(free, 1)
        distance = cv2.distanceTransform(bordered, cv2.DIST_L2, 5)[1:-1, 1:-1]
        self.clearance_m = np.asarray(distance, np.float64) * CELL_M
        passable = (self.clearance_m > ROBOT_RADIUS_M + 1.5 * CELL_M).astype(np.uint8)
        _, labels, stats, _ = cv2.connectedComponentsWithStats(passable, connectivity=4)
        largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
        self.passable = labels == largest
        rows, columns = np.nonzero(self.passable)
        self.points = (np.stack([columns, rows], axis=-1) + 0.5) * CELL_M + self.origin

    def nearest(self, point: Array) -> Array:
        """The free place (2,) nearest to a point."""
        away = np.linalg.norm(self.points - point, axis=1)
        return np.asarray(self.points[int(np.argmin(away))])

    def clearance_at(self, points: Array) -> Array:
        """Distance (...,) in metres from the nearest obstacle; 0 outside the room."""
        column, row = np.moveaxis(np.floor((points - self.origin) / CELL_M).astype(int), -1, 0)
        height, width = self.clearance_m.shape
        inside = (column >= 0) & (row >= 0) & (column < width) & (row < height)
        row, column = np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)
        return np.where(inside, self.clearance_m[row, column], 0.0)

    def path(self, stops: list[Array]) -> Array:
        """A smooth way (P, 2) in equal steps that passes by free stops."""
        legs = [self._leg(a, b) for a, b in pairwise(stops)]
        rough = evenly(np.concatenate(legs), STEP_M)
        for sigma_m in SMOOTHINGS_M:
            smooth = evenly(smoothed(rough, sigma_m / STEP_M), STEP_M)
            if (self.clearance_at(smooth) > ROBOT_RADIUS_M + CELL_M).all():
                return smooth
        return rough

    def _leg(self, start: Array, end: Array) -> Array:
        """A* on the grid, (P, 2)."""
        first, last = self._cell(start), self._cell(end)
        height, width = self.passable.shape
        cost = {first: 0.0}
        came: dict[tuple[int, int], tuple[int, int]] = {}
        heap = [(0.0, first)]
        while heap:
            _, cell = heapq.heappop(heap)
            if cell == last:
                break
            for dr, dc in ((0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
                row, column = cell[0] + dr, cell[1] + dc
                if not (0 <= row < height and 0 <= column < width and self.passable[row, column]):
                    continue
                narrow = max(0.0, 0.45 - float(self.clearance_m[row, column]))
                total = cost[cell] + float(np.hypot(dr, dc)) * (1 + 4 * narrow)
                if total < cost.get((row, column), np.inf):
                    cost[row, column] = total
                    came[row, column] = cell
                    ahead = float(np.hypot(row - last[0], column - last[1]))
                    heapq.heappush(heap, (total + ahead, (row, column)))
        cells = [last]
        while cells[-1] != first:
            cells.append(came[cells[-1]])
        places = np.array(cells[::-1], np.float64)[:, ::-1]
        return np.asarray((places + 0.5) * CELL_M + self.origin)

    def _cell(self, point: Array) -> tuple[int, int]:
        column, row = np.floor((self.nearest(point) - self.origin) / CELL_M).astype(int)
        return int(row), int(column)


def smoothed(values: Array, sigma: float) -> Array:
    """Rows (P, D) averaged with their neighbours; the ends stay where they are."""
    if sigma <= 0 or len(values) < 3:
        return values
    reach = int(np.ceil(3 * sigma))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    kernel /= kernel.sum()
    # Mirrored through the end points, so that these do not move.
    k = np.minimum(np.arange(1, reach + 1), len(values) - 1)
    before, after = 2 * values[0] - values[k[::-1]], 2 * values[-1] - values[-1 - k]
    padded = np.concatenate([before, values, after])
    columns = [np.convolve(column, kernel, mode="valid") for column in padded.T]
    return np.stack(columns, axis=-1)


def evenly(points: Array, step: float) -> Array:
    """Points (P, 2) of a line in steps of equal length, both ends kept."""
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    kept = np.concatenate([[True], np.diff(length) > 1e-9])
    points, length = points[kept], length[kept]
    at = np.linspace(0, length[-1], max(2, round(length[-1] / step) + 1))
    return np.stack([np.interp(at, length, column) for column in points.T], axis=-1)
