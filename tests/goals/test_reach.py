"""reach: targets met on strict levels, from many starts, and the reason if they are not met."""

from __future__ import annotations

import gc
import math
import weakref
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hqp
import hqp.robots
from hqp import Level, Stack, _assembly, shapes
from hqp.errors import DeclarationError, ModelError
from hqp.goals import reaching
from hqp.goals.kept import Kept
from hqp.loop.session import one_second
from hqp.robots import Robot
from hqp.search import native, starts
from hqp.search.newton import Search
from hqp.tasks import CollisionAvoidance, Com, FixedContact, JointLimits, Pose, Position, Posture, Within

TOOLS = {"ur5": ("tool0",), "panda": ("panda_hand_tcp",), "g1": ("left_wrist_yaw_link", "right_wrist_yaw_link")}


def load(name: str) -> Any:
    if name not in hqp.robots.names():
        pytest.skip("needs example-robot-data")
    return hqp.robots.load(name, floating=False)


def reachable(robot: Any, frames: tuple[str, ...], count: int) -> list[list[Any]]:
    """Poses of frames in random configurations inside the limits and free of collisions."""
    apart, rng = CollisionAvoidance(clearance=0.0), np.random.default_rng(1)
    lower, upper = np.maximum(robot.lower, -math.pi), np.minimum(robot.upper, math.pi)
    found: list[list[Any]] = []
    while len(found) < count:
        step = rng.uniform(lower, upper) - robot.state(robot.home).angles
        state = robot.state(robot.integrate(robot.home, step, 1.0))
        if all(near is None or near.distance > 0.0 for near in apart.near(state)):
            found.append([Pose(frame=f).value(state) for f in frames])
    return found


@pytest.mark.long
@pytest.mark.parametrize("name", ["ur5", "panda", pytest.param("g1", marks=pytest.mark.slow)])
def test_random_reachable_poses_are_reached(name: str) -> None:
    robot, frames = load(name), TOOLS[name]
    hands = [Pose(frame=f) for f in frames]
    stack = Stack(Level(*hands))
    for k, poses in enumerate(reachable(robot, frames, 60)):
        found = hqp.reach(stack, robot, *(h.at(p) for h, p in zip(hands, poses, strict=True)), seed=k, budget=20.0)
        assert found.success, (k, str(found))
        assert np.all(found.q >= robot.lower - 1e-9)
        assert np.all(found.q <= robot.upper + 1e-9)
        state = robot.state(found.q)
        for frame, pose in zip(frames, poses, strict=True):
            assert np.linalg.norm(state.position(frame) - pose[:3, 3]) < 1e-3
            assert np.linalg.norm(robot.log3(state.rotation(frame) @ pose[:3, :3].T)) < 1e-3


def test_panda_leaves_its_elbow_limit() -> None:
    """Straight at its limit the elbow is a local minimum; a restart leaves it."""
    robot = load("panda")
    hand, q0 = Pose(frame="panda_hand_tcp"), robot.home.copy()
    q0[3] = robot.upper[3]
    ended = []
    for k, (pose,) in enumerate(reachable(robot, (hand.frame,), 30)):
        assert hqp.reach(Stack(Level(hand)), robot, hand.at(pose), q0=q0, seed=k, budget=20.0).success
        ended.append(hqp.reach(Stack(Level(hand)), robot, hand.at(pose), q0=q0, restarts=0).success)
    assert not all(ended)


def test_levels_are_strict() -> None:
    """One hand target near, the other 1.5 m ahead: the first level is met, the second as close as the first allows."""
    robot = load("g1")
    one, two = Position(frame="left_wrist_yaw_link"), Position(frame="right_wrist_yaw_link")
    state = robot.state()
    near, far = state.position(one.frame) + [0.05, 0.0, 0.05], np.array([1.5, -0.2, 0.3])
    found = hqp.reach(
        Stack(Level(one, name="one"), Level(two, name="two")), robot, one.at(near), two.at(far), restarts=3
    )
    assert not found.success
    assert found.residuals["one"] < 1e-3
    assert found.errors["right_wrist_yaw_link"] > 0.5
    assert found.reason.startswith("two: right_wrist_yaw_link has error ")
    # a local minimum: no free joint brings the second hand nearer without moving the first
    state = robot.state(found.q)
    inside = (found.q > robot.lower + 1e-6) & (found.q < robot.upper - 1e-6)
    J, K = one.jacobian(state)[:, inside], two.jacobian(state)[:, inside]
    downhill = (K.T - np.linalg.pinv(J) @ (J @ K.T)) @ two.error(state, far)
    assert np.linalg.norm(downhill) < 0.01 * found.residuals["two"]
    alone = hqp.reach(Stack(Level(two, name="two")), robot, two.at(far), restarts=3)
    assert found.residuals["two"] < alone.residuals["two"] + 0.02


