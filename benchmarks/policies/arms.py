"""Arms above the legs of a public walking policy in MuJoCo: falls over hand error by reach, beside pink and a clamp.

The policy, its gains and its scene come from the wheels ``holosoma-inference`` and ``holosoma``, which hqp does not
ship: pip install holosoma-inference holosoma onnxruntime, and pin-pink for the rivals.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

import hqp
from benchmarks.policies.filter import Shapes
from benchmarks.reports import report

DT, PERIOD = 0.01, 0.02
"""Periods of the arms and of the policy [s]."""
REACHES = (0.03, 0.05, 0.07, 0.1)
HANDS = ("left_wrist_yaw_link", "right_wrist_yaw_link")
LEGS = np.array([-0.312, 0.0, 0.0, 0.669, -0.363, 0.0])
ARM = np.array([0.2, 0.2, 0.0, 0.6, 0.0, 0.0, 0.0])
HOME = np.concatenate((LEGS, LEGS, np.zeros(3), ARM, ARM * (1.0, -1.0, 1.0, 1.0, 1.0, 1.0, 1.0)))
"""The policy's posture, joints in the order of its scene [rad]."""
BELOW = 15
"""Joints of the policy: legs and waist."""
LOAD = np.array([0.08, 0.0, 0.0])
"""Place of a load in the axes of a hand [m]."""
SPEED = 4.0
"""Largest speed of the arms' joints that hqp plans [rad/s]."""
CLAMPED = 6.0
"""Speed of joint targets in the clamp [rad/s]."""
FAST = 6.0
"""Speed of joints at which guards of robots stop them [rad/s]."""
PUSH, PUSHES = 0.15, 2.0
"""Impulse over mass that a standing robot gets in a drawn direction [m/s], and time between two [s]."""
MARK, END = "<!-- tables: python -m benchmarks arms --page docs/upper-body.md -->", "<!-- end -->"
"""Marks in the page around the generated table."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this part."""
    parser.add_argument("--motions", type=int, default=20, help="drawn motions of each controller, by default 20")
    parser.add_argument("--first", type=int, default=0, help="seed of the first motion")
    parser.add_argument("--only", nargs="*", default=None, metavar="NAME", help='such as "reach 0.05" or pink')
    parser.add_argument("--record", type=Path, metavar="FILE", help="add motions to it, and leave out those it has")
    parser.add_argument("--seconds", type=float, default=math.inf, help="begin no motion after this time")
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the table there, in a page of the docs, too")


def run(arguments: argparse.Namespace) -> int:
    """Run the motions, show, write; returns 1 without the wheels."""
    warnings.simplefilter("ignore")
    files = wheels()
    if files is None:
        report.console.print("holosoma-inference, holosoma and onnxruntime are not installed: see the module's text")
        return 1
    makers: dict[str, Callable[..., Any]] = {f"reach {r:g}": upper_body(r) for r in (*REACHES, math.inf)}
    if importlib.util.find_spec("pink"):
        makers |= {"pink": Pink, "pink, clamped": Clamped}
    names = [name for name in makers if arguments.only is None or name in arguments.only]
    count = 2 if arguments.quick else arguments.motions
    found: dict[str, dict[int, Motion]] = {name: {} for name in names}
    for name, seed, one in recorded(arguments.record):
        found.setdefault(name, {})[seed] = one
    end = time.monotonic() + arguments.seconds
    for seed, name in product(range(arguments.first, arguments.first + count), names):
        if seed in found[name] or time.monotonic() > end:
            continue
        one = found[name][seed] = motion(files, makers[name], seed)
        state = "fell" if one.fell else "stands"
        report.console.print(f"{seed} {name}: {state}, {1e3 * np.median(one.errors):.0f} mm, {one.fast:.1f} rad/s")
        if arguments.record is not None:
            with arguments.record.open("a") as file:
                file.write(json.dumps([name, seed, asdict(one)]) + "\n")
    text = table({name: list(runs.values()) for name, runs in found.items() if runs})
    report.section(arguments.output, "arms", text)
    if arguments.page is not None:
        report.into_page(arguments.page, MARK, text, END)
    return 0


