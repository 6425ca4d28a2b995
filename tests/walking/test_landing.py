"""Feet that meet the ground sooner, later, or only for a moment; the plan of the DCM follows them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import hqp.robots
from hqp import _session
from hqp.estimation.rotations import about_vertical
from hqp.walking import Walker
from hqp.walking.swing import FALLS

DT = 0.002
STAND, SHIFT, SWING = 0, 1, 2
TAKE = _session.Walker.TAKE


class Pendulum:
    """A native walker of a robot on a linear pendulum, with soles that follow their references, on ground at 0."""

    def __init__(self, name: str, heading: float, speed: float) -> None:
        robot = hqp.robots.load(name, rotors=True)
        walker = Walker(robot, dt=DT, deadline=math.inf)
        self.omega, self.height, self.weight = walker.omega, walker.height, walker.weight
        self.native = _session.Walker(walker.tree(robot.copy()))
        self.motors = int(np.count_nonzero(robot.actuated)) if robot.actuated.dtype == bool else len(robot.actuated)
        state = robot.state(walker.start)
        self.turn = about_vertical(heading)
        self.soles = [
            [*(self.turn @ state.position(foot.frame)), *(self.turn @ state.rotation(foot.frame)).ravel()]
            for foot in walker.feet
        ]
        self.com = self.turn @ state.com()
        self.velocity, self.loads, self.path = np.zeros(3), np.full(2, 0.5 * self.weight), np.zeros(3)
        self.step()
        self.native.go((speed, 0.0, 0.0))

    @property
    def state(self) -> Any:
        return self.native.state

    @property
    def error(self) -> float:
        """Distance of the DCM from its plan [m]."""
        return float(np.linalg.norm(np.array(self.state.capture_point) - np.array(self.native.balance)[2:]))

    def step(self) -> None:
        """One tick; the ZMP leads the DCM back to its plan."""
        self.native.step_on(self.com.tolist(), self.velocity.tolist(), [tuple(sole) for sole in self.soles], self.loads)
        swings = self.state.phase == SWING
        if swings:
            pose = np.array(self.native.swing).reshape(4, 4)
            self.soles[1 - self.state.stance] = [*pose[:3, 3], *pose[:3, :3].ravel()]
            self.loads = np.where(np.arange(2) == self.state.stance, self.weight, 0.0)
        else:
            self.loads = np.array([1.0 - self.native.share, self.native.share]) * self.weight
        off = np.array(self.state.capture_point) - np.array(self.native.balance)[2:]
        zmp = np.array(self.native.balance)[:2] + 2.0 * off
        self.velocity[:2] += DT * self.omega**2 * (self.com[:2] - zmp)
        self.com[:2] += DT * self.velocity[:2]
        self.native.finish(np.zeros(self.motors), self.loads)

    def until(self, phase: int, share: float = 0.0) -> None:
        """Steps until a share of the time of a phase."""
        for _ in range(3000):
            if self.state.phase == phase and self.state.t >= share * self.state.duration:
                return
            self.step()
        raise AssertionError("the phase does not come")

    def touch(self, share: float) -> None:
        """Load on the swing foot from the next tick on."""
        self.loads[1 - self.state.stance] = share * self.weight


class Narrow(Pendulum):
    """A pendulum whose ZMP stays as near to the stance foot as G1's sole allows, over a hole: feet land at a depth."""

    depth = 0.0
    """[m]"""

    def step(self) -> None:
        velocity, com = self.velocity.copy(), self.com.copy()
        super().step()
        if self.state.phase != SWING:
            return
        stance = np.array(self.native.balance)[:2]
        off = 2.0 * (np.array(self.state.capture_point) - np.array(self.native.balance)[2:])
        zmp = stance + off * min(1.0, SOLE / max(float(np.linalg.norm(off)), 1e-9))
        self.velocity[:2] = velocity[:2] + DT * self.omega**2 * (com[:2] - zmp)
        self.com[:2] = com[:2] + DT * self.velocity[:2]
        if self.soles[1 - self.state.stance][2] < -self.depth:
            self.touch(0.2)


SOLE = 0.014
"""Largest distance of the ZMP from the middle of G1's sole, sideways [m]."""


ROBOTS = "g1", "talos"
LIMIT = 0.012
"""Largest distance of the DCM from its plan after a landing before its time; 0.015 to 0.06 without a wait [m]."""


def draws(count: int) -> list[tuple[str, float, float, float]]:
    """Robot, heading [rad], speed [m/s], landing as a share of the swing time."""
    rng = np.random.default_rng(7)
    return [
        (ROBOTS[k % 2], float(rng.uniform(-3.1, 3.1)), float(rng.uniform(0.05, 0.25)), float(rng.uniform(0.7, 1.0)))
        for k in range(count)
    ]


@pytest.mark.parametrize(("name", "heading", "speed", "share"), draws(4))
def test_a_walk_begins_with_the_dcm_on_its_plan(name: str, heading: float, speed: float, share: float) -> None:
    robot, errors = Pendulum(name, heading, speed), []
    robot.until(SHIFT)
    while robot.state.phase == SHIFT:
        robot.step()
        errors.append(robot.error)
    assert max(errors) < 2e-3


