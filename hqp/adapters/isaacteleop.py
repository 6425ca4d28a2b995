"""A stack as a node of NVIDIA IsaacTeleop's retargeting graph: poses of hands in, targets of joints out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from isaacteleop.retargeting_engine.interface import (  # pyright: ignore[reportMissingImports]
    BaseRetargeter,
    OptionalType,
    TensorGroupType,
)
from isaacteleop.retargeting_engine.interface.execution_events import (  # pyright: ignore[reportMissingImports]
    ExecutionState,
)
from isaacteleop.retargeting_engine.tensor_types import (  # pyright: ignore[reportMissingImports]
    DLDataType,
    FloatType,
    NDArrayType,
)
from numpy.typing import ArrayLike

from hqp.errors import DeclarationError
from hqp.loop.controller import Controller
from hqp.loop.tick import Tick
from hqp.robots import Robot
from hqp.teleoperation.follow import LONGEST, Follow

TARGETS = "joint_targets"
"""The output's key, as of their JointStateRetargeter."""


class StackRetargeter(BaseRetargeter):  # type: ignore[misc,unused-ignore]
    """Follows hands by a stack, in ticks of dt up to the graph's time, each carried out exactly.

    name: name of the node.  controller: at velocity or acceleration level.  follows: by input; each input is an
    optional ``ee_pose``, float32 ``(7,)``: x, y, z [m], quaternion x, y, z, w; the position alone for a Position.  The
    output ``joint_targets`` holds one float for each of ``robot.joint_names`` [rad, m].  A clutch is closed while the
    graph runs; an input that is absent is a packet that is missing; a reset begins anew at ``start``, home for None.
    tick: the last one, None before the first.  Raises DeclarationError for another level, and for joints of several
    axes.
    """

    def __init__(
        self,
        name: str,
        controller: Controller,
        robot: Robot,
        follows: Mapping[str, Follow],
        *,
        dt: float = 0.002,
        start: ArrayLike | None = None,
    ) -> None:
        self._follows, self._robot, self._dt = dict(follows), robot, dt
        self._session = controller.session(robot, dt)
        if self._session.program.kind == "torque":
            raise DeclarationError("StackRetargeter", "torques move nothing here", allowed="Velocity, Acceleration")
        names = robot.joint_names
        self._columns = robot.joints(names)
        if len(self._columns) != len(names):
            raise DeclarationError("StackRetargeter", "joints of several axes", value=robot.name, allowed="one each")
        self._start = np.array(robot.home if start is None else start, dtype=np.float64)
        self._begin()
        super().__init__(name=name)

    def input_spec(self) -> Any:
        """An optional ``ee_pose`` for each hand."""
        pose = NDArrayType("pose", shape=(7,), dtype=DLDataType.FLOAT, dtype_bits=32)
        return {hand: OptionalType(TensorGroupType("ee_pose", [pose])) for hand in self._follows}

    def output_spec(self) -> Any:
        """The joints' targets by name."""
        return {TARGETS: TensorGroupType(TARGETS, [FloatType(name) for name in self._robot.joint_names])}

    def _begin(self) -> None:
        self._q, self._v = self._start.copy(), np.zeros(self._robot.nv)
        self._now: float | None = None
        self.tick: Tick | None = None
        for follow in self._follows.values():
            follow.restart()

    def _compute_fn(self, inputs: Any, outputs: Any, context: Any) -> None:
        if context.execution_events.reset:
            self._begin()
        now = 1e-9 * context.graph_time.real_time_ns
        began = now if self._now is None else max(self._now, now - LONGEST)
        ticks = max(0, round((now - began) / self._dt))
        last = self._now = began + ticks * self._dt
        engaged = context.execution_events.execution_state not in (ExecutionState.STOPPED, ExecutionState.PAUSED)
        for hand, follow in self._follows.items():
            if not inputs[hand].is_none:
                follow.receive(_pose(follow, inputs[hand][0]), sent=now, received=last, engaged=engaged)
        for k in range(1, ticks + 1):
            self._step(began + k * self._dt)
        group, angles = outputs[TARGETS], self._robot.state(self._q).angles
        for i, column in enumerate(self._columns):
            group[i] = float(angles[column])

    def _step(self, now: float) -> None:
        state = self._robot.state(self._q, self._v)
        self.tick = self._session.step(state, *(follow.reference(state, now) for follow in self._follows.values()))
        self._q, self._v = self.tick.advance()


def _pose(follow: Follow, given: Any) -> Any:
    pose = np.asarray(np.from_dlpack(given), dtype=np.float64)
    if follow.takes == "rotation":
        return pose[3:]
    return (pose[:3], pose[3:]) if follow.takes == "pose" else pose[:3]
