"""Files of a retargeted motion."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .shortfalls import PARTS

if TYPE_CHECKING:
    from .retargeted import Retargeted

QUATERNION = "xyzw"
JOINT_ORDER = "depth first"


def as_npz(motion: Retargeted, path: Path) -> None:
    """All there is: q, v, contacts, fps, names and their orders, base and joints apart, the person in robot size,
    errors of hands and toes with their causes.
    """
    position, quaternion = motion.base
    np.savez_compressed(
        path, q=motion.q, v=motion.v, contacts=motion.contacts, fps=motion.fps,
        joint_names=np.array(motion.joint_names), contact_names=np.array(motion.contact_names),
        body_names=np.array(body_names(motion)),
        quaternion_order=QUATERNION, joint_order=JOINT_ORDER, robot=motion.robot.name, base_position=position,
        base_quaternion=quaternion, angles=motion.angles, person=motion.person,
        person_parents=np.array(motion.person_parents, dtype=int), part_names=np.array(PARTS),
        part_errors=np.column_stack([motion.measures.errors[part] for part in PARTS]), gave_way=motion.gave_way,
    )  # fmt: skip


def as_csv(motion: Retargeted, path: Path) -> None:
    """A row a frame without a header: base x y z, quaternion xyzw, joints in the robot's order [m, rad].

    The retargeted LAFAN1 of Unitree has this form, which BeyondMimic's csv_to_npz.py reads; the frame rate is not in
    it.
    """
    np.savetxt(path, np.hstack((*motion.base, motion.angles)), delimiter=",", fmt="%.9g")


def as_pickle(motion: Retargeted, path: Path) -> None:
    """The dictionary that GMR writes: fps, root_pos, root_rot (xyzw), dof_pos."""
    position, quaternion = motion.base
    told = {
        "fps": motion.fps, "root_pos": position.copy(), "root_rot": quaternion.copy(), "dof_pos": motion.angles,
        "local_body_pos": None, "link_body_list": None, "dof_names": list(motion.joint_names),
    }  # fmt: skip
    path.write_bytes(pickle.dumps(told))


def body_names(motion: Retargeted) -> list[str]:
    """The moving bodies by the joints that carry them, parents before children, the base first."""
    robot = motion.robot
    return [robot.joint_name(body[1]) for body in robot.bodies[1:]]
