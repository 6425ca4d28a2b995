"""Rows on torques and on contact forces, the two quantities beside motion that a torque hierarchy binds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Any

import numpy as np

from hqp.arrays import Index, Mat, Vec
from hqp.declare.element import Element, Inequality, plan_of, selection_of
from hqp.declare.plans import Constant
from hqp.declare.readable import ground_of
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot, State
from hqp.errors import DeclarationError
from hqp.problem import Rows, Selection
from hqp.programs.assembly import Assembly
from hqp.torque.rows import demand_rows
from hqp.torque.shared import GroundAxes, Shared, blocks, named, require_standing


@dataclass(frozen=True, eq=False)
class _Effort:
    """An element on tau and the bounds it writes each tick; constant: its plan where those never change."""

    element: Element
    lower: Vec
    upper: Vec
    constant: Constant | None


class Efforts:
    """Elements that each pick torques: targets or bounds of tau, refilled each tick.

    Raises DeclarationError for an element without a selection.
    """

    def __init__(self, elements: Sequence[Element], robot: Robot) -> None:
        self._elements: dict[str, Element] = {}
        self._picks: dict[str, Index] = {}
        self._written: list[_Effort] = []
        self._robot = robot
        self.names = frozenset(element.name for element in elements)
        self.out: Set[str] = frozenset()
        """Names of elements that are out."""
        for element in elements:
            picks = selection_of(element, robot)
            if picks is None:
                raise element.invalid(
                    "has no selection of torques", type(element).__name__, "selection(robot) where quantity is effort"
                )
            self._elements[element.name], self._picks[element.name] = element, picks

    def __bool__(self) -> bool:
        return bool(self._elements)

    def rows(self, name: str) -> int:
        """Number of rows of an element."""
        return int(self._picks[name].size)

    def place(self, name: str, here: slice, A: Mat, bounds: Mat) -> None:
        """Write an element's rows at ``here`` of a block, its bounds there each tick."""
        picks = self._picks[name]
        A[here] = 0.0
        A[here][np.arange(picks.size), picks] = self._elements[name].weight
        self._add(name, *bounds[:, here])

    def bounds(self, names: Sequence[str]) -> Rows:
        """Elements as one level of simple bounds."""
        scale = np.concatenate([np.full(self.rows(name), self._elements[name].weight) for name in names])
        lower, upper = np.full(scale.size, -np.inf), np.full(scale.size, np.inf)
        at = 0
        for name in names:
            here = slice(at, at + self.rows(name))
            self._add(name, lower[here], upper[here])
            at = here.stop
        return Rows(Selection(np.concatenate([self._picks[name] for name in names]), scale), lower, upper)

    def _add(self, name: str, lower: Vec, upper: Vec) -> None:
        element = self._elements[name]
        plan = plan_of(element, self._robot)
        constant = plan if isinstance(plan, Constant) else None
        if not element.equality and constant is None and not isinstance(element, Inequality):
            raise element.invalid("has no bounds(state)", type(element).__name__, "an Inequality, or a target")
        self._written.append(_Effort(element, lower, upper, constant))

    @property
    def fixed(self) -> bool:
        """True if no bound changes except with a reference."""
        return all(effort.constant is not None or effort.element.equality for effort in self._written)

    @property
    def moving(self) -> str:
        """An element whose bounds change."""
        return next(e.element.name for e in self._written if e.constant is None and not e.element.equality)

    @property
    def sizes(self) -> dict[str, int]:
        """Size of the target of each equality, by name."""
        return {e.element.name: int(e.lower.size) for e in self._written if e.element.equality}

    def aim(self, references: Mapping[str, Reference]) -> None:
        """Take the targets of equalities."""
        for effort in self._written:
            if effort.element.equality and effort.element.name not in self.out:
                value = references[effort.element.name].value
                effort.lower[:] = effort.upper[:] = 0.0 if value is None else effort.element.weight * value

    def fill(self, state: State, references: Mapping[str, Reference]) -> None:
        """Refill the bounds; a target is the reference's value, zero without one."""
        for effort in self._written:
            element, lower, upper = effort.element, effort.lower, effort.upper
            if element.name in self.out:
                lower[:], upper[:] = -np.inf, np.inf
                continue
            if effort.constant is not None:
                np.copyto(lower, effort.constant.lower)
                np.copyto(upper, effort.constant.upper)
            elif element.equality:
                value = references[element.name].value
                if value is not None and value.shape != lower.shape:
                    raise element.invalid("value of shape", value.shape, f"shape {lower.shape}")
                lower[:] = upper[:] = 0.0 if value is None else value
            elif isinstance(element, Inequality):
                lower[:], upper[:] = element.bounds(state)
            if element.weight != 1.0:
                lower *= element.weight
                upper *= element.weight


