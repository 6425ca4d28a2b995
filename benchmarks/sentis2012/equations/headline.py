"""The controller of the experiments rebuilt from formulas alone: rows, laws, gravity compensation, contact forces.

It uses no Jacobian, demand or normal of the session that it judges.  The rows: CoM, yaw and hand in the heading of the
base, each with its drift; the laws have their saturation and reference velocities; tau = shift + the compensated law
+ N*^T tau_g (eqs. 27, 48 to 62), with tau_g the torque that holds the robot on the rows' normals, and shift the
addition of the ground's own normals.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

import hqp
from benchmarks.reports.back_ends import answers
from benchmarks.reports.checks import Check, at_most, seen_to_fail
from benchmarks.sentis2012.equations.constraints import Reduced
from benchmarks.sentis2012.equations.ground import WHEELS, Ground, Snapshot, relative, skew
from benchmarks.sentis2012.equations.law import Demand, compensated, prioritise
from benchmarks.sentis2012.experiments.compliance import Compliance, stack
from hqp.arrays import Mat, Vec
from hqp.declare.reference import Reference
from hqp.tasks import UnilateralContact
from tests.scenes.sentis2012 import EXACT

SEED = 2014
UP = np.array([0.0, 0.0, 1.0])
CHOICE = Compliance()
"""Controller of the experiments."""


@dataclass(frozen=True)
class Goals:
    """Goals of one tick, their velocities, and the ground's normal under each wheel ``(3, 3)``."""

    com: Vec
    com_rate: Vec
    yaw: float
    yaw_rate: float
    hand: Vec
    hand_rate: Vec
    posture: Vec
    ground: Mat

    def references(self, tasks: hqp.Stack, normal: Vec) -> list[Reference]:
        """References of the session; ``normal``: of the wheels' rows."""
        found = {e.name: e for e in tasks}
        return [
            found["com"].at(self.com, velocity=self.com_rate),  # type: ignore[attr-defined]
            found["yaw"].at(self.yaw, velocity=self.yaw_rate),  # type: ignore[attr-defined]
            found["hand"].at(self.hand, velocity=self.hand_rate),  # type: ignore[attr-defined]
            found["posture"].at(self.posture),  # type: ignore[attr-defined]
            *(
                found[w].at(normal=normal, gravity_normal=n)  # type: ignore[attr-defined]
                for w, n in zip(WHEELS, self.ground, strict=True)
            ),
        ]


