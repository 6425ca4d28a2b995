"""Rotate the whole scene about the vertical, by 36 headings and by whole turns: results rotate, no other change."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import hqp
from hqp.angles import wrapped
from hqp.estimation import FeetEstimator
from hqp.estimation.rotations import about_vertical, quaternion_of, rotation_of
from hqp.motion import Motion, retarget
from hqp.tasks import Orientation, Pose
from hqp.teleoperation import Follow
from hqp.walking import Command, Foothold, Footsteps, Landing, Reach, Swing, Walker, adjust
from hqp.walking.footsteps import LEFT, RIGHT
from hqp.walking.plan import advance
from tests.motion.people import walk

HEADINGS = [math.radians(10.0 * k) for k in range(36)]
TURNS = [math.tau * k for k in (-2, -1, 1, 2)]
STEPS = Footsteps(period=0.75, width=0.17, reach=Reach(forward=0.3, least=0.12, most=0.35, turn=0.4))


def turned(q: Any, heading: float) -> Any:
    """Rotate the base of a configuration about the world's vertical axis."""
    R = about_vertical(heading)
    return np.concatenate((R @ q[:3], quaternion_of(R @ rotation_of(q[3:7])), q[7:]))


def test_angles_differ_by_less_than_half_a_turn() -> None:
    for angle in (-math.pi, -3.0, 0.0, 1.0, 3.1, math.pi):
        for whole in (0.0, *TURNS):
            assert math.cos(wrapped(angle + whole)) == pytest.approx(math.cos(angle), abs=1e-12)
            assert abs(wrapped(angle + whole)) <= math.pi
    assert math.isnan(wrapped(math.inf))
    assert math.isnan(wrapped(math.nan))


@pytest.mark.parametrize("whole", [0.0, *TURNS])
def test_steps_and_landings_turn_with_the_stance_foot(whole: float) -> None:
    """A foot's yaw is measured within half a turn; the plan's yaw is continuous."""
    for heading in HEADINGS:
        R = about_vertical(heading)[:2, :2]
        for side in (LEFT, RIGHT):
            found = []
            for turn, plane in ((0.0, np.eye(2)), (heading + whole, R)):
                stance = Foothold(side, *(plane @ [0.3, -0.1]).tolist(), 0.0, turn + 0.5)
                foot = STEPS.next(stance, Command(0.1, 0.02, 0.3))
                plan = Landing(stance=stance, foothold=foot, offset=plane @ [0.02, 0.05], left=0.3)
                moved, left = adjust(
                    plan, STEPS, plane @ [0.02, 0.04], plane @ [0.0, 0.01], 3.4, now=foot.xy, soonest=0.08,
                    latest=0.6, usual=0.3, speed=10.0,
                )  # fmt: skip
                folded = STEPS.within(Foothold(1 - side, foot.x, foot.y, 0.0, wrapped(foot.yaw)), stance)
                assert wrapped(folded.yaw - foot.yaw) == pytest.approx(0.0, abs=1e-9)
                found.append([*(plane.T @ moved.xy), wrapped(moved.yaw - turn), left])
            np.testing.assert_allclose(found[1], found[0], atol=1e-9)