def table(found: Mapping[str, Sequence[Motion]]) -> str:
    """A row for each name, in the columns of ``Motion.cells``."""
    rows = {name: Motion.cells(runs) for name, runs in found.items()}
    return report.table(("arms", *next(iter(rows.values()))), [(name, *row.values()) for name, row in rows.items()])


def recorded(path: Path | None) -> Iterator[tuple[str, int, Motion]]:
    """Name, seed and motion of each line of a file; none without one."""
    for line in path.read_text().splitlines() if path is not None and path.exists() else ():
        name, seed, one = json.loads(line)
        yield name, seed, Motion(**one)


def wheels() -> tuple[Path, Path] | None:
    """The policy and its scene."""
    places = [importlib.util.find_spec(name) for name in ("holosoma_inference", "holosoma", "onnxruntime")]
    if any(place is None or not place.submodule_search_locations for place in places):
        return None
    own, scene = (Path(next(iter(place.submodule_search_locations))) for place in places[:2])  # type: ignore[union-attr,arg-type]
    return (
        own / "models/loco/g1_29dof/fastsac_g1_29dof.onnx",
        scene / "data/robots/g1/scenes/scene_g1_29dof_wbt_plane.xml",
    )


class Policy:
    """Joint targets by gyro, gravity, joints and a command; the arms are masked, as at home and at rest."""

    def __init__(self, path: Path) -> None:
        import onnxruntime  # type: ignore[import-not-found]

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        self._net = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        told = self._net.get_modelmeta().custom_metadata_map
        self.kp, self.kd = (np.array(json.loads(told[gain])) for gain in ("kp", "kd"))
        self._action, self._phase = np.zeros(29), np.full(2, math.pi)

    def targets(self, R: Any, gyro: Any, q: Any, v: Any, command: Any) -> Any:
        """Targets of all joints ``(29,)`` [rad]; command: vx, vy [m/s], wz [rad/s]."""
        if np.abs(command).max() < 0.01:
            self._phase[:] = math.pi
        elif self._phase[0] == self._phase[1]:
            self._phase = np.array([0.0, math.pi])
        else:
            self._phase = np.fmod(self._phase + 2.0 * math.pi * PERIOD + math.pi, 2.0 * math.pi) - math.pi
        q, v = q.copy(), v.copy()
        q[BELOW:], v[BELOW:] = HOME[BELOW:], 0.0
        seen = (
            self._action, 0.25 * gyro, command[2:], command[:2], np.cos(self._phase), q - HOME, 0.05 * v, -R[2],
            np.sin(self._phase),
        )  # fmt: skip
        given = {"actor_obs": np.concatenate(seen).astype(np.float32)[None]}
        self._action = np.clip(self._net.run(None, given)[0][0], -100.0, 100.0).astype(float)
        return HOME + 0.25 * self._action


class Goal(NamedTuple):
    """Goal of a hand: in the world, over the base in its heading's axes, velocities of goal and base there ``(6,)``."""

    world: pin.SE3
    place: pin.SE3
    velocity: Any
    base: Any


def _rate(a: pin.SE3, b: pin.SE3) -> Any:
    """Velocity of a place from one tick to the next ``(6,)`` [m/s, rad/s]."""
    turn = a.rotation @ pin.log3(a.rotation.T @ b.rotation)
    return np.concatenate((b.translation - a.translation, turn)) / DT