def test_levels_below_settle() -> None:
    """A posture without a reference is as near to q0 as the hand allows: no step along the self-motion remains."""
    robot = load("panda")
    hand, posture = Pose(frame="panda_hand_tcp"), Posture()
    pose = hand.value(robot.state())
    pose[:3, 3] += [-0.1, 0.2, 0.1]
    found = hqp.reach(Stack(Level(hand), Level(posture)), robot, hand.at(pose))
    assert found.success
    state = robot.state(found.q)
    J = hand.jacobian(state)
    free = np.eye(robot.nv) - np.linalg.pinv(J) @ J
    left = free @ posture.error(state, posture.value(robot.state(robot.home)))
    assert np.linalg.norm(posture.error(robot.state(found.q), robot.home)) > 0.1
    assert np.linalg.norm(left) < 0.02


def test_a_humanoid_reaches_with_its_feet_and_balance_held() -> None:
    robot = hqp.robots.load("cbi")
    feet = [FixedContact(frame=f) for f in ("l_sole", "r_sole")]
    hand, com = Position(frame="r_palm"), Com(axes="xy")
    stack = Stack(
        Level(com, name="balance"), Level(hand, name="hand"), Level(Posture()), subject_to=[*feet, JointLimits()]
    )
    state = robot.state()
    goal, start = state.position("r_palm") + [0.15, 0.0, 0.2], {f.frame: f.value(state) for f in feet}
    centre = state.com()[:2].copy()
    found = hqp.reach(stack, robot, hand.at(goal))
    assert found.success, str(found)
    state = robot.state(found.q)
    np.testing.assert_allclose(state.position("r_palm"), goal, atol=1e-3)
    for foot in feet:
        assert np.linalg.norm(foot.error(state, start[foot.frame])) < 1e-3
    np.testing.assert_allclose(state.com()[:2], centre, atol=5e-3)
    assert found.residuals["balance"] < 1e-3


def test_the_world_is_avoided_where_the_stack_says_so() -> None:
    robot = load("panda")
    hand = Position(frame="panda_hand_tcp")
    goal = robot.state().position(hand.frame) + [0.1, 0.0, -0.2]
    ball = shapes.sphere("ball", 0.08, tuple(robot.state().position(hand.frame) + [0.05, 0.0, -0.1]))
    avoid = CollisionAvoidance(world=ball, clearance=0.02)
    found = hqp.reach(Stack(Level(hand), subject_to=[JointLimits(), avoid]), robot, hand.at(goal), budget=10.0)
    assert found.success, str(found)
    state = robot.state(found.q)
    np.testing.assert_allclose(state.position(hand.frame), goal, atol=1e-3)
    assert all(n.distance > n.clearance - 1e-3 for n in avoid.near(state) if n is not None)
    inside = robot.state().position(hand.frame) + [0.05, 0.0, -0.1]
    lost = hqp.reach(Stack(Level(hand), subject_to=[JointLimits(), avoid]), robot, hand.at(inside), restarts=2)
    assert not lost.success
    assert "panda_hand_tcp has error 0." in lost.reason


def test_a_budget_ends_it_and_says_so() -> None:
    robot = load("ur5")
    hand = Position(frame="tool0")
    found = hqp.reach(Stack(Level(hand)), robot, hand.at([3.0, 0.0, 0.0]), restarts=10_000, budget=0.05)
    assert not found.success
    assert "time budget spent" in found.reason
    assert found.starts < 10_000
    again = hqp.reach(Stack(Level(hand)), robot, hand.at([3.0, 0.0, 0.0]), restarts=1)
    assert again.starts == 2


@pytest.mark.long
def test_what_is_kept_goes_with_its_robot() -> None:
    """One search for each stack, again and again the same; it keeps neither the robot nor its meshes alive."""
    robot, hand = load("panda"), Position(frame="panda_hand_tcp")
    goal, stacks = hand.at([0.4, 0.1, 0.5]), [Stack(Level(hand)), Stack(Level(hand), Level(Posture()))]
    assert robot.geometry.ngeoms > 0
    for _ in range(3):
        for stack in stacks:
            assert hqp.reach(stack, robot, goal).success
    kept = reaching._SEARCHES._values[robot]
    assert [stack for stack, _ in kept] == stacks
    assert all(search.robot._geometry is None for search in kept.values())
    gone = [weakref.ref(robot), *map(weakref.ref, kept.values())]
    del robot, kept
    gc.collect()
    assert all(ref() is None for ref in gone)