@pytest.mark.parametrize("whole", [0.0, *TURNS])
def test_a_foot_in_the_air_turns_the_shorter_way(whole: float) -> None:
    for heading in HEADINGS:
        start = wrapped(heading)
        swing = Swing(np.array([0.0, 0.0, 0.0, start]), np.array([0.1, 0.0, 0.0, heading + whole + 0.2]), 0.5, 0.05)
        yaws = []
        for k in range(250):
            yaws.append(swing.step(0.002)[0][3] - start)
            if k == 100:
                swing.retarget(np.array([0.1, 0.0, 0.0, heading - whole + 0.25]), 1.0, 1.0)
        assert min(yaws) > -1e-9
        assert max(yaws) < 0.2501
        assert yaws[-1] == pytest.approx(0.25, abs=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("whole", [0.0, *TURNS])
def test_what_an_operator_turns_is_followed_the_shorter_way(whole: float) -> None:
    """A hand that turns by 0.5 rad/s through half a turn, as an angle, a rotation and a pose."""
    robot = hqp.robots.load("cbi")
    frame = robot.landmarks["hands"][0] if "hands" in robot.landmarks else robot.frame_names[-1]
    tasks = (Orientation(frame=frame, axes="yaw"), Orientation(frame=frame), Pose(frame=frame))
    for heading in HEADINGS[::6] if whole else HEADINGS:
        state = robot.state(turned(robot.home, heading))
        for task in tasks:
            follow = Follow(task)
            start = np.array(task.value(state))
            before, speeds = start, []
            for k in range(60):
                t, turn = 0.02 * k, 0.01 * k
                value = start.copy()
                if value.ndim == 1:
                    value = np.array([wrapped(float(start[0]) + turn) + whole])
                else:
                    value[:3, :3] = about_vertical(turn) @ start[:3, :3]
                follow.receive(value, sent=t, received=t)
                found = np.array(follow.reference(state, now=t).value)
                if value.ndim == 1:
                    speeds.append(abs(wrapped(float(found[0] - before[0]))) / 0.02)
                else:
                    between = found[:3, :3] @ before[:3, :3].T
                    speeds.append(math.acos(min(1.0, 0.5 * (np.trace(between) - 1.0))) / 0.02)
                before = found
            assert max(speeds) < 1.2, (task.name, heading)
            assert speeds[-1] == pytest.approx(0.5, abs=0.05)


def test_an_estimate_turns_with_the_robot() -> None:
    """Feet that twist on the ground and an IMU that drifts cause equal errors at every heading."""
    robot = hqp.robots.load("g1")
    soles, found = robot.landmarks["soles"], []
    for heading in HEADINGS:
        q = turned(robot.home, heading)
        estimator = FeetEstimator(robot, soles, 0.01, q)
        v = np.zeros(robot.nv)
        v[5] = 0.2
        angles = q.copy()
        for k in range(30):
            angles[7:] = q[7:] + 0.001 * k
            at, rates = estimator.update(angles, v, np.array([0.0, 0.1, 9.81]), np.array([200.0, 120.0]))
        found.append(np.concatenate((turned(at, -heading), rates)))
        found[-1][3:7] *= math.copysign(1.0, found[-1][6])
    np.testing.assert_allclose(found, [found[0]] * len(found), atol=1e-9)


def walked(heading: float, seconds: float, turn: float) -> Any:
    """Torques of G1's walker with its model integrated, from a rotated start ``(T, n)``."""
    walker = Walker(hqp.robots.load("g1", rotors=True), deadline=math.inf)
    walker.go(0.1, 0.0, turn)
    q, v, sent = turned(walker.start, heading), np.zeros(walker.robot.nv), []
    for _ in range(round(seconds / walker.dt)):
        q, v, tick = advance(walker, q, v)
        sent.append(tick.command.copy())
    return np.array(sent)


@pytest.mark.long
def test_a_walk_does_not_know_its_heading() -> None:
    """Walk with a heading near half a turn, where the measured yaw changes its sign."""
    one, other = walked(0.0, 2.2, 0.3), walked(math.pi, 2.2, 0.3)
    assert np.abs(one - other).max() < 1e-6


@pytest.mark.slow
def test_a_walk_does_not_know_any_heading() -> None:
    one = walked(0.0, 3.0, 0.3)
    for heading in HEADINGS[1:]:
        assert np.abs(one - walked(heading, 3.0, 0.3)).max() < 1e-6, heading


@pytest.mark.slow
def test_a_walk_turns_twice() -> None:
    """No tick changes torques by more than the first steps did."""
    sent = walked(0.0, 2.0 * math.tau / 0.35 + 4.0, 0.35)
    changes = np.abs(np.diff(sent, axis=0)).max(axis=1)
    assert changes[2000:].max() < 1.5 * changes[:2000].max()


@pytest.mark.long
@pytest.mark.parametrize("heading", [math.pi, pytest.param(None, marks=pytest.mark.slow)])
def test_a_clip_is_retargeted_whatever_its_heading(heading: float | None) -> None:
    motion, robot = walk(0.6), hqp.robots.load("g1")
    found = retarget(motion, robot)
    for angle in HEADINGS[1:] if heading is None else [heading]:
        other = retarget(
            Motion(motion.names, motion.positions @ about_vertical(angle).T, motion.fps, motion.parents), robot
        )
        np.testing.assert_allclose(other.q[:, 7:], found.q[:, 7:], atol=1e-6)
