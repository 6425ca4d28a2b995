"""A swing foot that touches the ground on its way has scuffed, not landed: it rises and continues."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("mujoco")

import hqp
from hqp.walking import Foothold
from hqp.walking.course import Course
from hqp.walking.swing import Swing
from hqp.walking.walker import Walker


@pytest.mark.long
def test_a_foot_pushed_to_the_ground_lands_where_it_was_to_land() -> None:
    robot = hqp.robots.load("g1", rotors=True)
    walker = Walker(robot, deadline=math.inf)
    course = Course(walker, sensors=None, delay=0.0)
    walker.go(0.3)
    steps, touched, off = 0, 0, []
    while walker.time < 5.5 and not course.fallen:
        side, swings = 1 - walker.stance, walker.phase == "swing"
        down = (
            swings
            and steps == 4
            and 0.65 * walker._state.duration < walker._state.t < 0.65 * walker._state.duration + 0.05
        )
        if down:
            course.plant.push(walker.feet[side].frame, np.array([0.0, 0.0, -250.0]))
        course.step()
        touched += down and bool(course.plant.measure().contacts.load[side] > 0.05 * walker.weight)
        if swings and walker.phase != "swing":
            hold = walker.holds[side]
            off.append(math.dist(hold.xy, Foothold(*walker._state.target).xy))
            steps += 1
    assert touched, "the foot never met the ground: the test would show nothing"
    assert not course.fallen
    assert len(off) >= 6
    assert max(off) < 0.04


def test_a_path_that_is_cleared_rises_smoothly_and_ends_at_its_goal() -> None:
    start, goal = np.array([0.0, 0.1, 0.0, 0.0]), np.array([0.3, 0.1, 0.0, 0.0])
    swing, dt = Swing(start, goal, 0.9, 0.05), 0.002
    heights, speeds = [], []
    while swing.left > dt:
        if abs(swing.time - 0.58) < 0.5 * dt:
            assert swing.clear(0.01)
        x, v, _ = swing.step(dt)
        heights.append(x[2])
        speeds.append(v[2])
    after = heights[round(0.58 / dt) :]
    assert max(after) > 0.05
    assert abs(heights[-1]) < 5e-3
    assert np.abs(np.diff(speeds)).max() < 0.12
    np.testing.assert_allclose(np.gradient(heights, dt)[1:-1], speeds[1:-1], atol=0.03)


def test_a_path_without_time_to_rise_goes_on() -> None:
    swing = Swing(np.zeros(4), np.array([0.3, 0.1, 0.0, 0.0]), 0.5, 0.05)
    while swing.left > 0.1:
        swing.step(0.002)
    before = swing.step(0.002)[0][2]
    assert not swing.clear(0.01)
    assert swing.step(0.002)[0][2] < before