def test_bad_input() -> None:
    robot = load("ur5")
    hand = Position(frame="tool0")
    stack, goal = Stack(Level(hand)), hand.at([0.3, 0.2, 0.3])
    with pytest.raises(DeclarationError, match="no references"):
        hqp.reach(stack, robot)
    with pytest.raises(DeclarationError, match="unknown element"):
        hqp.reach(stack, robot, Position(frame="wrist").at([0.0, 0.0, 0.0]))
    with pytest.raises(ModelError, match="q0 has shape"):
        hqp.reach(stack, robot, goal, q0=np.zeros(3))
    for bad in ({"restarts": -1}, {"steps": 0}, {"tolerance": 0.0}, {"budget": math.nan}, {"restarts": 1.5}):
        with pytest.raises(DeclarationError, match=next(iter(bad))):
            hqp.reach(stack, robot, goal, **bad)
    with pytest.raises(DeclarationError, match="reach: bad stack"):
        hqp.reach([Level(hand)], robot, goal)  # type: ignore[arg-type]
    unmet = hqp.reach(stack, robot, hand.at([math.nan, 0.0, 0.0]), restarts=1)
    assert not unmet.success


def python_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native.NativeDescents, "descend", lambda *_: None)
    monkeypatch.setattr(reaching, "_SEARCHES", Kept(8))


