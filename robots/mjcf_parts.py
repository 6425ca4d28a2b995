"""Bodies of an MJCF that form the robot: the trees that actuators move; other moving bodies are its scene."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hqp.errors import DeclarationError

from .mjcf_names import body_names, joint_names
from .mujoco_extra import mujoco

_ON_JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
_ON_TENDON, _ON_BODY = int(mujoco.mjtTrn.mjTRN_TENDON), int(mujoco.mjtTrn.mjTRN_BODY)
_TENDON, _JOINT = int(mujoco.mjtEq.mjEQ_TENDON), int(mujoco.mjtEq.mjEQ_JOINT)
_SITE, _BODY = int(mujoco.mjtObj.mjOBJ_SITE), int(mujoco.mjtObj.mjOBJ_BODY)


def robot_bodies(simulated: Any, root: str | Sequence[str] | None, path: Path | str) -> frozenset[int]:
    """Bodies of the trees that are the robot, by index in a MjModel; bodies that cannot move belong to no tree.

    The trees that actuators move, directly or by tendons, and those that active equalities tie to them.  Without
    actuators, the trees with a joint that is not free, else all.  root: names of bodies instead, each for the trees
    that it carries or is part of; raises DeclarationError for a name that carries none.
    """
    tree = np.asarray(simulated.body_treeid)
    trees = set(tree[tree >= 0].tolist())
    if root is None:
        driven = {int(tree[b]) for a in range(simulated.nu) for b in _moved_by(simulated, a)} - {-1}
        articulated = {int(tree[b]) for b in simulated.jnt_bodyid[simulated.jnt_type != mujoco.mjtJoint.mjJNT_FREE]}
        chosen = driven or articulated or trees
        ties = [
            {int(tree[b]) for b in equality_bodies(simulated, e)} - {-1}
            for e in np.flatnonzero(simulated.eq_active0).tolist()
        ]
        for _ in ties:
            chosen = chosen.union(*(tie for tie in ties if tie & chosen))
    else:
        chosen = _named(simulated, (root,) if isinstance(root, str) else tuple(root), path)
    return frozenset(np.flatnonzero(np.isin(tree, sorted(chosen))).tolist())


def scene_roots(simulated: Any, own: Iterable[int]) -> list[str]:
    """Names of the first bodies of the trees that are not the robot."""
    names, others = body_names(simulated), set(np.flatnonzero(simulated.body_treeid >= 0).tolist()) - set(own)
    return [names[b] for b in sorted(others) if simulated.body_treeid[simulated.body_parentid[b]] < 0]


def equality_bodies(simulated: Any, equality: int) -> list[int]:
    """Bodies that an equality constraint binds, the world included."""
    ends = [int(simulated.eq_obj1id[equality]), int(simulated.eq_obj2id[equality])]
    kind, what = int(simulated.eq_type[equality]), int(simulated.eq_objtype[equality])
    if kind == _TENDON:
        return [b for tendon in ends if tendon >= 0 for b in _tendon_bodies(simulated, tendon)]
    if kind == _JOINT:
        return [int(simulated.jnt_bodyid[j]) for j in ends if j >= 0]
    if what == _SITE:
        return [int(simulated.site_bodyid[s]) for s in ends if s >= 0]
    return [max(b, 0) for b in ends] if what == _BODY else []


def _moved_by(simulated: Any, actuator: int) -> list[int]:
    kind = int(simulated.actuator_trntype[actuator])
    one, two = (int(i) for i in simulated.actuator_trnid[actuator])
    if kind in _ON_JOINT:
        return [int(simulated.jnt_bodyid[one])]
    if kind == _ON_TENDON:
        return _tendon_bodies(simulated, one)
    if kind == _ON_BODY:
        return [one]
    return [int(simulated.site_bodyid[s]) for s in (one, two) if s >= 0]


def _tendon_bodies(simulated: Any, tendon: int) -> list[int]:
    first, found = int(simulated.tendon_adr[tendon]), []
    for w in range(first, first + int(simulated.tendon_num[tendon])):
        kind, at = mujoco.mjtWrap(int(simulated.wrap_type[w])), int(simulated.wrap_objid[w])
        if kind == mujoco.mjtWrap.mjWRAP_JOINT:
            found.append(int(simulated.jnt_bodyid[at]))
        elif kind == mujoco.mjtWrap.mjWRAP_SITE:
            found.append(int(simulated.site_bodyid[at]))
    return found


def _named(simulated: Any, roots: Sequence[str], path: Path | str) -> set[int]:
    names, tree, chosen = body_names(simulated), simulated.body_treeid, set()
    for name in roots:
        at = names.index(name) if name in names else -1
        below = {int(tree[b]) for b in range(1, simulated.nbody) if at in _ancestors(simulated, b)} - {-1}
        if not below:
            moving = [
                names[b] for b in range(1, simulated.nbody) if tree[b] >= 0 and tree[simulated.body_parentid[b]] < 0
            ]
            raise DeclarationError(
                "root", f"no body of {Path(path).name} that moves", value=name, allowed=", ".join(moving)
            )
        chosen |= below
    return chosen


def _ancestors(simulated: Any, body: int) -> set[int]:
    found = {body}
    while body:
        body = int(simulated.body_parentid[body])
        found.add(body)
    return found


def own_joints(simulated: Any, own: Iterable[int]) -> dict[str, int]:
    """Joints of the robot: their index in a MjModel by name, in its order."""
    bodies, names = set(own), joint_names(simulated)
    return {names[j]: j for j in range(simulated.njnt) if int(simulated.jnt_bodyid[j]) in bodies}
