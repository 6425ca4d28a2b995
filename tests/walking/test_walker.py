"""Robots that walk in MuJoCo under torque control, on estimated states."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco")

import hqp.robots
from hqp.errors import DeclarationError
from hqp.robots.on_mujoco import Plant, Servo, Tiles
from hqp.walking import Foothold, Gait, Walker
from hqp.walking.course import Course
from hqp.walking.feet import feet_of
from hqp.walking.stance import borne, standing

DT = 0.002


@dataclass
class Walked:
    """A course with records of its ticks; ``run`` continues it."""

    course: Course
    statuses: Counter[str] = field(default_factory=Counter)
    jumps: list[float] = field(default_factory=list)
    last: Any = None
    off: float = 0.0

    @classmethod
    def of(cls, name: str, sensed: bool = True, **course: Any) -> Walked:
        walker = Walker(hqp.robots.load(name, rotors=True), dt=DT, deadline=np.inf)
        if not sensed:
            course |= {"sensors": None, "delay": 0.0}
        return cls(Course(walker, **course))

    def run(self, seconds: float, push: Any = None) -> None:
        plant = self.course.plant
        end = plant.time + seconds
        while plant.time < end - 1e-9:
            true = plant.state()[0]
            tick = self.course.step(push)
            self.off = max(self.off, float(np.abs(self.course.state.q[:3] - true[:3]).max()))
            self.statuses[tick.status.name] += 1
            if self.last is not None:
                self.jumps.append(float(np.abs(tick.command - self.last).max()))
            self.last = tick.command.copy()
            assert not self.course.fallen, f"fell at {plant.time:.2f} s"

    @property
    def walker(self) -> Walker:
        return self.course.walker

    @property
    def plant(self) -> Plant:
        return self.course.plant

    @property
    def optimal(self) -> float:
        return self.statuses["OPTIMAL"] / sum(self.statuses.values())


@pytest.mark.slow
@pytest.mark.parametrize(("name", "speed", "jump"), [("talos", 0.3, 40.0), ("g1", 0.2, 15.0)])
def test_it_walks_on_what_it_senses_and_stops(name: str, speed: float, jump: float) -> None:
    """Noise, 4 ms of delay, friction 0.6: commanded speed, no torque jumps, feet side by side at the end."""
    course = Walked.of(name)
    course.run(1.0)
    start = course.plant.com()
    course.walker.go(forward=speed)
    course.run(6.0)
    middle = course.plant.com()
    course.walker.stop()
    course.run(3.0)
    assert middle[0] - start[0] > 0.7 * 6.0 * speed  # it starts over several steps
    assert abs(course.plant.com()[1]) < 0.1
    assert course.walker.phase == "stand"
    one, other = (course.plant.place(f)[0] for f in course.walker.robot.landmarks["soles"])
    assert abs(one[0] - other[0]) < 0.03
    assert course.optimal > 0.995
    assert max(course.jumps) < jump
    assert course.off < 0.03


@pytest.mark.slow
def test_a_stopped_session_stands_after_its_walk() -> None:
    course = Walked.of("g1")
    course.run(1.0)
    course.walker.go(forward=0.2)
    course.run(1.5)
    session = course.walker.session
    session.stop("operator")
    assert not session.stopped
    course.run(course.walker.stopping_time + 0.5)
    assert session.stopped == "operator"
    before = course.plant.com()
    course.run(4.0)
    assert np.abs(course.plant.com() - before).max() < 0.02
    session.resume()
    course.walker.go(forward=0.2)
    course.run(3.0)
    assert course.plant.com()[0] - before[0] > 0.2


@pytest.mark.slow
def test_it_turns_and_goes_aside_and_back() -> None:
    course = Walked.of("talos", sensed=False)
    course.run(1.0)
    course.walker.go(forward=-0.1, left=0.05)
    course.run(4.0)
    there = course.plant.com()
    assert there[0] < -0.2
    assert there[1] > 0.1
    course.walker.go(turn=0.2)
    course.run(4.0)
    R = course.plant.place("base_link")[1]
    assert np.arctan2(R[1, 0], R[0, 0]) > 0.4


@pytest.mark.slow
@pytest.mark.parametrize(("name", "blow", "steps"), [("talos", 0.2, False), ("g1", 0.13, True)])
def test_a_push_is_answered_by_ankles_and_where_they_are_too_narrow_by_a_step(
    name: str, blow: float, steps: bool
) -> None:
    """A push from the side in a swing [m/s of the mass]: G1's foot lands sooner and wider, Talos' as planned."""
    course = Walked.of(name, sensed=False)
    walker = course.walker
    course.run(1.0)
    walker.go(forward=0.1)
    while walker.phase != "swing" or walker._state.t < 0.2 or walker.stance != 1:
        course.run(DT)
    nominal, since = Foothold(*walker._state.nominal), course.plant.time - walker._state.t
    course.run(0.1, push=[0.0, 10.0 * blow * walker.robot.mass, 0.0])
    while walker.phase == "swing":
        course.run(DT)
    sooner = course.plant.time - since < walker.gait.single - 0.025
    assert (sooner and walker.holds[0].y > nominal.y + 0.003) == steps
    course.run(4.0)
    assert course.optimal > 0.995
    assert max(course.jumps) < 120.0


@pytest.mark.slow
def test_it_walks_on_position_servos() -> None:
    """Noise and delay; without the torques' part the servos sag, and G1 falls."""
    course = Walked.of("g1", servo=Servo(other=300.0, damping_time=0.03))
    course.run(1.0)
    start = course.plant.com()
    course.walker.go(forward=0.2)
    course.run(3.0)
    assert course.plant.com()[0] - start[0] > 0.35
    assert course.optimal > 0.995