class Formulas:
    """The controller at one snapshot, by definition; normal: of the wheels' rows."""

    def __init__(self, s: Snapshot, goals: Goals, choice: Compliance = CHOICE) -> None:
        self.s, self.goals, self.choice = s, goals, choice
        self.reduced = Reduced.of(s)
        self._base()

    def _base(self) -> None:
        """Yaw psi of the base's x axis a:  d psi = (a x da)_z / (a_x^2 + a_y^2), as a row and its time derivative."""
        s = self.s
        self.p, R, self.J, self.dJ = s.frame("base")
        a, turn = R[:, 0], self.J[3:] @ s.v
        da = np.cross(turn, a)
        A, dA = -skew(a) @ self.J[3:], -skew(da) @ self.J[3:] - skew(a) @ self.dJ[3:]  # da = A v
        square = a[0] ** 2 + a[1] ** 2
        top = a[0] * A[1] - a[1] * A[0]
        dtop = da[0] * A[1] - da[1] * A[0] + a[0] * dA[1] - a[1] * dA[0]
        self.psi = math.atan2(a[1], a[0])
        self.yaw = top / square
        self.dyaw = dtop / square - top * (2.0 * (a[0] * da[0] + a[1] * da[1])) / square**2
        c, sine = math.cos(self.psi), math.sin(self.psi)
        self.turned = np.array([[c, sine, 0.0], [-sine, c, 0.0], [0.0, 0.0, 1.0]])  # world to heading

    def seen(self, x: Vec, J: Mat, dJ: Mat) -> tuple[Vec, Mat, Mat]:
        """A point in the base's heading: y = Rz^T (x - p), dy = Rz^T (dx - dp - d psi z x (x - p))."""
        s, d = self.s, x - self.p
        rate = float(self.yaw @ s.v)
        dd = (J - self.J[:3]) @ s.v
        z = skew(UP)
        own = J - self.J[:3] - np.outer(z @ d, self.yaw)
        own_rate = dJ - self.dJ[:3] - np.outer(z @ dd, self.yaw) - np.outer(z @ d, self.dyaw)
        return self.turned @ d, self.turned @ own, self.turned @ (own_rate - rate * z @ own)

    def tasks(self) -> list[tuple[Mat, Mat, Vec]]:
        """J, dJ/dt and the desired acceleration of each level."""
        s, goals, choice = self.s, self.goals, self.choice
        found = []
        c, J, dJ, _ = s.upper_body()
        y, J, dJ = self.seen(c, J, dJ)
        J, dJ = J[:2], dJ[:2]
        found.append((J, dJ, law(choice.com, y[:2] - goals.com, J @ s.v - goals.com_rate, choice.com_acceleration)))
        J, dJ = self.yaw[None], self.dyaw[None]
        error = np.array([math.remainder(self.psi - goals.yaw, math.tau)])
        found.append((J, dJ, law(choice.yaw, error, J @ s.v - goals.yaw_rate)))
        x, _, J, dJ = s.frame("hand_point")
        y, J, dJ = self.seen(x, J[:3], dJ[:3])
        found.append((J, dJ, law(choice.hand, y - goals.hand, J @ s.v - goals.hand_rate)))
        J = s.ground.S
        found.append((J, 0.0 * J, law(choice.posture, self.angles - goals.posture, J @ s.v)))
        return found

    @property
    def angles(self) -> Vec:
        """Joint angles of the upper body, read from q joint by joint."""
        model = self.s.model
        names = [self.s.ground.robot.joint_name(int(i)) for i in self.s.ground.upper]
        return np.array([self.s.q[model.joints[model.getJointId(name)].idx_q] for name in names])

    def holding(self, normals: Sequence[Vec] | None = None) -> Vec:
        """UNbar^T g on wheels that stand on these normals (eqs. 22, 57)."""
        J = self.s.J if normals is None else self.s.assemble(normals=dict(zip(WHEELS, normals, strict=True)))[0]
        both = np.linalg.inv(np.vstack((J, self.s.ground.U)))
        return np.asarray(both[:, J.shape[0] :].T @ self.s.gravity)

    @property
    def shift(self) -> Vec:
        """Torque that the ground's own normals add to the one that holds the robot."""
        return self.holding(self.goals.ground) - self.holding()

    def torque(self, sign: float = 1.0) -> Vec:
        """shift + compensated law + N*^T tau_g; sign -1 reverses the shift as a negative control."""
        asked = [Demand(*self.s.star(J, dJ), a) for J, dJ, a in self.tasks()]
        steps = prioritise(self.reduced.phi, [task.J for task in asked])
        tau = compensated(self.reduced.phi, self.reduced.h, asked, self.s.q_act)
        return sign * self.shift + tau + steps[-1].N.T @ self.holding()

    def forces(self, tau: Vec) -> Vec:
        """Forces on the robot ``(7,)``, -lambda of the linear system of eq. (2), for tau without its shift."""
        return -self.s.kkt(tau - self.shift)[1]


def law(kp: float, e: Vec, rate: Vec, most: float = math.inf) -> Vec:
    """-kp e - 2 sqrt(kp) de/dt, its norm at most ``most``."""
    a = -kp * e - 2.0 * math.sqrt(kp) * rate
    size = float(np.linalg.norm(a))
    return np.asarray(a * (most / size) if size > most else a)


def goals_near(s: Snapshot, degrees: float = 7.0) -> Goals:
    """Goals off the state's values, the CoM's by enough to saturate its law, and normals with random tilts."""
    rng = s.rng
    here = Formulas(s, _NOTHING)
    com, _, _ = here.seen(*s.upper_body()[:3])
    x, _, J, dJ = s.frame("hand_point")
    hand, _, _ = here.seen(x, J[:3], dJ[:3])
    ground = np.tile(s.ground.normal, (3, 1)) + math.radians(degrees) * rng.normal(size=(3, 3))
    return Goals(
        com[:2] + rng.choice((0.002, 0.02)) * rng.normal(size=2),
        0.3 * rng.normal(size=2),
        here.psi + 3.0 * rng.normal(),
        0.5 * rng.normal(),
        hand + 0.05 * rng.normal(size=3),
        0.3 * rng.normal(size=3),
        here.angles + 0.1 * rng.normal(size=9),
        ground / np.linalg.norm(ground, axis=1)[:, None],
    )


_NOTHING = Goals(np.zeros(2), np.zeros(2), 0.0, 0.0, np.zeros(3), np.zeros(3), np.zeros(9), np.tile(UP, (3, 1)))