class Forces:
    """Elements on the force of a reaction constraint: lower <= C f <= upper, f in contact axes, -lambda seen in them.

    Rows of a contact that are in world axes are turned into its axes on the ground (``GroundAxes``); a contact whose
    rows are not simply a force ``(3,)`` or a wrench ``(6,)`` defines them by ``force_basis()`` ``(3 or 6, m)``.
    An equality is a target for C f, zero or the reference's value.
    """

    def __init__(self, elements: Sequence[Element], held: Sequence[Element], rows: Assembly, robot: Robot) -> None:
        self._elements = {e.name: e for e in elements}
        self._places: dict[str, slice] = {}
        m = sum(rows.members[e.name].part.stop - rows.members[e.name].part.start for e in held)
        by_name = {e.name: e for e in held}
        names = [name for e in elements for name in getattr(e, "contacts", (getattr(e, "contact", ""),))]
        seen = [by_name[name] for name in dict.fromkeys(names) if name in by_name]
        on_ground = [c for c in seen if blocks(c, c.rows(robot))]
        require_standing(on_ground, robot)
        self.ground = {c.name: GroundAxes.of(c, rows, robot) for c in on_ground}
        self._normals = [(c.name, self.ground[c.name].normal, ground_of(c)) for c in on_ground]
        parts = [np.zeros((0, m))]
        lower: list[Vec] = [np.zeros(0)]
        upper: list[Vec] = [np.zeros(0)]
        at = 0
        self._shared: list[Shared] = []
        for element in elements:
            if hasattr(element, "contacts"):
                shared = Shared.of(element, by_name, rows, self.ground, slice(at, at + 6))
                self._shared.append(shared)
                whole, low, high = np.zeros((6, m)), np.zeros(6), np.zeros(6)
            else:
                contact = named(element, getattr(element, "contact", ""), by_name)
                part = rows.members[contact.name].part
                C, low, high = _force_rows(element, contact, part.stop - part.start)
                whole = np.zeros((C.shape[0], m))
                whole[:, part] = C * (-contact.weight * element.weight)
            parts.append(whole)
            lower.append(low * element.weight)
            upper.append(high * element.weight)
            self._places[element.name] = slice(at, at + whole.shape[0])
            at += whole.shape[0]
        self._C, self._bounds = np.vstack(parts), np.array((np.concatenate(lower), np.concatenate(upper)))
        self._lower, self._upper = self._bounds
        self._declared = self._bounds.copy()
        self._out: list[slice] = []
        self._frames: list[dict[str, Any]] = []  # turn rows from world axes to those on the ground
        for contact in on_ground:
            part, axes = rows.members[contact.name].part, self.ground[contact.name].axes
            turned = blocks(contact, part.stop - part.start)
            self._frames += [{"first": part.start + block.start, "rotation": axes} for block in turned]
        apart = {shared.element.name for shared in self._shared}
        given = [e for e in elements if e.equality and e.name not in apart]
        self._targets = [(e.name, self._places[e.name], e.weight) for e in given]
        self._plan: list[tuple[slice, slice, Mat, Mat]] = []

    @property
    def parts(self) -> dict[str, Any] | None:
        """Data of the native rows once every element has its place, also for a file; None without any."""
        if not self._elements:
            return None
        return {
            "ground": [ground.parts for ground in self.ground.values()],
            "frames": self._frames,
            "shared": [self._shares(shared) for shared in self._shared],
            "rows": [
                {"C": self._C[own], **demand_rows(A[here], self._bounds[:, own], bounds[:, here])}
                for own, here, A, bounds in self._plan
            ],
        }

    def _shares(self, shared: Shared) -> dict[str, Any]:
        one, other = shared.ground
        return {
            "C": self._C[shared.own],
            "first": [part.start for part in shared.parts],
            "one": one.axes,
            "other": other.axes,
            "one_sole": one.rotation,
            "other_sole": other.rotation,
            "middles": [x for middle in shared.element.middles or ((0.0, 0.0),) * 2 for x in middle],
            "factors": shared.factors,
            "arm": shared.element.arm,
            "share": shared.share,
        }

    def __bool__(self) -> bool:
        return bool(self._elements)

    def rows(self, name: str) -> int:
        """Number of rows of an element."""
        place: slice = self._places[name]
        return int(place.stop - place.start)

    def place(self, name: str, here: slice, A: Mat, bounds: Mat) -> None:
        """Write an element's rows and bounds at ``here`` of a block each tick, with those before it if they touch."""
        own, last = self._places[name], self._plan[-1] if self._plan else None
        if last and last[0].stop == own.start and last[1].stop == here.start:
            own, here = slice(last[0].start, own.stop), slice(last[1].start, here.stop)
            self._plan.pop()
        self._plan.append((own, here, A, bounds))

    def go_without(self, out: Set[str]) -> None:
        """The rows of these elements are free from the next fill on, those of all others are as declared."""
        self._out = [place for name, place in self._places.items() if name in out]
        self._bounds[:] = self._declared
        self._free()

    def _free(self) -> None:
        for place in self._out:
            self._lower[place], self._upper[place] = -np.inf, np.inf

    def target(self, references: Mapping[str, Reference]) -> None:
        """Take the ground's normals and the targets of equalities."""
        for name, normal, usual in self._normals:
            given = references[name].normal if name in references else None
            normal[:] = usual if given is None else given
        for name, place, weight in self._targets:
            value = references[name].value
            self._lower[place] = 0.0 if value is None else weight * value
            self._upper[place] = self._lower[place]
        for shared in self._shared:
            value = references[shared.element.name].value
            self._lower[shared.own] = self._upper[shared.own] = 0.0 if value is None else 0.0 * value  # NaN is reported
            if value is None or np.isfinite(value).all():
                shared.share[:] = shared.element.share if value is None else value
        self._free()

    @property
    def shares(self) -> dict[str, Vec]:
        """The live number of each LoadShare ``(1,)``, by name."""
        return {shared.element.name: shared.share for shared in self._shared}

    @property
    def sizes(self) -> dict[str, int]:
        """Size of the target of each equality, by name."""
        apart = {shared.element.name: 1 for shared in self._shared}
        return apart | {name: place.stop - place.start for name, place, _ in self._targets}


def _force_rows(element: Element, contact: Element, size: int) -> tuple[Mat, Vec, Vec]:
    """C ``(k, size)`` on the contact's rows, after their turn into its frame, and the bounds."""
    maker: Any = getattr(element, "force_rows", None)
    if maker is None:
        raise DeclarationError(element.name, "is on a contact force but has no force_rows(dimension)")
    known: Any = getattr(contact, "force_basis", None)
    basis = np.eye(size) if known is None else np.asarray(known(), dtype=np.float64)
    C, lower, upper = (np.asarray(part, dtype=np.float64) for part in maker(basis.shape[0]))
    return C @ basis, lower, upper
