"""Height map that a wheeled robot builds during motion, from its IMU and the rotation of its wheels."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec

Grid = np.ndarray[Any, np.dtype[np.intp]]


class GroundMap:
    """Ground normals under the wheels from the IMU and wheel odometry, without force sensors or a given map.

    The base's tilt gives the height of each wheel over the others.  Locally the ground is a ridge,

        h(p) = g . p + f(d . p),

    p the place in the plane from odometry, g the gradient under the base at the start, d one of DIRECTIONS in the
    plane.  Every d has a profile f: wheels on known ground determine the height of the base, the other wheels extend
    the profile.  Two wheels on known ground contradict each other if d is wrong.  The map takes the d with the least
    contradiction, with a preference for the direction of travel, the only cue until a second wheel reaches new ground.
    Beyond the wheels' path, profiles extend linearly.  All profiles restart from the present tilt if the contradiction
    of the best exceeds WRONG.
    """

    CELL, SPAN, REACH = 0.01, 4, 6.0  # [m], cells, [m]
    DIRECTIONS = 12
    MEMORY = 0.4
    """Length of travel over which contradictions are averaged [m]."""
    WRONG = 0.012
    """Root mean square contradiction above which the map restarts [m]."""
    PREFERENCE = 2e-3
    """Penalty of a direction normal to the travel, as a contradiction [m]."""
    EDGE, FOUND = 0.05, 0.05
    """Least difference of slopes under the wheels that locates an edge, and time constant of the correction [s]."""
    SLOW, TIME_CONSTANT = 0.05, 0.2  # [m/s], [s]
    LEVEL = math.radians(1.0)
    """Difference of slopes under the wheels below which they share a plane."""

    def __init__(self, robot: Any, period: float) -> None:
        state = robot.state()
        self._wheels = np.array([state.position(frame) for frame in robot.landmarks["wheel_contacts"]])
        self._wheels -= state.position("base")
        self._period = period
        self._place, self._velocity = np.zeros(2), np.zeros(2)
        angles = np.arange(self.DIRECTIONS) * math.pi / self.DIRECTIONS
        self._along = np.array([np.cos(angles), np.sin(angles)])
        self._gradient: Vec | None = None
        self.restarts = -1
        self.direction = 0

    def update(self, rotation: Mat, velocity: Vec) -> Mat:
        """Unit normals ``(3, 3)``, world axes, for the base's rotation and its velocity in its own axes [m/s]."""
        moving = (rotation @ velocity)[:2]
        self._place = self._place + self._period * moving
        self._velocity += self._period / self.TIME_CONSTANT * (moving - self._velocity)
        places = self._wheels @ rotation.T
        where = self._place + places[:, :2]
        if self._gradient is None:
            self._begin(rotation, where)
        gradient = self._gradient
        assert gradient is not None
        deviation = places[:, 2] - where @ gradient  # heights over the first plane, up to the base's height
        numbers = self._cells(where)
        if numbers.min() < self.SPAN or numbers.max() >= self._size - self.SPAN:
            self._begin(rotation, where)  # beyond the map
            return self._one_plane(rotation)
        cells, heights = numbers.tolist(), deviation.tolist()
        self._learn(cells, heights)
        best = self._choose()
        if best < 0:
            self._begin(rotation, where)
            return self._one_plane(rotation)
        slopes = self._slopes(best, cells[best])
        self._find_back(best, cells[best], heights, slopes)
        if max(slopes) - min(slopes) < self.LEVEL:
            return self._one_plane(rotation)  # the tilt itself is more accurate
        normals = np.ones((3, 3))
        normals[:, :2] = -(gradient + np.array(slopes)[:, None] * self._along[:, best])
        return np.asarray(normals / np.linalg.norm(normals, axis=1)[:, None])

    def _cells(self, where: Mat) -> Grid:
        """Cells of the wheels in every profile ``(DIRECTIONS, 3)``."""
        found: Grid = (((where - self._origin) @ self._along).T / self.CELL + self._middle).astype(np.intp)
        return found

    @staticmethod
    def _one_plane(rotation: Mat) -> Mat:
        normals = np.empty((3, 3))
        normals[:] = rotation[:, 2]
        return normals

    def _begin(self, rotation: Mat, where: Mat) -> None:
        """Restart from the plane under the wheels."""
        self._gradient = -rotation[:2, 2] / rotation[2, 2]
        self._origin = self._place.copy()
        self._size = round(2.0 * self.REACH / self.CELL)
        self._middle = 0.5 * self._size
        # lists: faster than arrays for three numbers at a time
        self._height = [[0.0] * self._size for _ in range(self.DIRECTIONS)]
        self._samples = [[1.0, 1.0] for _ in range(self.DIRECTIONS)]
        cells = self._cells(where)
        self._ends: list[list[int]] = np.array([cells.min(axis=1), cells.max(axis=1)]).T.tolist()
        self._contradiction = [0.0] * self.DIRECTIONS
        self.restarts += 1

    def _learn(self, cells: list[list[int]], deviation: list[float]) -> None:
        """Estimate the base's height by each profile, update contradictions of known ground, extend to new ground."""
        # by the length travelled, so that standing still proves nothing
        share = min(1.0, self._period * math.hypot(*self._velocity) / self.MEMORY)
        for k, (ends, wheels, profile) in enumerate(zip(self._ends, cells, self._height, strict=True)):
            first, last = ends
            known = [i for i, cell in enumerate(wheels) if first < cell < last]
            if not known:  # all at the ends: the wheel nearest to the middle of the known part counts as known
                middle = 0.5 * (first + last)
                known = [min(range(3), key=lambda i: abs(wheels[i] - middle))]
            says = [profile[min(max(wheels[i], first), last)] - deviation[i] for i in known]
            base = sum(says) / len(says)
            if len(says) > 1:
                spread = sum([(height - base) * (height - base) for height in says])
                self._contradiction[k] += share * (spread - self._contradiction[k])
            if len(known) < 3:
                for i, cell in enumerate(wheels):
                    if i not in known and not ends[0] < cell < ends[1]:
                        self._extend(k, cell, base + deviation[i])

    def _extend(self, k: int, cell: int, new: float) -> None:
        """Set a height at or beyond an end of profile k; interpolate skipped cells linearly."""
        ends, profile = self._ends[k], self._height[k]
        end = int(cell >= ends[1])
        at = ends[end]
        if cell == at:  # the mean over samples of the cell
            self._samples[k][end] += 1.0
            profile[at] += (new - profile[at]) / self._samples[k][end]
            return
        step, jump, start = (1 if end else -1), abs(cell - at), profile[at]
        for i in range(1, jump + 1):
            profile[at + step * i] = start + i / jump * (new - start)
        ends[end], self._samples[k][end] = cell, 1.0

    def _choose(self) -> int:
        """Direction with the least contradiction, -1 if all exceed WRONG."""
        if min(self._contradiction) > self.WRONG**2:
            return -1
        speed = math.hypot(*self._velocity)
        if speed > self.SLOW:
            square = 1.0 - (self._velocity @ self._along / speed) ** 2
            score = self._contradiction + self.PREFERENCE**2 * square
            best = int(np.argmin(score))
            if score[best] < score[self.direction] - 0.1 * self.PREFERENCE**2:
                self.direction = best
        return self.direction

    def _find_back(self, k: int, cells: list[int], deviation: list[float], slopes: list[float]) -> None:
        """Move the place along d so that the wheels, all on known ground, contradict each other less.

        A wheel that slips or leaves the ground over an edge shifts odometry by centimetres, and with it the place of
        that edge on the way back.
        """
        first, last = self._ends[k]
        if min(cells) <= first or max(cells) >= last:
            return
        middle = sum(slopes) / 3.0
        lever = [slope - middle for slope in slopes]
        strength = sum([x * x for x in lever])
        if strength < self.EDGE**2:
            return
        says = [self._height[k][cell] - height for cell, height in zip(cells, deviation, strict=True)]
        mean = sum(says) / 3.0
        shift = -sum([(height - mean) * x for height, x in zip(says, lever, strict=True)]) / strength
        step = max(-self.CELL, min(self.CELL, shift)) * min(1.0, self._period / self.FOUND)
        self._place = self._place + step * self._along[:, k]

    def _slopes(self, k: int, cells: list[int]) -> list[float]:
        """Slopes of profile k under the wheels, over SPAN known cells."""
        (first, last), profile, found = self._ends[k], self._height[k], []
        for cell in cells:
            high = min(cell + self.SPAN // 2, last)
            low = max(high - self.SPAN, first)
            high = min(low + self.SPAN, last)
            found.append((profile[high] - profile[low]) / (max(high - low, 1) * self.CELL))
        return found