def test_servos_bear_the_torque_in_the_mean() -> None:
    """Mean over their period, on joints that move as in the model."""
    robot = hqp.robots.load("g1", rotors=True)
    walker = Walker(robot, dt=DT, deadline=np.inf)
    v = 0.1 * np.random.default_rng(0).normal(size=robot.nv)
    tick = walker.step(robot.state(walker.start, v))
    state = tick.state
    motors, kp, kv = robot.actuated, 500.0, 15.0
    a = (tick.advance()[1] - v)[motors] / DT
    for delay in (0.0, 0.004):
        angles, rates = walker.positions(tick, np.full(len(motors), kp), delay)
        t = delay + DT * (np.arange(100)[:, None] + 0.5) / 100
        off, faster = angles - state.angles[motors] - t * v[motors] - 0.5 * t * t * a, rates - v[motors] - t * a
        torques = np.mean(kp * off + kv * faster, axis=0)
        curved = kp * DT * DT / 24.0 * a  # curvature over the period, missing at its middle
        np.testing.assert_allclose(torques + curved, tick.command, atol=1e-4)


@pytest.mark.slow
def test_a_robot_from_its_file_alone_stands_up_and_walks() -> None:
    """No catalogue: straight legs at home, no named base; soles are given."""
    source = str(hqp.robots.load("romeo").source)
    robot = hqp.robots.load(source, floating=True, rotors=True)
    course = Walked(Course(Walker(robot, dt=DT, soles=("l_sole", "r_sole"), deadline=np.inf)))
    course.run(1.0)
    course.walker.go(forward=0.13)
    course.run(4.0)
    assert course.plant.com()[0] > 0.3
    assert course.optimal > 0.995


@pytest.mark.slow
def test_it_walks_over_tiles_that_it_does_not_know() -> None:
    """Unknown steps of up to 40 mm up and down between tiles, detected by early and late landings."""
    course = Walked.of("talos", terrain=Tiles(friction=0.5, seed=1), height=0.02)
    course.run(1.0)
    course.walker.go(forward=0.1)
    course.run(7.0)
    assert course.plant.com()[0] > 0.5
    assert course.optimal > 0.99


def test_phases_follow_each_other_and_the_stack(tmp_path: Any) -> None:
    """Without loads phases follow time: shift, swing, shift; the swing foot is off in the stack; shares lie in 0..1."""
    robot = hqp.robots.load("talos", rotors=True)
    walker = Walker(robot, Gait(single=0.1, double=0.04, first=0.2), dt=DT, deadline=np.inf)
    walker.go(forward=0.05)
    events = []
    for _ in range(290):
        tick = walker.step(robot.state(robot.home))
        assert tick.status.usable
        assert 0.0 <= walker._state.share <= 1.0
        if walker.event:
            events.append((walker.event, walker.stance, walker.session.program.out & {"left", "right"}))
    assert events[:4] == [("shift", 1, set()), ("swing", 1, {"left"}), ("shift", 0, set()), ("swing", 0, {"right"})]


