"""The stack of tasks that follows a person, for the feet that stand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hqp import shapes
from hqp.arrays import Vec
from hqp.declare.element import Element, Task
from hqp.declare.law import P
from hqp.declare.robot import Robot
from hqp.declare.stack import Level, Stack
from hqp.errors import DeclarationError, ModelError
from hqp.robots.knees import knee
from hqp.tasks import AlignAxis, CollisionAvoidance, Com, JointLimits, Orientation, Pose, Position, Posture, Within
from hqp.tasks.collision_scene import scene

from .body import Body
from .joints import SIDES
from .skeleton_map import SkeletonMap

GAIN = 30.0
"""Rate at which errors of feet and hands decay [1/s]; half of it in a period at most."""

BELOW = 10.0
"""Rate for trunk and limbs: they recover slowly from deviations for hands and feet [1/s]."""

POSTURE = 1.0
"""Rate at which free joints move home [1/s]."""

RESTING = 1.0 / 120.0
"""Shortest period of ticks that lead to rest [s]: with 1/60 s hands stay 164 mm behind in a crouch, 13 mm with this."""

HEIGHT = 2.0
"""Weight of a planned CoM's height beside hands and trunk: a body that falls faster than planned moves the ZMP."""

JOINTS = 0.1
"""Weight of the joints beside hands, trunk and height of a planned CoM, which leave joints free."""

RECOVERY = 0.5
"""Largest speed out of the floor and out of a collision [m/s]."""

BRAKING = 1000.0
"""Deceleration of distances [m/s^2]: a person's motion has no motors."""

INFLUENCE = 0.05
"""Distance below which links slow down towards each other and towards the floor [m]."""

FLOOR = "floor"

Standing = tuple[tuple[str, int], ...]
"""Sides whose foot stands, and the end of it that is held, 1 the toe, -1 the heel."""


