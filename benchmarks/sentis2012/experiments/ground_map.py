"""A map of heights that a wheeled robot makes as it goes, from its IMU and the turning of its wheels."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec

Grid = np.ndarray[Any, np.dtype[np.intp]]


class GroundMap:
    """Ground normals under the wheels from the IMU and the wheels' own turning: no force sensor, no map given.

    The base's tilt tells how high each wheel stands over the others.  Locally the ground is a ridge,

        h(p) = g . p + f(d . p),

    p the place in the plane from odometry, g the gradient under the base at the start, d one of DIRECTIONS in the
    plane.  For every d there is a profile f: wheels on ground that is known tell the height of the base, the others
    what is new.  Where two wheels are on known ground they contradict each other by what is wrong about d, and that
    d is taken which has been contradicted least, with a preference for the direction of travel, which is all there is
    to go by until a second wheel has come to new ground.  Profiles go on as they began where no wheel has been.  All
    start anew, from the tilt at that moment, where even the best is contradicted by more than WRONG.
    """

    CELL, SPAN, REACH = 0.01, 4, 6.0  # [m], cells, [m]
    DIRECTIONS = 12
    MEMORY = 0.4
    """Length of travel over which contradictions are remembered [m]."""
    WRONG = 0.012
    """Root mean square contradiction at which a map is given up [m]."""
    PREFERENCE = 2e-3
    """Contradiction that a direction square to the travel has to make good [m]."""
    EDGE, FOUND = 0.05, 0.05
    """Least difference of slopes under the wheels that shows where an edge is, and the time to move there [s]."""
    SLOW, TIME_CONSTANT = 0.05, 0.2  # [m/s], [s]

    def __init__(self, robot: Any, period: float) -> None:
        state = robot.state()
        self._wheels = np.array([state.position(frame) for frame in robot.landmarks["wheel_contacts"]])
        self._wheels -= state.position("base")
        self._period = period
        self._place, self._velocity = np.zeros(2), np.zeros(2)
        angles = np.arange(self.DIRECTIONS) * math.pi / self.DIRECTIONS
        self._along = np.array([np.cos(angles), np.sin(angles)])
        self._rows = np.arange(self.DIRECTIONS)[:, None]
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
        deviation = places[:, 2] - where @ gradient  # of each wheel from the first plane, but for the base's height
        cells = (((where - self._origin) @ self._along).T / self.CELL + self._middle).astype(np.intp)
        if cells.min() < self.SPAN or cells.max() >= self._height.shape[1] - self.SPAN:
            self._begin(rotation, where)  # beyond the map
            return np.tile(rotation[:, 2], (3, 1))
        self._learn(cells, deviation)
        best = self._choose(moving)
        if best < 0:
            self._begin(rotation, where)
            return np.tile(rotation[:, 2], (3, 1))
        slopes = self._slopes(best, cells[best])
        self._find_back(best, cells[best], deviation, slopes)
        if np.ptp(slopes) < math.radians(1.0):
            return np.tile(rotation[:, 2], (3, 1))  # one plane: the tilt itself tells better
        normals = np.ones((3, 3))
        normals[:, :2] = -(gradient + slopes[:, None] * self._along[:, best])
        return np.asarray(normals / np.linalg.norm(normals, axis=1)[:, None])

    def _begin(self, rotation: Mat, where: Mat) -> None:
        """Know nothing but the plane that the wheels stand on."""
        self._gradient = -rotation[:2, 2] / rotation[2, 2]
        self._origin = self._place.copy()
        size = round(2.0 * self.REACH / self.CELL)
        self._middle = 0.5 * size
        self._height = np.zeros((self.DIRECTIONS, size))
        self._samples = np.ones((self.DIRECTIONS, 2))
        cells = (((where - self._origin) @ self._along).T / self.CELL + self._middle).astype(np.intp)
        self._first, self._last = cells.min(axis=1), cells.max(axis=1)
        self._contradiction = np.zeros(self.DIRECTIONS)
        self.restarts += 1

    def _learn(self, cells: Grid, deviation: Vec) -> None:
        """Height of the base by each profile, what wheels on known ground contradict, and what the others find."""
        known = (cells > self._first[:, None]) & (cells < self._last[:, None])
        unknown = ~known.any(axis=1)
        if unknown.any():  # all at the ends: the one nearest to the middle of what is known counts as known
            middle = 0.5 * (self._first + self._last)[:, None]
            nearest = np.argmin(np.abs(cells - middle), axis=1)
            known[unknown, nearest[unknown]] = True
        inside = np.clip(cells, self._first[:, None], self._last[:, None])
        says = self._height[self._rows, inside] - deviation
        count = known.sum(axis=1)
        base = np.where(known, says, 0.0).sum(axis=1) / count
        spread = np.where(known, (says - base[:, None]) ** 2, 0.0).sum(axis=1)
        # by the length travelled, so that standing still proves nothing
        share = min(1.0, self._period * math.hypot(*self._velocity) / self.MEMORY)
        several = count > 1
        self._contradiction[several] += share * (spread[several] - self._contradiction[several])
        for k, i in np.argwhere((cells >= self._last[:, None]) | (cells <= self._first[:, None])).tolist():
            if not known[k, i]:
                self._extend(k, int(cells[k, i]), float(base[k] + deviation[i]))

    def _extend(self, k: int, cell: int, new: float) -> None:
        """Take a height at or beyond an end of profile k; cells that were jumped over lie on a line."""
        end = int(cell >= self._last[k])
        ends = self._last if end else self._first
        at, profile = int(ends[k]), self._height[k]
        if cell == at:  # the mean of what the cell has seen
            self._samples[k, end] += 1.0
            profile[at] += (new - profile[at]) / self._samples[k, end]
            return
        step = 1 if end else -1
        steps = np.arange(1, abs(cell - at) + 1)
        profile[at + step * steps] = profile[at] + steps / abs(cell - at) * (new - profile[at])
        ends[k], self._samples[k, end] = cell, 1.0

    def _choose(self, moving: Vec) -> int:
        """The direction that has been contradicted least, -1 if none will do."""
        if float(self._contradiction.min()) > self.WRONG**2:
            return -1
        speed = math.hypot(*self._velocity)
        if speed > self.SLOW:
            square = 1.0 - (self._velocity @ self._along / speed) ** 2
            score = self._contradiction + self.PREFERENCE**2 * square
            best = int(np.argmin(score))
            if score[best] < score[self.direction] - 0.1 * self.PREFERENCE**2:
                self.direction = best
        return self.direction

    def _find_back(self, k: int, cells: Grid, deviation: Vec, slopes: Vec) -> None:
        """Move the place along d to where the wheels, all on known ground, contradict each other less.

        A wheel that slips or leaves the ground over an edge takes odometry off by centimetres, and with it the place
        of that edge on the way back.
        """
        if cells.min() <= self._first[k] or cells.max() >= self._last[k]:
            return
        lever = slopes - slopes.mean()
        strength = float(lever @ lever)
        if strength < self.EDGE**2:
            return
        says = self._height[k, cells] - deviation
        shift = -float((says - says.mean()) @ lever) / strength
        step = max(-self.CELL, min(self.CELL, shift)) * min(1.0, self._period / self.FOUND)
        self._place = self._place + step * self._along[:, k]

    def _slopes(self, k: int, cells: Grid) -> Vec:
        """Of profile k under the wheels ``(3,)``, over SPAN cells that are known."""
        last = np.minimum(cells + self.SPAN // 2, self._last[k])
        first = np.maximum(last - self.SPAN, self._first[k])
        last = np.minimum(first + self.SPAN, self._last[k])
        run = np.maximum(last - first, 1) * self.CELL
        return np.asarray((self._height[k, last] - self._height[k, first]) / run)