@pytest.mark.parametrize(("name", "heading", "speed", "share"), draws(6))
def test_a_foot_that_lands_early_leaves_the_dcm_on_its_plan(
    name: str, heading: float, speed: float, share: float
) -> None:
    robot, errors = Pendulum(name, heading, speed), []
    for _ in range(3):
        robot.until(SWING, share)
        before = robot.state.stance
        robot.touch(0.2)
        robot.step()
        assert (robot.state.phase, robot.state.stance) == (SHIFT, 1 - before)
        errors.append(robot.error)
    assert max(errors) < LIMIT


@pytest.mark.long
def test_a_foot_over_a_hole_follows_the_dcm() -> None:
    """Drawn holes of 45 to 60 mm: the error that is left after the landing grows with the depth."""
    left = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        robot = Narrow("g1", float(rng.uniform(-3.1, 3.1)), float(rng.uniform(0.05, 0.15)))
        for phase in (SWING, SHIFT, SWING):
            robot.until(phase)
        depth = float(rng.uniform(0.045, 0.06))
        robot.depth = depth - robot.soles[robot.state.stance][2]
        robot.until(SHIFT)
        left.append(robot.error / depth)
    assert np.mean(left) < 0.55


@pytest.mark.parametrize("seed", range(8))
def test_it_comes_to_stand_only_if_its_ankles_lead_the_dcm_back(seed: int) -> None:
    """Drawn pushes ahead or back in the last step throw the DCM out of the support: then it steps once more."""
    rng = np.random.default_rng(seed)
    name = ROBOTS[seed % 2]
    heading = float(rng.uniform(-3.1, 3.1))
    robot = Narrow(name, heading, float(rng.uniform(0.05, 0.15)))
    walker = Walker(hqp.robots.load(name, rotors=True), dt=DT, deadline=math.inf)
    for phase in (SWING, SHIFT, SWING):
        robot.until(phase)
    robot.native.stop()
    robot.until(SHIFT)
    robot.until(SWING, float(rng.uniform(0.8, 0.95)))
    angle = heading + float(rng.choice([0.0, math.pi]) + rng.uniform(-0.2, 0.2))
    robot.velocity[:2] += float(rng.uniform(0.15, 0.3)) * np.array([math.cos(angle), math.sin(angle)])
    robot.until(STAND)
    corners = []
    for pose, foot in zip(robot.soles, walker.feet, strict=True):
        place, turn = np.array(pose[:3]), np.array(pose[3:]).reshape(3, 3)
        corners += [(place + turn @ [*corner, 0.0])[:2] for corner in foot.support]
    hull = ConvexHull(np.array(corners)).equations
    assert (hull @ [*robot.state.capture_point, 1.0]).max() < 3e-3, "it stands and falls"


@pytest.mark.parametrize(("name", "heading", "speed", "share"), draws(4))
def test_a_foot_that_landed_on_air_goes_on_down(name: str, heading: float, speed: float, share: float) -> None:
    """It touches something at a height and loses it again: the other foot stands on, and the foot comes down."""
    robot = Pendulum(name, heading, speed)
    robot.until(SWING, share)
    stance, height = robot.state.stance, robot.soles[1 - robot.state.stance][2]
    robot.touch(0.2)
    robot.step()
    assert robot.state.phase == SHIFT
    lost = False
    for _ in range(200):
        if robot.state.phase == SHIFT:  # the foot sinks without load
            robot.soles[1 - stance][2] -= 3e-4
            robot.loads = np.where(np.arange(2) == stance, robot.weight, 0.0)
        robot.step()
        lost |= robot.state.phase == SWING
        assert robot.state.phase == SWING or not lost
        assert robot.state.phase == SHIFT or robot.state.stance == stance
        if lost and robot.soles[1 - stance][2] < height - 0.02:
            return
    raise AssertionError("the foot stays in the air")


@pytest.mark.parametrize("share", np.linspace(0.6, 0.98, 8))
def test_a_foot_that_was_thrown_off_the_ground_is_not_thrown_down(share: float) -> None:
    """Its swing lasts until it reaches its goal: within the planned time G1 went down at 750 m/s^2."""
    robot = Pendulum("g1", 0.3, 0.1)
    robot.until(SWING, share)
    side = 1 - robot.state.stance
    robot.touch(0.2)
    robot.step()
    robot.soles[side][0] += 6e-3
    fastest = []
    for _ in range(100):
        if robot.state.phase == SHIFT:
            robot.loads = np.where(np.arange(2) == side, 0.0, robot.weight)
        robot.step()
        if robot.state.phase == SWING:
            fastest.append(abs(robot.native.swing_acceleration[2]))
    assert max(fastest) < 2.0 * FALLS


