"""Release a foot in MuJoCo, lift it, put it down and reattach it: no jump, and no other motion.

Every foot's moment about its normal is bounded: a foot with a load of 12 N got a moment of 1 N m, slipped, and G1 fell.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

import hqp
from hqp import PD, Level, Stack
from hqp.arrays import Vec
from hqp.declare.reference import Reference
from hqp.loop.tick import Tick
from hqp.robots import Robot
from hqp.tasks import CenterOfPressure, Com, FrictionCone, Orientation, Pose, Position, Posture
from tests.scenes.calm.walking import SOLES
from tests.scenes.changes import DT, lifted, smooth
from tests.scenes.changes import stack as stack_of

CHANGE = 3.0
"""Largest change of a torque in a tick during the weight shift, the release and the reattachment [N m]."""

SOFT = PD(40.0, 12.0)
TORSION = 0.03
"""|m_z| / f_z of a foot [m]."""
Goals = Callable[[float], Sequence[Reference]]


class Walk:
    """A session at torque level and a plant; feedback on the feet is soft because the ground is not rigid."""

    def __init__(self, robot: Robot) -> None:
        from hqp.robots.on_mujoco import Plant

        self.left, self.right = robot.landmarks["soles"]
        low, high, *sides = SOLES[robot.name]
        middle = 0.5 * (low + high)
        inner = (middle + 0.6 * (low - middle), middle + 0.6 * (high - middle), *(0.6 * side for side in sides))
        limits = [
            replace(e, torsion=TORSION) if isinstance(e, FrictionCone) else e
            for e in stack_of(robot, "torque").subject_to
        ]
        self.com, self.foot = Com(name="com", law=SOFT), Pose(frame=self.right, name="swing")
        self.below = (
            Level(Position(frame=robot.landmarks["palms"][1], name="hand", law=SOFT)),
            Level(Orientation(frame=robot.landmarks["base"][0], name="trunk", law=SOFT)),
            Level(Posture(law=SOFT)),
        )
        within = [CenterOfPressure(contact=frame, rectangle=inner) for frame in (self.left, self.right)]
        self.whole = Stack(Level(self.com), *self.below, subject_to=[*limits, *within])
        self.robot, self.plant = robot, Plant(robot)
        controller = hqp.Controller(self.whole, hqp.Torque(contact_law=PD(0.0, 15.0)), deadline=np.inf)
        self.run = controller.session(robot, DT)
        self.q, self.v = self.plant.reset(robot.home.copy())
        start = robot.state(self.q, self.v)
        self.start, sole = start.com(), start.rotation(self.left) @ [middle, 0.0, 0.0] + start.position(self.left)
        self.over = np.array([*sole[:2], 0.97 * self.start[2]])
        self.places: list[Vec] = []
        self.ticks: list[Tick] = []

    def go(self, seconds: float, goals: Goals, *, until: Callable[[], bool] = lambda: False) -> slice:
        """Run for a time [s], or until a condition holds; return the ticks."""
        first, ticks = len(self.ticks), round(seconds / DT)
        for k in range(ticks):
            tick = self.run.step(self.robot.state(self.q, self.v), *goals(k / ticks))
            self.plant.step(tick.command, steps=round(DT / self.plant.timestep))
            self.q, self.v = self.plant.state()
            places = (self.plant.com(), self.plant.place(self.left)[0], self.plant.place(self.right)[0])
            self.places.append(np.concatenate(places))
            self.ticks.append(tick)
            if until():
                break
        return slice(first, len(self.ticks))

    def change(self, stack: Stack, goals: Goals) -> slice:
        """Return the ticks of a transition."""
        self.run.change(stack, 0.25)
        return self.go(1.0, goals, until=lambda: self.ticks[-1].transition >= 1.0)

    def moved(self, ticks: slice) -> Vec:
        """Displacement of the CoM, the left and the right sole [m]."""
        return np.ptp(np.array(self.places[ticks]).reshape(-1, 3, 3), axis=0).max(axis=1)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["talos", "g1", "cbi"])
def test_a_foot_is_released_and_taken_up_in_mujoco(name: str) -> None:
    pytest.importorskip("mujoco")
    walk = Walk(hqp.robots.load(name))
    com, foot = walk.com, walk.foot
    walk.go(0.5, lambda _: [com.at(walk.start)])
    walk.go(1.5, lambda s: [com.at((1.0 - smooth(s)) * walk.start + smooth(s) * walk.over)])
    walk.go(1.0, lambda _: [com.at(walk.over)])
    state = walk.robot.state(walk.q, walk.v)
    place, turned = state.position(walk.right), state.rotation(walk.right)

    def high(height: float) -> list[Reference]:
        return [com.at(walk.over), foot.at((place + [0.0, 0.0, height], turned))]

    rest = lifted(walk.whole, walk.robot)
    one_leg = Stack(Level(com), Level(foot), *walk.below, subject_to=rest.subject_to)
    released = walk.change(one_leg, lambda _: high(0.0))
    walk.go(1.0, lambda s: high(0.04 * smooth(s)))
    stood = walk.go(0.5, lambda _: high(0.04))
    walk.go(1.0, lambda s: high(0.04 * (1.0 - smooth(s))))
    walk.go(0.3, lambda _: high(0.0))
    taken = walk.change(walk.whole, lambda _: [com.at(walk.over)])
    heights = np.array(walk.places)[:, 8]
    assert heights[stood].mean() - heights[released][0] > 0.03
    for what in (released, taken):
        ticks = walk.ticks[what]
        assert ticks[-1].transition == 1.0
        assert len(ticks) <= 200
        assert all(tick.status.solved for tick in ticks)  # clipped to the bound of a transition, with a note
        sent = [tick.command for tick in walk.ticks[what.start - 1 : what.stop]]
        assert np.abs(np.diff(sent, axis=0)).max() <= CHANGE
        moved = walk.moved(what)
        assert moved[0] < 1e-3  # the CoM
        assert moved[1] < 1e-3  # the stance foot
    assert walk.moved(stood)[:2].max() < 1e-3
    back = walk.go(1.5, lambda s: [com.at((1.0 - smooth(s)) * walk.over + smooth(s) * walk.start)])
    walk.go(1.0, lambda _: [com.at(walk.start)])
    sent = [tick.command for tick in walk.ticks[back.start :]]
    assert np.abs(np.diff(sent, axis=0)).max() <= CHANGE
    assert np.abs(walk.places[-1][:3] - walk.start).max() < 1e-3
