"""Motion of a robot, and its quality."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hqp.arrays import Mat
from hqp.declare.robot import Robot
from hqp.errors import DeclarationError

from .box import FIELDS, Box
from .contacts import Mask
from .dynamics import Dynamics
from .measures import Measures
from .shortfalls import PARTS, Names, Shortfall

FORMATS = (".npz", ".csv", ".pkl")


@dataclass(frozen=True)
class Retargeted:
    """Result of ``retarget``.

    q ``(T, nq)``, v ``(T, nv)``: configurations and velocities, frame by frame.  contacts ``(T, k)``: contacts of the
    person, in the order of contact_names.  fps [1/s].  person ``(T, J, 3)``: the joints of the person in the robot's
    size [m], with their parents.  measures: frame by frame.  shortfalls: unmet targets, with time and cause.  gave_way
    ``(T, 4)``: cause of each error of left and right toe, left and right hand, "" within 5 mm of their targets.
    statuses: statuses of the ticks, with their number.  time: time of the solution, CPU [s].  scale: robot's metres to
    the motion's unit.  notes: remarks on the person: mirrored, upside down, lying, the axis of the file that is up.
    dynamics: the planned CoM and the changes for it, None without one.  box: the box between the robot's hands [m].
    """

    robot: Robot
    q: Mat
    v: Mat
    contacts: Mask
    contact_names: tuple[str, ...]
    fps: float
    person: Mat
    person_parents: tuple[int, ...]
    measures: Measures
    shortfalls: tuple[Shortfall, ...]
    gave_way: Names
    statuses: dict[str, int]
    time: float
    scale: float
    notes: tuple[str, ...] = ()
    dynamics: Dynamics | None = None
    box: Box | None = None

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.q)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Order of ``angles``, that of ``robot.joint_names``: along each limb before the next (depth first)."""
        return self.robot.joint_names

    @property
    def angles(self) -> Mat:
        """Positions of the actuated joints ``(T, n)`` [rad or m]."""
        return np.array([self.robot.state(q).angles[self.robot.actuated] for q in self.q])

    @property
    def base(self) -> tuple[Mat, Mat]:
        """Positions ``(T, 3)`` [m] and quaternions xyzw ``(T, 4)`` of the base."""
        return self.q[:, :3], self.q[:, 3:7]

    @property
    def summary(self) -> dict[str, float]:
        """The figures of docs/retargeting.md [m, s, rad]."""
        return {**self.measures.summary(), "frames_per_second": len(self) / self.time if self.time > 0.0 else np.inf}

    def save(self, path: str | Path) -> Path:
        """Write the motion: ``.npz`` with all data and their orders, ``.csv`` as Unitree's and BeyondMimic's tools
        read it, ``.pkl`` as GMR writes it.

        Raises DeclarationError for another ending.
        """
        path = Path(path)
        writers: dict[str, Callable[[Path], None]]
        writers = dict(zip(FORMATS, (self._npz, self._csv, self._pickle), strict=True))
        if path.suffix.lower() not in writers:
            raise DeclarationError("retarget", "unknown file type", value=str(path), allowed=", ".join(FORMATS))
        writers[path.suffix.lower()](path)
        return path

    def _npz(self, path: Path) -> None:
        position, quaternion = self.base
        box = {} if self.box is None else {f"box_{name}": getattr(self.box, name) for name in FIELDS}
        np.savez_compressed(
            path, q=self.q, v=self.v, contacts=self.contacts, fps=self.fps,
            joint_names=np.array(self.joint_names), contact_names=np.array(self.contact_names),
            body_names=np.array([self.robot.joint_name(body[1]) for body in self.robot.bodies[1:]]),
            quaternion_order="xyzw", joint_order="depth first", robot=self.robot.name, base_position=position,
            base_quaternion=quaternion, angles=self.angles, person=self.person,
            person_parents=np.array(self.person_parents, dtype=int), part_names=np.array(PARTS),
            part_errors=np.column_stack([self.measures.errors[part] for part in PARTS]), gave_way=self.gave_way,
            **box,
        )  # fmt: skip

    def _csv(self, path: Path) -> None:
        """A row a frame without a header: base x y z, quaternion xyzw, joints in the robot's order [m, rad].

        The retargeted LAFAN1 of Unitree has this form, which BeyondMimic's csv_to_npz.py reads; the frame rate is not
        in it.
        """
        np.savetxt(path, np.hstack((*self.base, self.angles)), delimiter=",", fmt="%.9g")

    def _pickle(self, path: Path) -> None:
        """The dictionary that GMR writes: fps, root_pos, root_rot (xyzw), dof_pos."""
        position, quaternion = self.base
        found = {
            "fps": self.fps, "root_pos": position.copy(), "root_rot": quaternion.copy(), "dof_pos": self.angles,
            "local_body_pos": None, "link_body_list": None, "dof_names": list(self.joint_names),
        }  # fmt: skip
        path.write_bytes(pickle.dumps(found))

    def html(self, path: str | Path) -> Path:
        """Write the report as one page with curves; needs plotly."""
        from .page import render

        path = Path(path)
        path.write_text(render(self), encoding="utf-8")
        return path

    def view(self, **doors: Any) -> Any:
        """Show the motion in a browser, the person beside the robot, with a scrubber; returns the page's server."""
        from .scrubber import Scrubber

        return Scrubber(self, **doors)

    def __str__(self) -> str:
        planned = [] if self.dynamics is None else self.dynamics.lines()
        return "\n".join([*self.notes, *self.lines(), *planned, *(str(each) for each in self.shortfalls)])

    def lines(self) -> list[str]:
        """The figures in words."""
        s = self.summary
        nearest, hands = 1e3 * s["clearance"], (1e3 * s["hand_p50"], 1e3 * s["hand_p99"])
        return [
            f"{self.robot.name}: {len(self)} frames, {len(self) / self.fps:.1f} s, "
            f"{s['frames_per_second']:.0f} frames/s",
            f"standing feet that slide faster than 1 cm/s: {100 * s['slide_share']:.2f} % of frames",
            f"deepest point below the floor {1e3 * s['penetration']:.1f} mm, nearest links {nearest:.1f} mm",
            f"hands off p50 {hands[0]:.1f}, p99 {hands[1]:.0f} mm; toes p99 {1e3 * s['foot_p99']:.0f} mm; "
            f"trunk p99 {math.degrees(s['trunk_p99']):.0f}, soles p99 {math.degrees(s['sole_p99']):.0f} degrees",
            f"joints p99 {s['acceleration_p99']:.0f} rad/s^2, {s['jerk_p99']:.3g} rad/s^3; "
            f"beyond limits {s['beyond']:.2g} rad; fastest {100 * s['speed']:.0f} % of its limit",
        ]
