"""Equalities of an MJCF as couplings of joints and fixed tendons, and as closures of loops."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from hqp.arrays import Vec

from . import coupled
from .description import Closure, Description
from .mjcf_names import body_names, joint_names
from .mjcf_parts import equality_bodies
from .mujoco_extra import mujoco

_EQ = mujoco.mjtEq
_SITE = int(mujoco.mjtObj.mjOBJ_SITE)


def read(simulated: Any, found: Description, own: frozenset[int]) -> None:
    """Couplings and closures of the robot's bodies, and notes on equalities that are neither."""
    for e in range(simulated.neq):
        if own.isdisjoint(equality_bodies(simulated, e)):
            continue  # belongs to the scene
        name = simulated.eq(e).name or f"equality_{e}"
        if not simulated.eq_active0[e]:
            found.notes.append(f"equality {name} of the file is not active at first: not coupled")
            continue
        kind = _EQ(int(simulated.eq_type[e]))
        if kind in (_EQ.mjEQ_CONNECT, _EQ.mjEQ_WELD):
            why = _close(simulated, found, own, e, name)
        elif kind in (_EQ.mjEQ_JOINT, _EQ.mjEQ_TENDON):
            why = _couple(simulated, found, own, e)
        else:
            why = "no relation of joints or bodies"
        if why:
            word = kind.name.removeprefix("mjEQ_").lower()
            found.warnings.append(f"equality constraint {name} ({word}) of the file is ignored: {why}")


def lengths(simulated: Any) -> dict[int, tuple[dict[int, float], float]]:
    """Fixed tendons: coefficients by joint, and the length at qpos0."""
    found: dict[int, tuple[dict[int, float], float]] = {}
    for t in range(simulated.ntendon):
        first = int(simulated.tendon_adr[t])
        places = range(first, first + int(simulated.tendon_num[t]))
        if any(simulated.wrap_type[i] != mujoco.mjtWrap.mjWRAP_JOINT for i in places):
            continue
        terms: dict[int, float] = {}
        for i in places:
            joint = int(simulated.wrap_objid[i])
            terms[joint] = terms.get(joint, 0.0) + float(simulated.wrap_prm[i])
        found[t] = terms, float(simulated.tendon_length0[t])
    return found


def _couple(simulated: Any, found: Description, own: frozenset[int], e: int) -> str:
    """y1 - y1_0 = a0 + a1 (y2 - y2_0) of joints or fixed tendons; why it is no linear relation, "" where it is."""
    a = [float(x) for x in simulated.eq_data[e, :5]]
    one, two = int(simulated.eq_obj1id[e]), int(simulated.eq_obj2id[e])
    if int(simulated.eq_type[e]) == int(_EQ.mjEQ_TENDON):
        known = lengths(simulated)
    else:
        zeros = simulated.qpos0[simulated.jnt_qposadr]
        known = {j: ({j: 1.0}, float(zeros[j])) for j in range(simulated.njnt)}
    if one not in known or (two >= 0 and two not in known):
        return "a tendon along sites or geometries has no constant coefficients"
    if two >= 0 and any(a[2:]):
        degree = max(k for k in range(5) if a[k])
        return f"a polynomial of degree {degree}, couplings are linear"
    terms, offset = dict(known[one][0]), known[one][1] + a[0]
    if two >= 0 and a[1]:
        for joint, c in known[two][0].items():
            terms[joint] = terms.get(joint, 0.0) - a[1] * c
        offset -= a[1] * known[two][1]
    terms = {joint: c for joint, c in terms.items() if c}
    if not terms or any(int(simulated.jnt_bodyid[j]) not in own for j in terms):
        return "a joint of it is not the robot's"
    names = joint_names(simulated)
    coupling = {names[j]: c for j, c in terms.items()}, offset
    if len(coupled.solved([*found.couplings, coupling])) == len(found.couplings):
        return f"equalities before it determine {', '.join(coupling[0])}"
    found.couplings.append(coupling)
    return ""


def _close(simulated: Any, found: Description, own: frozenset[int], e: int, name: str) -> str:
    """Two frames that coincide, one on each body; why they cannot be, "" where they do."""
    ids, data = (int(simulated.eq_obj1id[e]), int(simulated.eq_obj2id[e])), np.array(simulated.eq_data[e])
    weld = int(simulated.eq_type[e]) == int(_EQ.mjEQ_WELD)
    if int(simulated.eq_objtype[e]) == _SITE:
        bodies = [int(simulated.site_bodyid[s]) for s in ids]
        places = [_placement(simulated.site_pos[s], simulated.site_quat[s]) for s in ids]
    else:
        bodies = list(ids)
        still = np.array((1.0, 0.0, 0.0, 0.0))
        if weld:
            places = [_placement(data[3:6], data[6:10]), _placement(data[:3], still)]
        else:
            places = [_placement(data[:3], still), _placement(data[3:6], still)]
    fixed = [simulated.body_treeid[body] < 0 for body in bodies]
    titles = body_names(simulated)
    for body, still_there in zip(bodies, fixed, strict=True):
        if simulated.body_mocapid[body] >= 0:
            return f"body {titles[body]!r} is moved by the program (mocap); a Pose task follows it"
        if not still_there and body not in own:
            return f"body {titles[body]!r} is not the robot's"
    frames = []
    for body, place in zip(bodies, places, strict=True):
        joint, carrier = found.carriers[body]
        title = f"{name}_{titles[body]}"
        while found.model.existFrame(title):
            title += "_"
        found.model.addFrame(pin.Frame(title, joint, 0, carrier * place, pin.FrameType.OP_FRAME), False)
        frames.append(title)
    frame, other = frames[::-1] if fixed[0] else frames
    found.closures.append(Closure(name, "Weld" if weld else "Ball", frame, other))
    return ""


def _placement(position: Vec, wxyz: Vec) -> Any:
    flat = np.empty(9)
    mujoco.mju_quat2Mat(flat, np.asarray(wxyz, dtype=np.float64))
    return pin.SE3(flat.reshape(3, 3), np.array(position, dtype=np.float64))
