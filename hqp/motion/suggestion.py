"""A first skeleton map for a robot, from its tree and landmarks."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from hqp.arrays import Vec
from hqp.declare.robot import Robot
from hqp.errors import DeclarationError, ModelError
from hqp.robots.soles import foot_joints, level_sole, standing_axes

from .joints import SIDES
from .skeleton_map import Offset, SkeletonMap

NEAR = 1e-3
"""Height above the lowest shapes of its link below which a frame belongs to the sole [m]."""


HAND = 0.35
"""Length of a hand with fingers as a share of the arm's, at most: elbows part, too, into forearm and rods."""

OFF_AXIS = 0.025
"""Distance from the axis of a joint below which a place is on it [m]."""


def suggest_map(robot: Robot) -> SkeletonMap:
    """Names of frames for every part, to be looked over: knees and elbows are the joints half way along a limb, hands
    the far ends of forearms without a wrist.

    Feet and hands are the robot's landmarks ``soles`` and ``palms``, or the links with the lowest collision shapes, and
    the other ends of the tree that are furthest to either side.  A sole's point is in the middle of its link's lowest
    shapes.  Raises DeclarationError for a robot that has no two legs and two arms, or does not stand at home.
    """
    if not robot.floating:
        raise DeclarationError("suggest-map", "a robot whose base is fixed", value=robot.name, allowed="a free base")
    tree = _Tree(robot)
    feet = robot.landmarks.get("soles", ()) or tree.feet()
    hands = robot.landmarks.get("palms", ()) or tree.hands()
    if len(feet) != 2 or len(hands) != 2:
        raise DeclarationError("suggest-map", "no two feet and two hands", value=(tuple(feet), tuple(hands)))
    feet, hands = tree.sided(feet), tree.sided(hands)
    legs, arms = [tree.chain(f) for f in feet], [tree.chain(f) for f in hands]
    shared = [body for body in arms[0] if body in arms[1]]
    torso = shared[-1] if shared else legs[0][0]
    frames = {"pelvis": tree.frame(legs[0][0]), "torso": tree.frame(torso)}
    offsets: dict[str, Offset] = {}
    for side, foot, hand, leg, arm in zip(SIDES, feet, hands, legs, arms, strict=True):
        own = leg[1:]
        if len(own) < 2:
            raise DeclarationError("suggest-map", f"no {side} leg", value=foot, allowed="at least two joints")
        knee = tree.half_way(own, tree.place(foot))
        hip = tree.first_beside(own[: own.index(knee)] or own[:1], knee)
        frames |= {f"{side}_hip": tree.frame(hip), f"{side}_knee": tree.frame(knee)}
        frames |= {f"{side}_ankle": tree.frame(own[-1]), f"{side}_sole": foot}
        own = [body for body in arm if body not in shared]
        if len(own) < 2:
            raise DeclarationError("suggest-map", f"no {side} arm", value=hand)
        elbow, reach = tree.half_way(own, tree.place(hand)), tree.far_end(own[-1])
        if tree.half_way(own, reach) == own[-1]:
            elbow, offsets[f"{side}_hand"] = own[-1], tree.offset(hand, reach)
        shoulder = tree.first_apart(own[: own.index(elbow) + 1], hand)
        frames |= {f"{side}_shoulder": tree.frame(shoulder), f"{side}_elbow": tree.frame(elbow), f"{side}_hand": hand}
        tree.check_standing([frames[f"{side}_{part}"] for part in ("shoulder", "hip", "knee", "sole")])
    tree.check_two_legs([leg[1] for leg in legs], frames["left_knee"])
    offsets |= {f"{side}_sole": at for side, foot in zip(SIDES, feet, strict=True) if (at := _sole(robot, foot))}
    return SkeletonMap(frames, offsets)