def checks(ground: Ground, count: int) -> Iterator[Check]:
    """Every row on one slope at ``count`` random states."""
    ground = Ground(ground.degrees, rotors=True)
    yield from _torque(ground, count)
    yield from _forces(ground, count)
    yield from _cones(ground, max(count // 2, 3))


def _stepped(
    ground: Ground, tasks: hqp.Stack, solver: str, count: int, seed: int, choice: Compliance = CHOICE
) -> Iterator[tuple[Formulas, hqp.Session, hqp.Tick]]:
    formulation = hqp.Torque(gravity_compensation=True, loop_law=EXACT)
    session = hqp.Controller(tasks, formulation, solver=solver, price=0, deadline=math.inf).session(
        ground.robot, dt=choice.period
    )
    for s in ground.states(count, seed):
        goals = goals_near(s)
        tick = session.step(ground.robot.state(s.q, s.v), *goals.references(tasks, ground.normal))
        yield Formulas(s, goals, choice), session, tick


def _torque(ground: Ground, count: int) -> Iterator[Check]:
    label = f"{ground.label}, with rotors"
    tasks = stack(CHOICE)
    text = "torque of the experiments' session = rows, laws and eq. (27) by hand: {}, relative"
    wrong, cases = [], []
    for solver in ("lexicographic", "nullspace"):
        off = []
        for f, session, tick in _stepped(ground, tasks, solver, count, SEED):
            tau = f.torque()
            off.append(relative(tick.command - tau, tau))
            if solver == "lexicographic":
                wrong.append(relative(tick.command - f.torque(sign=-1.0), tau))
                cases.append((session.problem.copy(), tau))
        yield at_most("S(27), (48)-(62)", text.format(solver), label, 1e-8, off, kind="product")
    text = "the same, sign of the gravity shift turned: relative torque"
    yield seen_to_fail("S(27), (48)-(62)", text, label, 1e-8, wrong)
    yield from answers(
        "S(27), (48)-(62)", "torque of the experiments by hand", label, 1e-8, cases[: max(3, count // 4)]
    )


def _forces(ground: Ground, count: int) -> Iterator[Check]:
    """The session's contact forces, of contacts with weights, against the linear system of eq. (2)."""
    off = []
    tasks = weighted(stack(CHOICE))
    order = [e for e in tasks.subject_to if e.name in ("biarticular", *WHEELS)]
    for f, session, tick in _stepped(ground, tasks, "nullspace", count, SEED + 1):
        tau = tick.command
        found = session.program.contact_forces(tau - f.shift)  # type: ignore[attr-defined]
        true = f.forces(tau)
        off.append(relative(np.concatenate([found[e.name] for e in order]) - true, true))
    text = "contact forces of contacts with weights = -lambda of KKT, relative"
    yield at_most("S(3)", text, f"{ground.label}, with rotors", 1e-9, off, kind="product")


def weighted(tasks: hqp.Stack) -> hqp.Stack:
    """Add weights to the stack's contacts, which scale rows and change no motion and no force."""
    sizes = {"biarticular": 0.5, **dict(zip(WHEELS, (2.0, 0.3, 5.0), strict=True))}
    held = [replace(e, weight=sizes[e.name]) if e.name in sizes else e for e in tasks.subject_to]
    return hqp.Stack(*tasks.levels, subject_to=held)


def _cones(ground: Ground, count: int) -> Iterator[Check]:
    """Active bounds on forces, on ground with its own normals: by KKT the forces lie on the bounds, not beyond."""
    label = f"{ground.label}, with rotors"
    mu, least = 0.05, 250.0
    slippery = stack(Compliance(limits=True, friction=mu, com_acceleration=math.inf))
    pressed = stack(Compliance(com_acceleration=math.inf))
    pressed = hqp.Stack(
        *pressed.levels,
        subject_to=[*pressed.subject_to, *(UnilateralContact(contact=w, minimum=least) for w in WHEELS)],
    )
    choice = Compliance(com_acceleration=math.inf)
    for tasks, text in (
        (slippery, f"friction {mu}"),
        (pressed, f"loads of at least {least:g} N"),  # not scale-free: a weight that is lost shows
    ):
        excess = []
        for f, _, tick in _stepped(ground, weighted(tasks), "lexicographic", count, SEED + 2, choice):
            force = f.forces(tick.command)[1:].reshape(3, 2)  # rolling, normal
            off = np.abs(force[:, 0]) - mu * force[:, 1] if tasks is slippery else least - force[:, 1]
            excess.append(float(off.max()))
        text = f"{text}, normals of the ground, weights: {{}} by KKT [N]"
        yield at_most("S beyond", text.format("no force beyond"), label, 1e-6, excess, kind="product")
        reached = abs(float(np.median(excess)))
        text = text.format("the largest force lies on the bound (median)")
        yield at_most("S beyond", text, label, 1e-6, [reached], kind="product")