@pytest.mark.parametrize(("name", "lower"), [("talos", 0.03), ("romeo", 0.01), ("cbi", 0.01), ("g1", 0.03)])
def test_it_stands_as_low_as_its_knees_bear(name: str, lower: float) -> None:
    """Romeo's knees bear 84 % of their torque 3 % below home, CBi's hips 82 %; the CoM is above the middle."""
    robot = hqp.robots.load(name, rotors=True)
    feet = feet_of(robot)
    home, state = robot.copy().state(robot.home), robot.copy().state(standing(robot, feet, 0.03))
    ground = 0.5 * sum(foot.placed(home).z + foot.depth for foot in feet)
    assert state.com()[2] == pytest.approx((1.0 - lower) * (home.com()[2] - ground), abs=2e-4)
    middle = 0.5 * sum(foot.placed(state).xy for foot in feet)
    np.testing.assert_allclose(state.com()[:2], middle, atol=2e-4)
    for foot in feet:
        assert state.rotation(foot.frame)[2, 2] == pytest.approx(1.0, abs=1e-6)
        assert state.position(foot.frame)[2] + foot.depth == pytest.approx(0.0, abs=2e-4)


@pytest.mark.long
def test_what_joints_bear_on_one_foot_is_the_balance_of_the_free_base() -> None:
    """The sole's wrench that leaves the base to accelerate away from the ZMP, with all links, gives equal torques."""
    robot = hqp.robots.load("romeo", rotors=True)
    feet = feet_of(robot)
    state = robot.copy().state(standing(robot, feet, 0.03))
    for foot in feet:
        at, c = foot.placed(state), state.com()
        away = 9.81 * (c - [at.x, at.y, at.z]) / (c[2] - at.z) - [0.0, 0.0, 9.81]
        J, g = state.jacobian(foot.frame), state.bias_force() + robot.mass * state.com_jacobian().T @ away
        wrench = np.linalg.solve(J[:, :6].T, g[:6])
        torque = (g - J.T @ wrench)[robot.actuated]
        limits = robot.effort_limit[robot.actuated]
        np.testing.assert_allclose(borne(robot, foot, state.q) * limits, np.abs(torque), atol=1e-6)
        tendons = np.eye(len(torque)) + np.diag(np.linspace(-0.5, 0.5, len(torque) - 1), 1)
        pulled = Pulled(robot, tendons @ robot.actuation)
        own = np.linalg.solve(tendons.T, torque)
        np.testing.assert_allclose(borne(pulled, foot, state.q) * limits, np.abs(own), atol=1e-6)


class Pulled:
    """A robot with other motors."""

    def __init__(self, robot: Any, actuation: Any) -> None:
        self._robot, self.actuation = robot, actuation

    def __getattr__(self, name: str) -> Any:
        return getattr(self._robot, name)


def test_what_a_foot_bears_by_a_toe_is_a_landing_when_its_time_is_up() -> None:
    """2 % of the weight: more than a foot that is held back can push with, less than a landing before its time."""
    walker = Walker(hqp.robots.load("talos", rotors=True), Gait(single=0.3, first=0.3), dt=DT, deadline=np.inf)
    walker.go()
    q, v, swung = walker.start, np.zeros(walker.robot.nv), 0
    for _ in range(800):
        left = 0.02 if walker.phase == "swing" else 0.5
        tick = walker.step(walker.robot.state(q, v), loads=np.array([left, 1.0 - left]) * walker.weight)
        swung += walker.phase == "swing"
        if swung and walker.event == "shift":
            break
        q, v = tick.advance()
    assert swung * DT == pytest.approx(0.3, abs=0.01)


@pytest.mark.parametrize("seed", range(6))
def test_it_bears_its_weight_as_a_heavier_model_does(seed: int) -> None:
    """Drawn masses and weak knees: torques scaled after the solve passed the limits, and the knee gave way."""
    rng = np.random.default_rng(seed)
    name, share, weak = ("g1", "talos")[seed % 2], rng.uniform(0.85, 1.2), rng.uniform(0.3, 1.0)
    given, heavy = (hqp.robots.load(name, rotors=True) for _ in range(2))
    for inertia in heavy.model.inertias:
        inertia.mass, inertia.inertia = share * inertia.mass, share * inertia.inertia
    start = Walker(given, dt=DT).start
    for robot in (given, heavy):
        for joint in np.flatnonzero(["knee" in n or n.endswith("_4_joint") for n in robot.joint_names]):
            robot.effort_limit[robot.actuated[joint]] *= weak
    load, found = 0.5 * share * given.mass * 9.81, []
    for robot, expected in ((given, share), (heavy, 1.0)):
        walker = Walker(robot, Gait(), dt=DT, deadline=np.inf)
        for _ in range(600):
            tick = walker.step(robot.state(start), (load, load))
        assert walker.heavier == pytest.approx(expected, abs=1e-2)
        found.append(tick.command)
    np.testing.assert_allclose(*found, atol=0.02 * np.abs(found[1]).max())


