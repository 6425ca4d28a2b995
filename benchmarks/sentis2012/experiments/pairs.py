"""The projector beside the hierarchy with limits, in scenes with active torque limits and friction."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from benchmarks.lab.outcome import Figure, Outcome, Table, holds, number, table
from benchmarks.lab.setting import Setting
from benchmarks.sentis2012.experiments.cases import Case, carry_out
from benchmarks.sentis2012.experiments.cells import ONE_CM
from benchmarks.sentis2012.experiments.compliance import Compliance
from benchmarks.sentis2012.experiments.measures import Measures
from benchmarks.sentis2012.experiments.scene import Scene
from benchmarks.sentis2012.experiments.slope_bound import slopes
from benchmarks.sentis2012.experiments.step_bound import steps
from benchmarks.sentis2012.experiments.variants import PULL


@dataclass(frozen=True)
class Pair:
    """The projector and the HQP in one scene; text: data that only the HQP receives."""

    text: str
    projector: Case
    bounded: Case


def pairs(full: bool) -> list[Pair]:
    """Scenes with active torque limits and friction; on slippery ground the HQP assumes 5 % less friction."""
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


def experiment(setting: Setting) -> Outcome:
    """Both side by side, and the requirements of statics at a step."""
    outcome = Outcome("dreamer-limits")
    outcome.parameters = {"human's way": PULL, "gains": Compliance()}
    both = pairs(setting.full)
    cases = [case for pair in both for case in (pair.projector, pair.bounded)]
    measures = carry_out(cases, setting.solver, setting.jobs, setting.advance)
    outcome.tables.append(_side_by_side(both, measures))
    if setting.full:
        outcome.tables += [steps(), slopes()]
    slippery = both[0]
    outcome.figures += [
        holds(f"{slippery.text}: HQP with friction bounds stands", math.isnan(measures[slippery.bounded.name].fell)),
        Figure(f"{slippery.text}: CoM error, HQP", measures[slippery.bounded.name].com, "mm", high=ONE_CM),
        holds(
            f"{slippery.text}: projector keeps the CoM within 1 cm",
            measures[slippery.projector.name].com <= ONE_CM,
            wanted=False,
        ),
    ]
    return outcome


def _side_by_side(both: Sequence[Pair], measures: Mapping[str, Measures]) -> Table:
    def say(m: Measures) -> str:
        outcome = f"falls at {m.fell:.1f} s" if math.isfinite(m.fell) else f"CoM {number(m.com)} mm"
        slip = "" if math.isnan(m.slip) else f", slip {number(m.slip)} m/s"
        return f"{outcome}, unloaded {1e3 * m.unloaded:.0f} ms{slip}"

    rows = [(pair.text, say(measures[pair.projector.name]), say(measures[pair.bounded.name])) for pair in both]
    header = ("scene", "projector, CoM task capped at 2.5 m/s^2", "HQP: torque limits, friction cones, no cap")
    return table("What inequalities buy", header, rows)