class Stacks:
    """Tasks of a robot by part, and the stack for the feet that stand.

    Floor, self-collision, joint and speed limits come before all; then the spots of standing feet (at rest, which is
    within all limits), their heights and the lateral lines that they roll about, moving feet, hands, the tilt of soles,
    trunk, limbs, posture.  flat: standing soles are flat, above the hands.  Soles in the air turn below them: a
    foot that spins would throw the robot's hips about.
    """

    def __init__(
        self, robot: Robot, found: SkeletonMap, body: Body, dt: float, *, collision: bool = True, flat: bool = False
    ) -> None:
        law, below = P(min(GAIN, 0.5 / dt)), P(min(BELOW, 0.5 / dt))
        self.dt = dt
        self.robot, self.frames, self.body, self._map, self.flat = robot, found.frames, body, found, flat

        def point(part: str, offset: tuple[float, float, float], name: str, law: P) -> Position:
            return Position(frame=found.frames[part], offset=offset, law=law, name=name)

        def turn(part: str, law: P, name: str = "") -> Orientation:
            return Orientation(frame=found.frames[part], law=law, name=name or part)

        def edge(side: str, corners: dict[str, Vec], name: str) -> Position:
            return point(f"{side}_sole", self.in_frame(side, corners[side]), f"{side}_{name}", law)

        self.toes = {side: edge(side, body.toes, "toe") for side in SIDES}
        self.heels = {side: edge(side, body.heels, "heel") for side in SIDES}
        self.soles = {side: turn(f"{side}_sole", law) for side in SIDES}
        self.lines = {
            side: AlignAxis(
                frame=found.frames[f"{side}_sole"],
                axis=tuple(body.axes[f"{side}_sole"][1].tolist()),
                law=law,
                name=f"{side}_line",
            )
            for side in SIDES
        }
        self.spots, self.heights = (
            {task.name: replace(task, axes=axes, name=f"{task.name}_{what}") for _, task in self.edges}
            for axes, what in (("xy", "spot"), ("z", "height"))
        )
        self.corners = [
            replace(task, offset=self.in_frame(side, corner), axes="z", name=f"{side}_corner_{k}")
            for side, task in self.toes.items()
            for k, corner in enumerate(body.corners[side])
        ]
        x, y, z = body.middle.tolist()
        self.torso = turn("torso", below)
        self.trunk: tuple[Task, ...] = (point("pelvis", (x, y, z), "pelvis", below), self.torso)
        self.hips = turn("pelvis", below, "hips")
        self.points = {
            f"{side}_{limb}": point(f"{side}_{limb}", found.offset(f"{side}_{limb}"), f"{side}_{limb}", own)
            for limb, own in (("hand", law), ("elbow", below), ("knee", below))
            for side in SIDES
        }
        self.legs = {
            side: tuple(point(f"{side}_{end}", found.offset(f"{side}_{end}"), end, law) for end in ("hip", "ankle"))
            for side in SIDES
        }
        self.posture = Posture(law=P(POSTURE), name="posture")
        self.com = Com(axes="xy", law=law, name="com")
        self.com_height = Com(axes="z", law=law, name="com_height")
        self.base, self.joints = (
            Pose(frame=found.frames["pelvis"], law=below, name="base"),
            Posture(law=below, name="joints"),
        )
        self.above = {
            name: Within(height, lower=0.0, rate=0.5 / dt, recovery=RECOVERY, name=f"{name}_above")
            for name, height in self.heights.items()
        }
        self.judged = self._judged()
        self.reaching = 1 + next(k for k, level in enumerate(self.judged) if self.points["left_hand"] in level)
        """Number of judged levels down to that of the hands."""
        self._subject_to = self._limits(0.5 / dt, collision)
        self._straight = self._knees(0.5 / dt)

    def _limits(self, rate: float, collision: bool) -> list[Element]:
        found: list[Element] = [JointLimits(acceleration=0.0, braking=0.0)]
        for height in self.corners:
            found.append(Within(height, lower=0.0, rate=rate, recovery=RECOVERY, name=f"{height.name}_floor"))
        self.links = self._links()
        links = self.links if collision else ()
        self.collision = bool(links)
        if links:
            floor, pairs = shapes.half_space(FLOOR), tuple((link, FLOOR) for link in links)
            avoided: dict[str, dict[str, Any]] = {"self_collision": {}, FLOOR: {"pairs": pairs, "world": (floor,)}}
            for name, given in avoided.items():
                if name == FLOOR or may_collide(self.robot):
                    found.append(
                        CollisionAvoidance(
                            name=name,
                            clearance=0.0,
                            influence=INFLUENCE,
                            rate=rate,
                            braking=BRAKING,
                            recovery=RECOVERY,
                            **given,
                        )
                    )
        return found

    def _knees(self, rate: float) -> list[Element]:
        """Bounds that keep knees on the side of a straight leg to which they bend farther.

        On the other side a leg that is to get shorter stretches its knee further into its limit, and stays there.
        """
        robot = self.robot
        found: list[Element] = []
        moved = np.array([robot.support(robot.frame(self.frames[f"{side}_sole"])) for side in SIDES], dtype=bool)
        for side, own in zip(SIDES, moved & ~moved[::-1], strict=True):
            leg = [name for name, column in zip(robot.joint_names, robot.actuated, strict=True) if own[column]]
            name, bend = knee(robot, leg, robot.home)
            column = int(robot.joints([name])[0])
            straight = float(robot.state(robot.home).angles[column]) - bend
            folds = robot.upper[column] - straight > straight - robot.lower[column]
            task = Posture(joints=(name,), name=f"{side}_knee_angle")
            low, high = (straight, None) if folds else (None, straight)
            found.append(Within(task, lower=low, upper=high, rate=rate, recovery=RECOVERY, name=f"{side}_straight"))
        return found

    def resting(self) -> Stacks:
        """Return these stacks with a period of at least ``RESTING``."""
        if self.dt >= RESTING:
            return self
        return Stacks(self.robot, self._map, self.body, RESTING, collision=self.collision, flat=self.flat)

    def without_collision(self) -> Stacks:
        """Return these stacks without self-collision."""
        return Stacks(self.robot, self._map, self.body, self.dt, collision=False, flat=self.flat)

    def _links(self) -> tuple[str, ...]:
        """Links that are to stay above the floor: all but the feet, whose edges have bounds of their own, and links
        that reach below the soles at home.

        None for a robot without shapes.
        """
        robot = self.robot
        feet = {robot.body(robot.frame(self.frames[f"{side}_sole"])) for side in SIDES}
        feet |= {robot.bodies[body][0] for body in feet}
        try:
            own = [capsule for capsule in robot.capsules if capsule.body not in feet]
        except ModelError:
            return ()
        state = robot.state(robot.home)
        state.kinematics()
        soles = min(float(edge.value(state)[2]) for _, edge in self.edges)
        lowest: dict[str, float] = {}
        for link in own:
            place, turn = robot.bodies[link.body][5]
            ends = [float((place + turn @ np.array(end))[2]) - link.radius for end in (link.a, link.b)]
            lowest[link.name] = min(lowest.get(link.name, np.inf), *ends)
        return tuple(name for name, height in lowest.items() if height > soles)

    def _judged(self) -> list[list[Task]]:
        """Tasks of feet, hands, soles and trunk by level, first the most important."""
        hands = (self.points[f"{side}_hand"] for side in SIDES)
        judged = [*self.toes.values(), *self.soles.values(), *hands, self.torso]
        parts = [[task for task in level if task in judged] for level in self._levels(()).values()]
        return [level for level in parts if level]

    @property
    def edges(self) -> list[tuple[str, Position]]:
        """Sides, and the tasks of their toes and heels."""
        return [*self.toes.items(), *self.heels.items()]

    def in_frame(self, side: str, corner: Vec) -> tuple[float, float, float]:
        """A point of a sole, in axes x forward and z up at home, in the axes of the foot's frame ``(3,)`` [m]."""
        x, y, z = np.array(self._map.offset(f"{side}_sole")) + self.body.axes[f"{side}_sole"].T @ corner
        return float(x), float(y), float(z)

    def down(self, side: str, end: int) -> Position:
        """The end of a foot: its heel for -1, else its toe."""
        return self.heels[side] if end < 0 else self.toes[side]

    def stack(self, standing: Standing) -> Stack:
        """For the feet that stand."""
        return self._stack(self._levels(standing))

    def starting(self, standing: Standing) -> Stack:
        """For a start: feet stand where they are to be, turned as it suits; flat soles as they are planned."""
        return self._stack(self._levels(standing, turned=not self.flat))

    def closing(self, standing: Standing) -> Stack:
        """Rate of the last pass: below feet and hands, the pelvis and the joints as they are to be."""
        levels = self._levels(standing)
        kept = {name: levels[name] for name in ("stance", "ground", "swing", "hands")}
        motion = Level(
            self.base, self.joints, name="motion", price=0
        )  # no row of it turns: nothing for a price to calm
        return self._stack(kept, motion)

    def carrying(self, standing: Standing) -> Stack:
        """For a planned CoM: soles of standing and toes of moving feet > CoM > its height, hands, trunk and joints.

        The last four and the turns of moving soles share a level: hands alone above the trunk lead a waist into a
        corner of its limits that no small motion leaves, and a strict height does the same to nearly straight legs.
        """
        levels = self._levels(standing)
        kept = {name: levels[name] for name in ("stance", "ground", "swing")}
        turns = [*levels["soles"], self.torso, self.hips]
        body = [replace(self.com_height, weight=HEIGHT), *levels["hands"], *turns, replace(self.joints, weight=JOINTS)]
        return self._stack(kept | {"com": [self.com], "body": body}, limits=self._straight)

    def _stack(self, levels: dict[str, list[Any]], *below: Level, limits: Sequence[Element] = ()) -> Stack:
        declared = (Level(*tasks, name=name) for name, tasks in levels.items() if tasks)
        return Stack(*declared, *below, subject_to=[*self._subject_to, *limits])

    def _levels(self, standing: Standing, *, turned: bool = False) -> dict[str, list[Any]]:
        """Tasks by level, first the most important.  turned: true to adapt the yaw of standing feet."""
        stand, lines = {side for side, _ in standing}, [self.lines[side] for side, _ in standing]
        down = [self.down(side, end).name for side, end in standing]
        raised = [self.down(side, -end).name for side, end in standing]
        kept: list[Any] = [self.heights[name] for name in raised]
        moving = [side for side in SIDES if side not in stand]
        tilts = [self.soles[side] for side in moving]
        return {
            "stance": [self.spots[name] for name in down],
            "ground": [
                *(self.heights[name] for name in down),
                *(kept if self.flat else (self.above[name] for name in raised)),
                *(() if turned else lines),
            ],
            "swing": [self.toes[side] for side in moving],
            "hands": [self.points[f"{side}_hand"] for side in SIDES],
            "soles": [*(() if self.flat else kept), *tilts, *(lines if turned else ())],
            "trunk": [*self.trunk, self.hips],
            "limbs": [*(self.points[f"{side}_{limb}"] for limb in ("elbow", "knee") for side in SIDES)],
            "posture": [self.posture],
        }


def may_collide(robot: Robot) -> bool:
    """Return true if two links of a robot with shapes may touch by accident."""
    try:
        scene(CollisionAvoidance(clearance=0.0), robot)
    except DeclarationError:
        return False
    return True