@pytest.mark.long
def test_it_weighs_itself() -> None:
    """Feet that bear a tenth more than the model: torques grow by a tenth, through an impact and a flight."""
    robot = hqp.robots.load("talos", rotors=True)
    known, felt = (Walker(robot, dt=DT, deadline=np.inf) for _ in range(2))
    state, weight = robot.state(robot.home), 9.81 * robot.mass
    for _ in range(40):
        felt.step(state, (0.5 * 1.1 * weight, 0.6 * weight - 0.05 * weight))
        felt.step(state, (2.2 * weight, 0.0))
        felt.step(state, (0.0, 0.0))
        for _ in range(3):
            known.step(state)
    assert felt.heavier == pytest.approx(1.1, abs=0.02)
    more = felt.step(state, (0.55 * weight, 0.55 * weight)).command
    limit = robot.effort_limit[robot.actuated]
    assert np.all(np.abs(more) <= limit)
    knee = robot.joint_names.index("leg_left_4_joint")
    assert abs(more[knee]) > 1.05 * abs(known.step(state).command[knee])


@pytest.mark.long
def test_a_mesh_stands_on_all_of_its_sole() -> None:
    """MuJoCo finds three contact points of a mesh on a plane; a plant adds the corners."""
    robot = hqp.robots.load("talos", rotors=True)
    plant, feet = Plant(robot), feet_of(robot)
    plant.reset(robot.home)
    contact = plant.data.contact
    for foot in feet:
        body = plant._frames.body(foot.frame)
        while not plant.model.body_jntnum[body]:
            body = plant.model.body_parentid[body]
        mine = (plant.model.geom_bodyid[contact.geom] == body).any(axis=1)
        place, turned = plant.place(foot.frame)
        found = ((contact.pos[mine] - place) @ turned)[:, :2]
        for corner in foot.corners:
            assert np.linalg.norm(found - corner, axis=1).min() < 2e-3


def test_soles_are_those_of_the_shapes() -> None:
    """G1's four spheres; Talos' mesh up to its bevel as six corners inside it; CBi's box."""
    for name, box in (("g1", (0.085, 0.03)), ("talos", (0.102, 0.062)), ("cbi", (0.1225, 0.05))):
        for foot in feet_of(hqp.robots.load(name)):
            corners = np.array(foot.corners)
            half = 0.5 * np.ptp(corners, axis=0)
            np.testing.assert_allclose(half, box, atol=6e-3)
            assert len(corners) <= 6
            assert foot.margin <= 0.3 * half.min() + 1e-12


def test_what_is_no_biped_is_refused() -> None:
    with pytest.raises(DeclarationError, match="no biped"):
        Walker(hqp.robots.load("ur5"))
    with pytest.raises(DeclarationError, match="no biped"):
        Walker(hqp.robots.load("anymal"))
    with pytest.raises(hqp.errors.FrameNotFound):
        Walker(hqp.robots.load("talos"), soles=("left", "right"))


@pytest.mark.long
def test_a_walker_is_as_heavy_as_gravity_makes_it() -> None:
    """With gravity of 6 m/s^2 the walker uses that weight of its own model."""
    robot = hqp.robots.load("g1", rotors=True)
    robot.model.gravity.linear = np.array([0.0, 0.0, -6.0])

    def lighter(spec: Any) -> None:
        spec.option.gravity = robot.gravity

    course = Course(Walker(robot, dt=DT, deadline=np.inf), edit=lighter)
    walker = course.walker
    assert walker.omega == pytest.approx(np.sqrt(6.0 / walker.height))
    walked = Walked(course)
    walked.run(0.3)
    walker.go(0.1)
    walked.run(1.5)
    assert walker.heavier == pytest.approx(1.0, abs=0.02)
    assert walked.off < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("name", ["g1", "talos"])
def test_no_healthy_walk_is_stopped_by_the_age_of_its_states(name: str) -> None:
    course = Walked(Course(Walker(hqp.robots.load(name, rotors=True), dt=DT, deadline=np.inf, max_age=0.01)))
    course.run(1.0)
    course.walker.go(forward=0.2)
    course.run(2.0)
    course.run(0.1, push=[0.0, 60.0, 0.0])
    course.run(2.0)
    assert set(course.statuses) == {"OPTIMAL"}