def _sole(robot: Robot, frame: str) -> Offset | None:
    """The middle of the lowest shapes on a frame's link, in the frame's axes ``(3,)`` [m]; None for a frame that is as
    low, and for a link without shapes.
    """
    try:
        turn, points = level_sole(robot, frame)
    except ModelError:
        return None
    state = robot.state(robot.home)
    place = np.array(state.position(frame))
    if not len(points) or abs(float(points[:, 2].min()) - place[2]) < NEAR:
        return None
    middle = np.array([*0.5 * (points[:, :2].min(axis=0) + points[:, :2].max(axis=0)), points[:, 2].min()])
    x, y, z = (state.rotation(frame).T @ turn.T @ (middle - place)).tolist()
    return round(x, 6), round(y, 6), round(z, 6)


def on_shapes(found: SkeletonMap, robot: Robot) -> SkeletonMap:
    """A map whose soles are as low as the lowest shapes of their links: files of one robot differ in them."""
    offsets, own = dict(found.offsets), robot.copy()
    for part in (f"{side}_sole" for side in SIDES):
        frame, offset = found.frames[part], np.array(found.offset(part))
        try:
            turn, points = level_sole(own, frame)
        except ModelError:
            continue
        state = own.state(own.home)
        R = turn @ state.rotation(frame)
        place = state.position(frame) + R @ offset
        if len(points) and abs(drop := float(points[:, 2].min() - place[2])) > NEAR:
            x, y, z = (offset + drop * R[2]).tolist()
            offsets[part] = round(x, 6), round(y, 6), round(z, 6)
    return replace(found, offsets=offsets)


