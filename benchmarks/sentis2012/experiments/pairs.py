"""The projector and the hierarchy with limits side by side, where torque limits and friction bind."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from benchmarks.sentis2012.experiments.cases import Case
from benchmarks.sentis2012.experiments.compliance import Compliance
from benchmarks.sentis2012.experiments.scene import Scene
from benchmarks.sentis2012.experiments.variants import PULL


@dataclass(frozen=True)
class Pair:
    """The projector and the HQP in one scene; text says what the HQP is told."""

    text: str
    projector: Case
    bounded: Case


def pairs(full: bool) -> list[Pair]:
    """Where torque limits and friction bind; the HQP assumes 5 % less friction than there is where it is little."""
    ball, rollers = Scene(walk=PULL), Scene(plant="dreamer_rollers", walk=PULL)
    bounded = Compliance(limits=True, com_acceleration=math.inf)
    uncapped = Compliance(com_acceleration=math.inf)
    scenes = [
        ("friction 0.2, rollers", replace(rollers, friction=0.2), Compliance(), replace(bounded, friction=0.19)),
    ]
    if full:
        away = replace(PULL, distance=0.3, back=False)
        scenes += [
            (
                "friction 0.15, rollers",
                replace(rollers, friction=0.15),
                Compliance(),
                replace(bounded, friction=0.1425),
            ),
            ("10 deg, ball wheels", replace(ball, slope=10.0), Compliance(), bounded),
            ("10 deg, rollers", replace(rollers, slope=10.0), Compliance(), bounded),
            ("12 deg, ball wheels", replace(ball, slope=12.0), Compliance(), bounded),
            ("15 deg, ball wheels", replace(ball, slope=15.0), Compliance(), bounded),
            ("10 deg, ball wheels, projector without cap", replace(ball, slope=10.0), uncapped, bounded),
            ("step pull of 80 N, flat", Scene(slope=0.0, push=(80.0, 0.0, 0.0), seconds=5.0), Compliance(), bounded),
            ("step pull of 120 N, flat", Scene(slope=0.0, push=(120.0, 0, 0), seconds=5.0), Compliance(), bounded),
            (
                "step pull of 60 N aside, flat",
                Scene(slope=0.0, push=(0.0, 60.0, 0), seconds=5.0),
                Compliance(),
                replace(bounded, least_load=60.0),
            ),
            ("heading 60 deg, ball wheels", replace(ball, heading=math.radians(60.0)), Compliance(), bounded),
            ("start out of place, no cap", Scene(out_of_place=1.0, walk=away), uncapped, bounded),
            ("7 deg, rollers", rollers, Compliance(), bounded),
        ]
    return [
        Pair(
            name,
            Case(name=f"{name}, projector", scene=scene, choice=plain, solver="nullspace"),
            Case(name=f"{name}, HQP", scene=scene, choice=hqp, solver="lexicographic"),
        )
        for name, scene, plain, hqp in scenes
    ]