@dataclass
class Course:
    """Drawn places of both hands over the pelvis: from its own posture to five others, in 1.6 s each, smooth."""

    points: list[list[pin.SE3]]
    way: float = 1.6
    rest: float = 0.3

    @classmethod
    def drawn(cls, robot: Any, rng: np.random.Generator) -> Course:
        """Places of drawn joint positions in front of the body, one in five too far away."""
        data, points = robot.model.createData(), [[], []]  # type: ignore[var-annotated]
        low, high = robot.lower[6:], robot.upper[6:]
        for k in range(6):
            for side, frame in enumerate(HANDS):
                while True:
                    q = np.concatenate(([0.0] * 6, [1.0], HOME))
                    if k:
                        span = 0.15 * (high - low)
                        q[7 + BELOW :] = rng.uniform(low + span, high - span)[BELOW:]
                    pin.framesForwardKinematics(robot.model, data, q)
                    place = data.oMf[robot.frame(frame)].copy()
                    if k == 0 or (place.translation[0] > 0.05 and -0.15 < place.translation[2] < 0.7):
                        break
                if k and rng.uniform() < 0.2:
                    place.translation = place.translation * (1.35, 1.35, 1.0)
                points[side].append(place)
        return cls(points)

    @property
    def length(self) -> float:
        """Duration [s]."""
        return 1.0 + (len(self.points[0]) - 1) * (self.way + self.rest)

    def goals(self, t: float, base: pin.SE3, command: Any) -> list[Goal]:
        """Goals of both hands over the axes of the base's heading; command: vx, vy [m/s], wz [rad/s] of the base."""
        then, twist = self.at(t + DT), np.array([*command[:2], 0.0, 0.0, 0.0, command[2]])
        return [Goal(base * a, a, _rate(a, b), twist) for a, b in zip(self.at(t), then, strict=True)]

    def at(self, t: float) -> list[pin.SE3]:
        """Places of both hands."""
        t = max(t - 1.0, 0.0)
        k = min(int(t / (self.way + self.rest)), len(self.points[0]) - 2)
        u = min((t - k * (self.way + self.rest)) / self.way, 1.0)
        s = u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
        found = []
        for places in self.points:
            a, b = places[k], places[k + 1]
            turn = a.rotation @ pin.exp3(s * pin.log3(a.rotation.T @ b.rotation))
            found.append(pin.SE3(turn, (1.0 - s) * a.translation + s * b.translation))
        return found


def upper_body(reach: float) -> Callable[..., Any]:
    def make(robot: Any, policy: Policy, masses: Any) -> UpperBody:
        return UpperBody(robot, policy, masses, reach)

    return make


class UpperBody:
    """hqp.UpperBody with the policy's gains."""

    def __init__(self, robot: Any, policy: Policy, masses: Any, reach: float) -> None:
        names = robot.joint_names
        declared = hqp.UpperBody(
            legs=names[:BELOW], hands=HANDS, reach=reach, joint_speed=SPEED, kp=policy.kp[BELOW:], kd=policy.kd[BELOW:]
        )
        self._robot, self._arms = robot, declared.session(robot, DT, deadline=math.inf)
        self._loads = [e.at(m, LOAD) for e, m in zip(self._arms.loads, masses, strict=True)]
        self.unsolved = 0

    def targets(self, q: Any, v: Any, aims: Sequence[Goal], holding: Any) -> Any:
        """Targets of the arms' servos ``(14,)`` [rad]."""
        state, arms = self._robot.state(q, v), self._arms
        goals = [
            arms.over_base(state, hand, aim.place.homogeneous, aim.velocity, aim.base)
            for hand, aim in zip(arms.hands, aims, strict=True)
        ]
        tick = arms.step(state, *goals, *self._loads)
        self.unsolved += not tick.tick.status.solved
        return tick.positions


class Pink:
    """Weighted inverse kinematics of the arms: cost 8, damping 3, which Unitree's users take, and held by gravity."""

    def __init__(self, robot: Any, policy: Policy, masses: Any) -> None:
        import pink
        from pink import tasks

        self._pink, self.unsolved = pink, 0
        model = _arms(robot.model)
        self._tasks = [tasks.FrameTask(f, 8.0, 2.0, lm_damping=3, gain=0.5) for f in HANDS]
        posture = tasks.PostureTask(cost=0.05)
        posture.set_target(HOME[BELOW:])
        self._all = [*self._tasks, posture, tasks.DampingTask(cost=0.05)]
        self._whole, self._data = robot.model, robot.model.createData()
        self._now = pink.Configuration(model, model.createData(), HOME[BELOW:].copy())

    def targets(self, q: Any, v: Any, aims: Sequence[Goal], holding: Any) -> Any:
        """Targets of the arms' servos ``(14,)`` [rad], with their holding torque over kp."""
        pin.forwardKinematics(self._whole, self._data, q)
        trunk = self._data.oMi[self._whole.njoints - 15]
        for task, aim in zip(self._tasks, aims, strict=True):
            task.set_target(trunk.inverse() * aim.world)
        try:
            self._now.integrate_inplace(self._pink.solve_ik(self._now, self._all, DT, "daqp", safety_break=False), DT)
        except Exception:
            self.unsolved += 1
        return self._sent(self._now.q.copy()) + holding

    def _sent(self, q: Any) -> Any:
        return q