class _Tree:
    """Bodies of a robot at home, 0 the world, 1 the base, with places in the axes ahead, left, up."""

    def __init__(self, robot: Robot) -> None:
        try:
            self._lowest: tuple[int, ...] = foot_joints(robot)
            self._axes = standing_axes(robot, *self._lowest)
        except ModelError:
            self._lowest, self._axes = (), np.eye(3)
        self._robot: Any = robot
        self._state = robot.state(robot.home)
        self._state.kinematics()
        self._parents = [int(body[0]) for body in robot.bodies]
        self._places = [np.array(body[5][0]) @ self._axes for body in robot.bodies]
        self._frames: dict[int, list[str]] = {}
        for name in robot.frame_names:
            self._frames.setdefault(robot.body(robot.frame(name)), []).append(name)

    def place(self, frame: str) -> Vec:
        """Origin of a frame in the axes ahead, left, up ``(3,)`` [m]."""
        return np.asarray(self._state.position(frame) @ self._axes)

    def check_standing(self, frames: list[str]) -> None:
        """Raise DeclarationError unless each frame is above the next."""
        heights = [float(self.place(frame)[2]) for frame in frames]
        if any(one <= other for one, other in pairwise(heights)):
            allowed = "a home (--home, set_home) with shoulders above hips, hips above knees, knees above soles"
            value = ", ".join(f"{frame} {height:.2f} m" for frame, height in zip(frames, heights, strict=True))
            raise DeclarationError("suggest-map", "the robot does not stand at home", value=value, allowed=allowed)

    def check_two_legs(self, legs: list[int], knee: str) -> None:
        """Raise DeclarationError for an end of the tree below a knee that belongs to neither leg."""
        for body in self._ends():
            if float(self._places[body][2]) < float(self.place(knee)[2]) and not {*legs} & {
                *self.chain(self.frame(body))
            }:
                raise DeclarationError("suggest-map", "more than two legs", value=self.frame(body), allowed="two")

    def frame(self, body: int) -> str:
        """A frame at the joint that carries a body, a link rather than the joint's own name."""
        at = [n for n in self._frames[body] if np.allclose(self.place(n), self._places[body], atol=1e-6)]
        links = [n for n in at if "link" in n.lower()] or [n for n in at if "joint" not in n.lower()]
        return (links or at or self._frames[body])[-1]

    def chain(self, frame: str) -> list[int]:
        """Bodies from the base to a frame."""
        body, found = self._robot.body(self._robot.frame(frame)), []
        while body > 0:
            found.append(body)
            body = self._parents[body]
        return found[::-1]

    def feet(self) -> tuple[str, ...]:
        """Frames of the two links with the lowest shapes, of the two lowest ends for a robot without shapes."""
        return tuple(self.frame(body) for body in self._lowest or self._ends()[:2])

    def hands(self) -> tuple[str, ...]:
        """Frames of the two ends of the tree that are furthest to the sides, but for the two lowest."""
        high = sorted(self._ends()[2:], key=lambda b: float(self._places[b][1]))
        return (self.frame(self._palm(high[-1])), self.frame(self._palm(high[0]))) if len(high) > 1 else ()

    def _palm(self, tip: int) -> int:
        """The body at which the fingers part of which one ends in a tip; the tip if there are no others."""
        chain = [tip]
        while self._parents[chain[-1]] > 1:
            chain.append(self._parents[chain[-1]])
        lengths = [float(np.linalg.norm(self._places[a] - self._places[b])) for a, b in pairwise(chain)]
        way = np.cumsum([0.0, *lengths])
        parting = [b for b in set(self._parents) if self._parents.count(b) > 1]
        near = [b for b, left in zip(chain, way, strict=True) if b in parting and left < HAND * way[-1]]
        return near[-1] if near else tip

    def _ends(self) -> list[int]:
        """Ends of the tree beside its middle, the lowest first."""
        ends = [b for b in range(2, len(self._parents)) if b not in self._parents and abs(self._places[b][1]) > 0.02]
        return sorted(ends, key=lambda b: float(self._places[b][2]))

    def sided(self, frames: tuple[str, ...]) -> tuple[str, ...]:
        """Left first."""
        return tuple(sorted(frames, key=lambda name: -float(self.place(name)[1])))

    def far_end(self, body: int) -> Vec:
        """The end of its link's capsules farthest from a body's joint, the joint without shapes ``(3,)`` [m]."""
        place, rotation = self._robot.bodies[body][5]
        try:
            own = [c for c in self._robot.capsules if c.body == body]
        except ModelError:
            own = []
        ends = [np.zeros(3), *(np.array(end) for capsule in own for end in (capsule.a, capsule.b))]
        return np.asarray((place + rotation @ max(ends, key=np.linalg.norm)) @ self._axes)

    def offset(self, frame: str, place: Vec) -> Offset:
        """A place in a frame's axes ``(3,)`` [m]."""
        way = self._axes @ (place - self.place(frame))
        x, y, z = (self._state.rotation(frame).T @ way).tolist()
        return round(x, 6), round(y, 6), round(z, 6)

    def half_way(self, bodies: list[int], end: Vec) -> int:
        """The body whose joint is nearest to the middle of a limb that ends at a place, along it; not its first."""
        stops = [*(self._places[b] for b in bodies), end]
        way = np.concatenate(([0.0], np.cumsum([np.linalg.norm(b - a) for a, b in pairwise(stops)])))
        inner = range(1, len(bodies))
        return bodies[min(inner, key=lambda k: abs(float(way[k]) - 0.5 * float(way[-1])))]

    def first_beside(self, bodies: list[int], knee: int) -> int:
        """The first body that is no further to the side than the knee's joint."""
        side = abs(float(self._places[knee][1]))
        return next((b for b in bodies if abs(float(self._places[b][1])) > side - 0.02), bodies[-1])

    def first_apart(self, bodies: list[int], end: str) -> int:
        """The first body that no joint up to the last body brings nearer to it.  end: a frame behind them.

        A joint leaves the distance between two places if one of them is on its axis.
        """
        place, jacobian = self._state.position(end), self._state.jacobian(end)
        last = self._axes @ self._places[bodies[-1]]

        def moves(body: int, joint: int) -> float:
            """Largest change of the distance between a body and the last one by a joint [m/rad]."""
            columns = jacobian[:, slice(*self._columns(joint))]
            ends = (self._axes @ self._places[body], last)
            speeds = (columns[:3] + np.cross(columns[3:], x - place, axisa=0, axisc=0) for x in ends)
            return min(float(np.linalg.norm(speed, axis=0).max()) for speed in speeds)

        for k, body in enumerate(bodies[:-1]):
            if all(moves(body, joint) < OFF_AXIS for joint in bodies[k + 1 : -1]):
                return body
        return bodies[0]

    def _columns(self, body: int) -> tuple[int, int]:
        """First and end of the columns of a body's joint."""
        joint = self._robot.model.joints[body]
        return joint.idx_v, joint.idx_v + joint.nv