@pytest.mark.parametrize("name", ["ur5", "panda", "cbi"])
def test_native_descents_are_those_of_the_general_path(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Equal steps, configurations and errors, with targets that are met, stalled or out of reach."""
    robot = hqp.robots.load(name) if name == "cbi" else load(name)
    rng = np.random.default_rng(5)
    if name == "cbi":
        hand: Pose | Position = Position(frame="r_palm")
        soles = [FixedContact(frame=f) for f in ("l_sole", "r_sole")]
        apart = CollisionAvoidance(clearance=0.01)
        stack = Stack(Level(Com(axes="xy")), Level(hand), Level(Posture()), subject_to=[*soles, JointLimits(), apart])
    else:
        hand = Pose(frame=TOOLS[name][0])
        stack = Stack(Level(hand), Level(Posture()))
    start, runs = hand.value(robot.state()), []
    goals = []
    for k in (0, 6) if name == "cbi" else range(8):  # cbi's general path takes a second per goal
        goal = start.copy()
        goal[..., 3 if goal.ndim > 1 else slice(None)][:3] += rng.uniform(-0.4, 0.4, 3) * (4.0 if k > 5 else 1.0)
        goals.append(hand.at(goal))
    search = Search(stack, robot, one_second)
    for goal in goals:
        search.aim(robot.home, [goal])
        for most in (3, 30):
            start_q = starts.random_start(robot, robot.home, rng)
            one = search._native.descend(start_q, 1e-3, most, 60.0)
            other = search._descend(start_q, 1e-3, most, math.inf, False)
            assert one is not None
            assert (one.steps, one.reason) == (other.steps, other.reason)
            np.testing.assert_allclose(one.q, other.q, atol=1e-5)
            np.testing.assert_allclose(one.merit, other.merit, rtol=1e-4)
    for general in (False, True):
        if general:
            python_only(monkeypatch)
        runs.append([hqp.reach(stack, robot, goal, restarts=0, budget=60.0) for goal in goals])
    for one, other in zip(*runs, strict=True):
        assert (one.success, one.steps) == (other.success, other.steps)
        np.testing.assert_allclose(one.q, other.q, atol=1e-5)
        for key, error in other.errors.items():
            assert one.errors[key] == pytest.approx(error, abs=1e-5)


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_a_native_descent_that_gives_up_is_continued_where_it_is(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its steps count, and the general path meets the same goals as the whole descent."""
    robot, rng = load(name), np.random.default_rng(8)
    hand = Pose(frame=TOOLS[name][0])
    search, whole = Search(Stack(Level(hand), Level(Posture())), robot, one_second), native.NativeDescents.descend

    def gives_up(self: Any, q: Any, tolerance: float, most: int, seconds: float) -> Any:
        found = whole(self, q, tolerance, min(most, 3), seconds)
        return found and (found if found.met else found._replace(reason=native.CONTINUED))

    for _ in range(8):
        goal = hand.value(robot.state(robot.home)).copy()
        goal[:3, 3] += rng.uniform(-0.2, 0.2, 3)
        search.aim(robot.home, [hand.at(goal)])
        one = search.descend(robot.home, 1e-3, 60, math.inf)
        with monkeypatch.context() as patched:
            patched.setattr(native.NativeDescents, "descend", gives_up)
            other = search.descend(robot.home, 1e-3, 60, math.inf)
            first = search.descend(robot.home, 1e-3, 3, math.inf)
        assert other.met == one.met
        assert other.steps <= 60
        assert first.steps == min(3, one.steps)


@pytest.mark.long
@pytest.mark.parametrize("calm", [False, True])
def test_violations_of_a_step_are_those_of_the_bounds(calm: bool) -> None:
    """The general path takes them from the rows of the step."""
    robot, rng = hqp.robots.load("g1"), np.random.default_rng(2)
    hand = Pose(frame=TOOLS["g1"][0])
    floor = shapes.half_space("floor", (0.0, 0.0, 0.1))
    within = Within(Com(axes="z"), lower=0.6, weight=3.0, name="high")
    guards = [CollisionAvoidance(pairs="world", world=(floor,), name="floor", weight=2.0), CollisionAvoidance(), within]
    search = Search(Stack(Level(hand), subject_to=guards), robot, one_second)
    search.aim(robot.home, [hand.at(hand.value(robot.state(robot.home)))])
    seen = set()
    for _ in range(30):
        q = robot.integrate(robot.home, rng.normal(size=robot.nv), 0.4)
        _, errors = search.step(q, calm=calm)
        state = robot.state(q)
        for guard in search._guards:
            lower, upper = guard.bounds(state)
            worst = max(0.0, float(np.max(lower, initial=0.0)), float(np.max(-upper, initial=0.0)))
            assert errors[guard.name] == pytest.approx(worst, abs=1e-9)
            seen |= {guard.name} if worst > 0.0 else set()
    assert seen == {guard.name for guard in search._guards}


def every_joint() -> Robot:
    """A free base with a joint of every kind of the native kinematics, in series."""
    model, joint = pin.Model(), 0
    kinds = (pin.JointModelFreeFlyer(), pin.JointModelSpherical(), pin.JointModelRUBY(), pin.JointModelPX(),
             pin.JointModelSpherical(), pin.JointModelRevoluteUnaligned(np.array([0.6, 0.0, 0.8])),
             pin.JointModelPlanar(), pin.JointModelTranslation(), pin.JointModelRZ())  # fmt: skip
    for k, kind in enumerate(kinds):
        joint = model.addJoint(joint, kind, pin.SE3(pin.utils.rotate("x", 0.3), np.array([0.1, 0.2, 0.3])), f"j{k}")
        model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
        model.addFrame(pin.Frame(f"f{k}", joint, 0, pin.SE3(np.eye(3), np.array([0.0, 0.1, 0.0])), pin.FrameType.BODY))
    model.lowerPositionLimit, model.upperPositionLimit = -np.ones(model.nq), np.ones(model.nq)
    return Robot(model, name="every joint")


@pytest.mark.parametrize("name", ["ur5", "panda", "cbi", "dreamer", "talos", "g1", "every joint"])
def test_native_kinematics_are_pinocchios(name: str) -> None:
    """Placements, twists and integration, at random configurations."""
    robot, rng = every_joint() if name == "every joint" else hqp.robots.load(name), np.random.default_rng(2)
    frames = [f for f in robot.frame_names if f != "universe"][:: 7 if name in hqp.robots.names() else 1]
    views = [robot.placement(robot.frame(f)) for f in frames]
    bodies = [placement for *_, placement in robot.bodies]
    joints = robot.tree_joints
    assert joints is not None
    twin = _assembly.Kinematics(robot.joint_twists, joints, robot.placed_frames)
    for k in range(5):
        q, x = robot.random_configuration(rng), rng.normal(size=robot.nv)
        if robot.floating and k % 2:
            x[3:6] *= 1e-5  # a base that moves nearly straight
        moved = robot.integrate(q, x, 0.7)
        out = np.empty(robot.nq)
        twin.integrate(q, x, 0.7, out)
        np.testing.assert_allclose(out, moved, atol=1e-12)
        robot.state(q).kinematics()
        seen = [np.array(a) for view in (*views, *bodies[1:]) for a in view], robot.joint_twists.copy()
        robot.state(robot.home).kinematics()
        twin.update(q)
        for a, b in zip(seen[0], [a for view in (*views, *bodies[1:]) for a in view], strict=True):
            np.testing.assert_allclose(a, b, atol=1e-12)
        np.testing.assert_allclose(seen[1], robot.joint_twists, atol=1e-12)


def test_starts_are_drawn_all_around() -> None:
    """Joints over their ranges, and the base to both sides in every direction."""
    robot = hqp.robots.load("g1")
    rng = np.random.default_rng(3)
    drawn = np.array([starts.random_start(robot, robot.home, rng) for _ in range(200)])
    base = np.array([robot.difference(robot.home, q)[:6] for q in drawn])
    assert np.all(base.min(axis=0) < -0.5 * starts.BASE)
    assert np.all(base.max(axis=0) > 0.5 * starts.BASE)
    assert np.all(np.abs(base) <= 2.0 * starts.BASE)
    share = (drawn[:, 7:] - robot.lower[6:]) / (robot.upper - robot.lower)[6:]
    assert np.all((share.min(axis=0) < 0.15) & (share.max(axis=0) > 0.85))