def _arms(whole: Any) -> Any:
    """The arms alone, from the trunk that carries them."""
    model, trunk = pin.Model(), whole.njoints - 15
    new = {trunk: 0}
    for j in range(trunk + 1, whole.njoints):
        joint = getattr(pin, whole.joints[j].shortname())()
        new[j] = model.addJoint(new[whole.parents[j]], joint, whole.jointPlacements[j], whole.names[j])
        at, to = whole.joints[j].idx_q, model.nq - 1
        model.lowerPositionLimit[to] = whole.lowerPositionLimit[at]
        model.upperPositionLimit[to] = whole.upperPositionLimit[at]
    model.velocityLimit[:] = 37.0
    for frame in whole.frames:
        if frame.name in HANDS:
            model.addFrame(pin.Frame(frame.name, new[frame.parentJoint], frame.placement, pin.FrameType.BODY))
    return model


class Clamped(Pink):
    """Pink with joint targets clamped to ranges and speeds."""

    def __init__(self, robot: Any, policy: Policy, masses: Any) -> None:
        super().__init__(robot, policy, masses)
        self._low, self._high, self._last = robot.lower[6 + BELOW :], robot.upper[6 + BELOW :], HOME[BELOW:].copy()

    def _sent(self, q: Any) -> Any:
        self._last = np.clip(np.clip(q, self._last - CLAMPED * DT, self._last + CLAMPED * DT), self._low, self._high)
        return self._last


@dataclass
class Motion:
    """One motion; errors: both hands from their targets [m].  touches: judged configurations with one.  fast: rad/s."""

    fell: bool = False
    ticks: int = 0
    touches: int = 0
    judged: int = 0
    fast: float = 0.0
    unsolved: int = 0
    errors: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)

    @staticmethod
    def cells(runs: Sequence[Motion]) -> dict[str, str]:
        """Cells of a table of several motions, by column."""
        errors, cpu = (1e3 * np.concatenate(parts) for parts in ([r.errors for r in runs], [r.cpu for r in runs]))
        return {
            "motions": str(len(runs)),
            "falls": str(sum(r.fell for r in runs)),
            "hand error p50, p95 [mm]": _percentiles(errors, 95, 0),
            "motions with a self-contact": str(sum(r.touches > 0 for r in runs)),
            "configurations with a self-contact": f"{sum(r.touches for r in runs)} of {sum(r.judged for r in runs)}",
            "joints [rad/s]": f"{max(r.fast for r in runs):.1f}",
            "motions above 6 rad/s": str(sum(r.fast > FAST for r in runs)),
            "not solved": f"{sum(r.unsolved for r in runs)} of {sum(r.ticks for r in runs)}",
            "CPU of a tick p50, p99 [ms]": _percentiles(cpu, 99, 2),
        }


def _percentiles(numbers: Any, high: int, digits: int) -> str:
    """The median and another percentile; empty without numbers."""
    return f"{np.median(numbers):.{digits}f}, {np.percentile(numbers, high):.{digits}f}" if numbers.size else ""