@pytest.mark.parametrize(("name", "heading", "speed", "share"), draws(4))
def test_a_trailing_foot_that_has_left_the_ground_swings(name: str, heading: float, speed: float, share: float) -> None:
    """It is thrown off while both feet are to bear: no contact holds it, and it swings from where it is."""
    robot = Pendulum(name, heading, speed)
    robot.until(SWING, 0.95)
    trailing = robot.state.stance
    robot.touch(0.2)
    robot.step()
    for _ in range(round(share * 0.08 / DT)):
        robot.step()
    robot.soles[trailing][2] += 8e-3
    robot.loads = np.where(np.arange(2) == trailing, 0.0, robot.weight)
    robot.step()
    assert (robot.state.phase, robot.state.stance) == (SWING, 1 - trailing)
    pose = np.array(robot.native.swing).reshape(4, 4)
    assert np.linalg.norm(pose[:3, 3] - robot.soles[trailing][:3]) < 1e-3


@pytest.mark.parametrize(("name", "heading", "speed", "share"), draws(4))
def test_a_swing_foot_that_meets_a_riser_stops_without_a_jerk(
    name: str, heading: float, speed: float, share: float
) -> None:
    """It bears load and stays where it is over ground: its reference slows down instead of stopping in a tick."""
    robot = Pendulum(name, heading, speed)
    for _ in range(2):
        robot.until(SHIFT)
        robot.until(SWING)
    robot.until(SWING, 0.4 * share)
    side = 1 - robot.state.stance
    place, before = robot.soles[side][:2], np.array(robot.native.swing_velocity)
    while robot.state.t < 0.52 * robot.state.duration:
        robot.soles[side][:2] = place
        robot.touch(0.1)
        robot.step()
        after = np.array(robot.native.swing_velocity)
        assert np.linalg.norm(after - before) < max(0.1, 0.25 * np.linalg.norm(before[:2]))
        before = after
    assert np.linalg.norm(before[:2]) < 0.1


@pytest.mark.parametrize("seed", range(8))
def test_a_swing_foot_that_scuffs_for_moments_keeps_a_smooth_reference(seed: int) -> None:
    """It lags behind its path over ground and bears load in drawn ticks: each takes a quarter of its speed at most."""
    rng = np.random.default_rng(seed)
    robot = Pendulum(ROBOTS[seed % 2], float(rng.uniform(-3.1, 3.1)), float(rng.uniform(0.15, 0.3)))
    for _ in range(2):
        robot.until(SHIFT)
        robot.until(SWING)
    robot.until(SWING, 0.1)
    side, held = 1 - robot.state.stance, float(rng.uniform(0.1, 0.3))
    changes, touched = [], 0
    while robot.state.phase == SWING and robot.state.t < 0.5 * robot.state.duration:
        place, velocity = robot.soles[side][:2], np.array(robot.native.swing_velocity)[:2]
        acceleration = np.array(robot.native.swing_acceleration)[:2]
        if touches := rng.uniform() < 0.1:
            robot.touch(0.1)
        robot.step()
        robot.soles[side][:2] = np.array(place) + held * (np.array(robot.soles[side][:2]) - place)
        touched += touches
        change = np.array(robot.native.swing_velocity)[:2] - velocity
        jerk = np.array(robot.native.swing_acceleration)[:2] - acceleration
        changes.append((np.linalg.norm(change) - 0.25 * np.linalg.norm(velocity), np.linalg.norm(jerk)))
    assert touched
    assert max(change for change, _ in changes) < 0.03
    assert max(jerk for _, jerk in changes) < 3.0


def test_a_foot_that_stands_without_load_has_not_lost_the_ground() -> None:
    robot = Pendulum("g1", 0.4, 0.2)
    robot.until(SWING, 0.95)
    stance = robot.state.stance
    robot.touch(0.2)
    robot.step()
    while robot.state.t < robot.state.duration - DT:
        robot.loads = np.where(np.arange(2) == stance, robot.weight, 0.0)
        robot.step()
        assert robot.state.phase == SHIFT


def test_a_foot_that_has_landed_is_pressed_on() -> None:
    robot = Pendulum("g1", -1.0, 0.2)
    robot.until(SWING, 0.7)
    robot.touch(0.2)
    robot.step()
    shares = []
    while robot.state.phase == SHIFT:
        shares.append(robot.native.share if robot.state.stance else 1.0 - robot.native.share)
        robot.step()
    assert min(shares[round(TAKE / DT) :]) > 0.09


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("name", "speed"), [("g1", 0.25), ("talos", 0.3)])
def test_it_walks_onto_a_step_that_it_does_not_see(name: str, speed: float, seed: int) -> None:
    """A step of 30 mm at a drawn place, with noise: toes meet its riser, soles its edge."""
    course_of = pytest.importorskip("hqp.walking.course").Course
    from hqp.robots.terrain import Step

    start = float(np.random.default_rng(seed).uniform(0.3, 0.5))
    walker = Walker(hqp.robots.load(name, rotors=True), dt=DT, deadline=math.inf)
    course = course_of(walker, terrain=Step(friction=0.5, rise=0.03, start=start), seed=seed)
    walker.go(speed)
    while walker.time < 8.0 and not course.fallen:
        course.step()
    assert not course.fallen
    assert course.plant.com()[0] > start + 0.3
