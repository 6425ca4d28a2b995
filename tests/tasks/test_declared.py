"""Elements by their readable functions: subclasses of built-in ones, a user's inequalities, and reports of `check`."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import hqp
import hqp.programs.assembly
import hqp.tasks as t
from hqp import PD, Inequality, Level, P, Stack, Task
from hqp.declare.element import REGISTRY, plan_of, selection_of
from hqp.errors import HqpError
from hqp.programs.assembly import Assembly
from tests.scenes.own_elements import ArmOnly

from .test_derivatives import CLASSES, NAMES, examples


@pytest.fixture(scope="module")
def cbi() -> Any:
    return hqp.robots.load("cbi")


@dataclass(frozen=True, kw_only=True)
class Halved(t.Posture):
    """Posture with rows other than those of the identity."""

    def jacobian(self, state: Any) -> Any:
        return 0.5 * super().jacobian(state)


@dataclass(frozen=True, kw_only=True)
class Named(t.Position):
    """Position that changes only its default name."""

    def default_name(self) -> str:
        return f"the {self.frame}"


@dataclass(frozen=True, kw_only=True)
class Ceiling(Inequality):
    """Two rows: the heights of a frame and of the centre of mass between two bounds."""

    frame: str
    low: float
    high: float

    def rows(self, robot: Any) -> int:
        robot.frame(self.frame)
        return 2

    def jacobian(self, state: Any) -> Any:
        return np.vstack((state.jacobian(self.frame)[2], state.com_jacobian()[2]))

    def drift(self, state: Any) -> Any:
        return np.array([state.drift(self.frame)[2], state.com_drift()[2]])

    def bounds(self, state: Any) -> Any:
        heights = np.array([state.position(self.frame)[2], state.com()[2]])
        return self.low - heights, self.high - heights

    def row_names(self, robot: Any) -> tuple[str, ...]:
        return (self.frame, "com")


# redefined functions replace native operations ------------------------------------------------------------------------


def test_a_redefined_jacobian_is_the_one_that_is_solved(cbi: Any) -> None:
    hand = ArmOnly(frame="r_palm", law=P(5.0))
    assert plan_of(hand, cbi) is None
    session = hqp.Controller(Stack(Level(hand))).session(cbi, 0.002)
    state = cbi.state()
    tick = session.step(state, hand.at(state.position("r_palm") + 0.05))
    A = session.problem.levels[0].dense(cbi.nv)
    assert not A[:, :6].any()
    assert np.abs(A - hand.jacobian(cbi.state())).max() < 1e-12
    assert np.abs(tick.solution.x[:6]).max() < 1e-12  # type: ignore[union-attr]


def test_a_redefined_jacobian_of_rows_that_pick(cbi: Any) -> None:
    posture = Halved(joints="r_arm", law=P(1.0))
    assert selection_of(posture, cbi) is None
    assert selection_of(t.Posture(joints="r_arm"), cbi) is not None
    session = hqp.Controller(Stack(Level(posture))).session(cbi, 0.002)
    session.step(cbi.state())
    assert np.abs(session.problem.levels[0].dense(cbi.nv)).max() == 0.5


def test_what_says_nothing_of_the_rows_keeps_the_plan(cbi: Any) -> None:
    assert plan_of(Named(frame="r_palm"), cbi) is not None
    assert plan_of(t.OmniWheelContact(wheel="r_palm", radius=0.1, axle=(0.0, 1.0, 0.0)), cbi) is not None


# inequalities ---------------------------------------------------------------------------------------------------------

LAWS: list[Any] = [
    P(3.0),
    P((2.0, 5.0)),
    P(3.0, max_velocity=0.2),
    P(3.0, max_acceleration=0.5),
    PD(9.0, 5.0),
    PD((9.0, 4.0), (5.0, 3.0), max_velocity=0.3),
    PD(9.0, 5.0, max_acceleration=0.7),
    PD(0.0, 5.0, max_velocity=0.2, max_acceleration=0.7),
]


@pytest.mark.skipif(hqp.programs.assembly.native is None, reason="no native assembly here")
@pytest.mark.parametrize("law", LAWS, ids=str)
@pytest.mark.parametrize("high", [1.1, np.inf])
def test_native_laws_of_bounds_equal_readable_ones(
    cbi: Any, law: Any, high: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    element = Ceiling(frame="r_palm", low=0.7, high=high, name="ceiling", weight=2.5)
    reference = hqp.Reference("ceiling", velocity=np.array([0.1, -0.2]), acceleration=np.array([0.3, 0.1]))
    fast = Assembly([element], [], cbi, 0.002, {"ceiling": law})
    monkeypatch.setattr(hqp.programs.assembly, "native", None)
    slow = Assembly([element], [], cbi, 0.002, {"ceiling": law})
    rng = np.random.default_rng(2)
    for k in range(20):
        state = cbi.state(cbi.random_configuration(rng), rng.normal(size=cbi.nv))
        for rows in (fast, slow):
            rows.fill(state, {"ceiling": reference}, [reference] if k % 2 else [])
        assert np.array_equal(np.isfinite(fast.upper), np.isfinite(slow.upper))
        assert (fast.lower <= fast.upper).all()
        for x, y in ((fast.lower, slow.lower), (fast.upper, slow.upper), (fast.J, slow.J)):
            finite = np.isfinite(y)
            assert np.abs(x[finite] - y[finite]).max(initial=0.0) < 1e-11


def test_a_law_approaches_a_bound(cbi: Any) -> None:
    """gain d at velocity level, kp d - kd J v - dJ/dt v at acceleration level, and no faster than max_velocity."""
    element = Ceiling(frame="r_palm", low=-np.inf, high=1.5, name="ceiling")
    state = cbi.state(cbi.home, 0.1 * np.ones(cbi.nv))
    d = element.bounds(state)[1]
    J, drift = element.jacobian(state), element.drift(state)
    for law, expected in (
        (P(3.0), 3.0 * d),
        (P(3.0, max_velocity=0.2), np.minimum(3.0 * d, 0.2)),
        (PD(9.0, 5.0), 9.0 * d - 5.0 * (J @ state.v) - drift),
    ):
        rows = Assembly([element], [], cbi, 0.002, {"ceiling": law})
        rows.fill(state, {"ceiling": hqp.Reference("ceiling")}, ())
        np.testing.assert_allclose(rows.upper, expected, atol=1e-12)
        np.testing.assert_array_equal(rows.lower, np.full(2, -law.max_velocity))  # no lower bound, but a speed limit


@pytest.mark.parametrize("formulation", [hqp.Velocity(), hqp.Acceleration()], ids=["velocity", "acceleration"])
def test_a_bound_is_kept_in_the_loop(cbi: Any, formulation: Any) -> None:
    """The hand is sent above the ceiling: it approaches as the law allows and never passes."""
    hand = t.Position(frame="r_palm")
    start = cbi.state().position("r_palm")
    ceiling = Ceiling(frame="r_palm", low=-np.inf, high=start[2] + 0.03, name="ceiling")
    feet = [t.FixedContact(frame="l_sole"), t.FixedContact(frame="r_sole")]
    stack = Stack(Level(*feet), Level(hand), subject_to=[ceiling])
    session = hqp.Controller(stack, formulation, price=0).session(cbi, 0.002)
    q, v, highest = cbi.home, np.zeros(cbi.nv), 0.0
    for _ in range(1500):
        tick = session.step(cbi.state(q, v), hand.at(start + [0.05, 0.0, 0.1]))
        assert tick.status is hqp.Status.OPTIMAL
        highest = max(highest, cbi.state(q).position("r_palm")[2] - start[2])
        q, v = tick.advance()
    assert 0.028 < highest < 0.03 + 1e-9
    assert tick.explain()["ceiling"].active == ("r_palm upper",)


def test_shapes_that_do_not_fit_are_told(cbi: Any) -> None:
    @dataclass(frozen=True, kw_only=True)
    class _Wide(t.Position):
        def jacobian(self, state: Any) -> Any:
            return super().jacobian(state)[0]

    session = hqp.Controller(Stack(Level(_Wide(frame="r_palm")))).session(cbi, 0.002)
    for _ in range(2):
        tick = session.step(cbi.state())
        (note,) = (n for n in tick.notes if n.element == "r_palm")
        assert note.status is hqp.Status.INVALID_ELEMENT
        assert "jacobian has shape (57,); allowed: shape (3, 57)" in note.detail


# check ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", CLASSES)
def test_check_finds_nothing_wrong_with_the_library(cbi: Any, name: str) -> None:
    for element in examples(NAMES["cbi"])[name]:
        found = hqp.check(element, cbi, states=1)
        assert found.ok, str(found)


def broken(**functions: Any) -> Task:
    """A Position with wrapped functions: each gets (task, state, right answer)."""

    def wrapped(name: str, wrap: Any) -> Any:
        return lambda self, *given: wrap(self, given[0], getattr(t.Position, name)(self, *given))

    body = {name: wrapped(name, wrap) for name, wrap in functions.items()}
    cls: Any = dataclass(frozen=True, kw_only=True)(type("_Broken", (t.Position,), body))
    return cls(frame="r_palm", relative_to="pelvis", name="broken")  # type: ignore[no-any-return]


@pytest.mark.parametrize(
    ("functions", "said"),
    [
        ({"jacobian": lambda self, s, J: -J}, "jacobian has the wrong sign"),
        ({"jacobian": lambda self, s, J: J * [[1.0], [-1.0], [1.0]]}, "wrong sign in row 1"),
        ({"jacobian": lambda self, s, J: 2.0 * J}, "2 times the rate"),
        ({"jacobian": lambda self, s, J: s.rotation("r_palm").T @ J}, "in the axes of frame 'r_palm'"),
        ({"jacobian": lambda self, s, J: s.rotation("pelvis") @ J}, "in the axes of the world"),
        ({"jacobian": lambda self, s, J: s.jacobian("r_palm")[:3]}, "jacobian is not the rate of the value"),
        ({"jacobian": lambda self, s, J: J[:2]}, r"jacobian has shape \(2, 57\)"),
        (
            {"jacobian": lambda self, s, J: J * (np.arange(57) != s.robot.joints("R_EB")[0])},
            "columns of .* are zero, a term is missing",
        ),
        ({"drift": lambda self, s, d: -d}, "drift has the wrong sign"),
        ({"drift": lambda self, s, d: 0.0 * d}, "drift is zero"),
        ({"drift": lambda self, s, d: d + 0.1}, "not quadratic in v"),
        ({"drift": lambda self, s, d: 1.1 * d}, "a term is missing or wrong"),
        ({"drift": lambda self, s, d: d[:2]}, r"drift has shape \(2,\)"),
        ({"error": lambda self, s, e: e[:2]}, r"error has shape \(2,\)"),
        ({"error": lambda self, s, e: e * (np.nan if s.q[7:].any() == 0 else 1.0)}, "error is not finite with all"),
    ],
)
def test_check_says_what_is_wrong(cbi: Any, functions: dict[str, Any], said: str) -> None:
    found = hqp.check(broken(**functions), cbi)
    assert not found.ok
    with pytest.raises(AssertionError, match=said):
        raise AssertionError(str(found))


def test_check_knows_a_spatial_acceleration(cbi: Any) -> None:
    @dataclass(frozen=True, kw_only=True)
    class _Spatial(t.Position):
        def drift(self, state: Any) -> Any:
            v = state.velocity(self.frame)
            return super().drift(state) - np.cross(v[3:], v[:3])

    assert "lacks omega x v of frame 'r_palm'" in str(hqp.check(_Spatial(frame="r_palm"), cbi))


def test_check_of_inequalities(cbi: Any) -> None:
    assert hqp.check(Ceiling(frame="r_palm", low=0.0, high=1.0, name="c"), cbi).ok
    assert hqp.check(Ceiling(frame="r_palm", low=-np.inf, high=1.0, name="c"), cbi).ok

    @dataclass(frozen=True, kw_only=True)
    class _Floor(Ceiling):
        def bounds(self, state: Any) -> Any:
            lower, upper = super().bounds(state)
            return -upper, -lower

    found = hqp.check(_Floor(frame="r_palm", low=0.0, high=1.0, name="c"), cbi)
    assert "wrong sign" in str(found)
    with pytest.raises(hqp.HqpError, match="no rows on the robot's motion"):
        hqp.check(t.TorqueLimits(), cbi)


BAD = (
    math.nan, math.inf, -1.0, 0.0, -1, True, None, "", "nope", "xx", "\x00", b"x", (), {}, set(), (1, 2),
    (math.nan,) * 3,
    np.zeros(3), np.zeros((3, 3)), np.full(3, math.nan), np.array(5), np.float32(1.0), object(), print, 1j, (None,) * 3,
    {"a": math.nan}, ("nope", "nope"), range(3), 10**400, (10**400,) * 3, 1e300, Level(t.Com()),
)  # fmt: skip


@pytest.mark.parametrize("name", [name for name, cls in REGISTRY.items() if cls.__module__.startswith("hqp.tasks")])
@pytest.mark.filterwarnings("ignore")
def test_whatever_is_given_the_error_is_ours(cbi: Any, name: str) -> None:
    """Each field with each bad value: accepted, or refused by the declaration or the row count on a robot."""
    hand, sole = "r_palm", "l_sole"
    some: dict[str, Any] = {
        "frame": hand, "contact": sole, "wheel": "r_palm", "other": "pelvis", "task": t.Position(frame=hand), "mu": 0.5,
        "rectangle": (-0.1, 0.1, -0.05, 0.05), "relative_to": "pelvis", "force": 10.0, "upper": 5.0, "radius": 0.1,
        "coefficients": {"r_elbow": 1.0}, "joints": None, "linear": 1.0,
    }  # fmt: skip
    own = {
        "EdgeContact": {"axis": "y"}, "Cone": {"task": t.AlignAxis(frame=hand), "angle": 0.3},
        "SupportPolygon": {"sole": (-0.1, 0.1, -0.05, 0.05)}, "Frozen": {"joints": cbi.joint_names[0]},
        "LoadShare": {"contacts": (sole, "r_sole")}, "Admittance": {"damping": 50.0},
        "PrescribedMotion": {"joints": ()}, "Hinge": {"axis": "y"},
    }  # fmt: skip
    cls: Any = REGISTRY[name]
    needed = [
        f.name for f in dataclasses.fields(cls) if f.init and f.default is f.default_factory is dataclasses.MISSING
    ]
    fields = {**{k: some[k] for k in needed if k in some}, **own.get(name, {})}
    if name in ("ForceLimits", "Weld", "Within", "BaseVelocityLimits"):
        fields |= {
            "ForceLimits": {"force": 10.0}, "Weld": {"relative_to": "pelvis"}, "Within": {"upper": 5.0},
            "BaseVelocityLimits": {"linear": 1.0},
        }[name]  # fmt: skip
    told = []
    for field in (f.name for f in dataclasses.fields(cls) if f.init):
        for bad in BAD:
            try:
                element = cls(**{**fields, field: bad})
                if isinstance(bad, (str, tuple)):
                    element.rows(cbi)
            except HqpError as error:
                told.append(str(error))
    assert told
    assert min(map(len, told)) > 20


@pytest.mark.parametrize(
    "element",
    [
        t.Pose(frame="r_palm"), t.Position(frame="r_palm"), t.Orientation(frame="r_palm"), t.AlignAxis(frame="r_palm"),
        t.LowAcceleration(), t.JointVelocity(), t.Com(), t.Payload(frame="r_palm"), t.ExternalWrench(frame="r_palm"),
        t.CollisionAvoidance(), t.Within(t.Position(frame="r_palm"), upper=1.0), t.ContactForce(contact="l_sole"),
        t.Impedance(frame="r_palm"),
    ],
    ids=lambda e: type(e).__name__,
)  # fmt: skip
@pytest.mark.filterwarnings("ignore")
def test_whatever_a_reference_is_given_the_error_is_ours(element: Any) -> None:
    refused, others = 0, set()
    for bad in BAD:
        for arguments in ((bad,), (None,)):
            for rates in ({}, {"velocity": bad}, {"acceleration": bad}):
                try:
                    element.at(*arguments, **rates)
                except HqpError:
                    refused += 1
                except TypeError as error:
                    others.add(str(error).partition("argument")[1])  # no argument of that name
    assert refused > 10
    assert others <= {"argument"}