def motion(files: tuple[Path, Path], make: Callable[..., Any], seed: int) -> Motion:
    """Seeds that three divides stand, pushed every ``PUSHES`` seconds, others walk; 0 to 2 kg in each hand."""
    import mujoco

    rng = np.random.default_rng(seed)
    masses, walks = rng.uniform(0.0, 2.0, 2), seed % 3 != 0
    command = np.array([rng.uniform(0.2, 0.6), 0.0, rng.uniform(-0.3, 0.3)]) * walks
    spec = mujoco.MjSpec.from_file(str(files[1]))
    for frame, mass in zip(HANDS, masses, strict=True):
        load = spec.body(frame).add_body(pos=LOAD)
        load.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.02, 0, 0], mass=max(mass, 1e-4), contype=0, conaffinity=0
        )
    model = spec.compile()
    data, still = mujoco.MjData(model), mujoco.MjData(model)
    robot, policy = hqp.robots.load(files[1]), Policy(files[0])
    course, arms, found = Course.drawn(robot, rng), make(robot, policy, masses), Motion()
    judge = Shapes(robot, _upper_body_pairs(robot))
    data.qpos[:] = np.concatenate(([0.0, 0.0, 0.79, 1.0, 0.0, 0.0, 0.0], HOME))
    mujoco.mj_forward(model, data)
    own, hands = slice(BELOW, 29), [model.body(frame).id for frame in HANDS]
    holding, target = np.zeros(model.nv), HOME.copy()
    for k in range(round(course.length / DT)):
        turned = np.empty(9)
        mujoco.mju_quat2Mat(turned, data.qpos[3:7])
        R = turned.reshape(3, 3)
        given = command if k > 50 else 0.0 * command
        if k % 2 == 0:
            target = policy.targets(R, data.qvel[3:6].copy(), data.qpos[7:], data.qvel[6:], given)
        turn = math.atan2(R[1, 0], R[0, 0])
        base = pin.SE3(pin.utils.rotate("z", turn), data.qpos[:3].copy())
        aims = course.goals(k * DT, base, given)
        q = np.concatenate((data.qpos[:3], data.qpos[[4, 5, 6, 3]], data.qpos[7:]))
        v = np.concatenate((R.T @ data.qvel[:3], data.qvel[3:]))
        still.qpos[:] = data.qpos
        mujoco.mj_kinematics(model, still)
        mujoco.mj_comPos(model, still)
        mujoco.mj_rne(model, still, 0, holding)
        start = time.process_time()
        sent = target.copy()
        sent[own] = arms.targets(q, v, aims, holding[6:][own] / policy.kp[own])
        found.cpu.append(time.process_time() - start)
        found.ticks += 1
        if not walks and k and k % round(PUSHES / DT) == 0:
            data.qvel[:2] += drawn_push(rng)
        for _ in range(round(DT / model.opt.timestep)):
            data.ctrl[:] = policy.kp * (sent - data.qpos[7:]) - policy.kd * data.qvel[6:]
            mujoco.mj_step(model, data)
        found.fast = max(found.fast, float(np.abs(data.qvel[6:][own]).max()))
        if k * DT > 1.0:
            found.errors += [
                float(np.linalg.norm(data.xpos[h] - aim.world.translation)) for h, aim in zip(hands, aims, strict=True)
            ]
        if k % 5 == 0:
            place = np.concatenate((data.qpos[:3], data.qpos[[4, 5, 6, 3]], data.qpos[7:]))
            found.judged += 1
            found.touches += judge.least(place) <= 0.0
        if data.qpos[2] < 0.45 or R[2, 2] < 0.5:
            found.fell = True
            break
    found.unsolved = arms.unsolved
    return found


def drawn_push(rng: np.random.Generator) -> Any:
    """Impulse over mass along x and y ``(2,)`` [m/s]."""
    angle = rng.uniform(0.0, 2.0 * math.pi)
    return PUSH * np.array([math.cos(angle), math.sin(angle)])


def _upper_body_pairs(robot: Any) -> Any:
    """The pairs of arms that hqp keeps apart."""
    declared = hqp.UpperBody(legs=robot.joint_names[:BELOW], hands=HANDS, output="velocities")
    stack = declared.controller(robot).stack
    return stack.find("collision")
