"""Where Dreamer's controller holds and where it does not: one change at a time, some with several seeds, and limits.

Every cell is ``pass``, ``FAIL`` (a limit was promised and missed) or, where nothing was promised, what came out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from benchmarks.experiments.cases import Case, carry_out, seeded
from benchmarks.experiments.compliance import Compliance
from benchmarks.experiments.dreamer_slope import NAMES, PULL
from benchmarks.experiments.human import SpringHand
from benchmarks.experiments.outcome import Figure, Outcome, Table, holds, number, table
from benchmarks.experiments.outing import Measures, Scene
from benchmarks.experiments.setting import Setting
from hqp.robots.on_mujoco import Noise, Sensors

ONE_CM = 10.0
"""The paper's claim [mm]."""

NOISY = Sensors(
    orientation=Noise(1e-3), gyro=Noise(0.01), angle=Noise(1e-4), rate=Noise(0.01), force=Noise(3.0)
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Cell:
    """A case with what was promised of it: the CoM error's limit [mm], inf for no fall, None for nothing."""

    case: Case
    group: str
    limit: float | None = None
    earlier: str = ""
    seeds: bool = False


def cells(full: bool) -> list[Cell]:
    """The table, or a few of its cells."""
    found: list[Cell] = []

    def add(
        group: str,
        name: str,
        scene: Scene,
        choice: Compliance = Compliance(),  # noqa: B008 (a frozen value)
        *,
        limit: float | None = None,
        earlier: str = "",
        seeds: bool = False,
    ) -> None:
        case = Case(name=f"{group}, {name}", scene=scene, choice=choice)
        found.append(Cell(case=case, group=group, limit=limit, earlier=earlier, seeds=seeds))

    ball, rollers = Scene(walk=PULL), Scene(plant="dreamer_rollers", walk=PULL)
    if not full:
        add("slope", "5 deg, ball wheels", replace(ball, slope=5.0), limit=6.0, earlier="2.6")
        add("friction", "0.25, rollers", replace(rollers, friction=0.25), limit=6.0, earlier="5.2")
        return found
    for scene in (ball, rollers):
        plant = NAMES[scene.plant]
        before = {0: ("2.6", "3.0"), 3: ("2.6", "3.0"), 5: ("2.6", "3.7"), 7: ("4.4", "4.8"), 8: ("5.7", "6.4"),
                  10: ("8.6", "falls"), 12: ("19", ""), 15: ("170", ""), 20: ("falls", "")}  # fmt: skip
        for slope, earlier in before.items():
            limit = 6.0 if slope <= 7 else 8.0 if slope == 8 else None
            if slope in (10, 12) and plant != "rollers":
                limit = math.inf
            if slope <= 10 or plant != "rollers":
                add(
                    "slope",
                    f"{slope} deg, {plant}",
                    replace(scene, slope=float(slope)),
                    limit=limit,
                    earlier=earlier[plant == "rollers"],
                    seeds=False,
                )
    for friction, earlier in ((1.0, "4.7"), (0.5, "4.9"), (0.3, "5.0"), (0.25, "5.2"), (0.2, "falls"), (0.15, "16")):
        limit = 6.0 if friction >= 0.25 else None
        add("friction", f"{friction:g}, rollers", replace(rollers, friction=friction), limit=limit, earlier=earlier)
    for speed, earlier in ((0.2, "1.9"), (0.5, "10.3"), (0.6, "13.6"), (0.8, "16.7")):
        scene = replace(ball, walk=replace(PULL, speed=0.95 * speed, distance=max(0.95, 2.0 * speed)))
        add("pull speed", f"{speed:g} m/s, ball wheels", scene, limit=2.5 if speed <= 0.2 else None, earlier=earlier)
    for force, earlier in ((20.0, "1.8"), (40.0, "3.5"), (60.0, "5.3"), (80.0, "127")):
        scene = Scene(slope=0.0, push=(force, 0.0, 0.0), seconds=5.0)
        add("step pull", f"{force:g} N ahead, flat", scene, limit=6.0 if force <= 60.0 else None, earlier=earlier)
    add("step pull", "60 N aside, flat", Scene(slope=0.0, push=(0.0, 60.0, 0.0), seconds=5.0), limit=6.0, earlier="4.8")
    for hz, earlier in ((100, "4.8"), (200, "4.5"), (500, "4.4"), (1000, "4.4")):
        add("control rate", f"{hz} Hz, ball wheels", ball, Compliance(period=1.0 / hz), limit=6.0, earlier=earlier)
    for ms, limit, earlier in ((2, 6.0, "4.8"), (4, 8.0, "5.2"), (10, 8.0, "6.4")):
        add("delay", f"{ms} ms, ball wheels", replace(ball, delay=1e-3 * ms), limit=limit, earlier=earlier)
    add("delay", "4 ms, rollers", replace(rollers, delay=0.004), limit=9.0)
    add(
        "noise", "all sensors, 4 ms, rollers", replace(rollers, delay=0.004, sensors=NOISY),
        limit=9.0, earlier="7.9", seeds=True,
    )  # fmt: skip
    add("noise", "all sensors, ball wheels", replace(ball, sensors=NOISY), limit=9.0, seeds=True)
    add(
        "noise", "all sensors, 4 ms, rollers, own map", replace(rollers, delay=0.004, sensors=NOISY),
        Compliance(normals="map"), limit=ONE_CM, seeds=True,
    )  # fmt: skip
    for degrees, limit, earlier in ((0.25, 10.0, "7.4"), (0.5, 15.0, "12.2"), (1.0, None, "22.9"), (2.0, None, "44")):
        biased = Sensors(orientation=Noise(bias=(0.0, math.radians(degrees), 0.0)))
        add(
            "pitch bias", f"{degrees:g} deg, ball wheels", replace(ball, sensors=biased), limit=limit, earlier=earlier
        )  # fmt: skip
    for degrees, earlier in ((0.5, "12"), (1.0, "21")):
        biased = Sensors(orientation=Noise(bias=(math.radians(degrees), 0.0, 0.0)))
        scene = replace(ball, sensors=biased)
        add("roll bias", f"{degrees:g} deg, ball wheels", scene, limit=math.inf, earlier=earlier)
    for mass, earlier in ((0.5, "11"), (1.0, "17.6")):
        add("payload", f"{mass:g} kg at the hand, ball wheels", replace(ball, payload=mass), earlier=earlier)
    add("mass error", "upper body 10 % heavier, ball wheels", replace(ball, extra_mass=1.1), earlier="8.1")
    for degrees, earlier in ((5, "4.4"), (10, "5.8"), (20, "4.3"), (30, "8.1"), (45, "7.4"), (60, "13"), (90, "97")):
        limit = 10.0 if degrees <= 45 else math.inf
        scene = replace(rollers if degrees <= 45 else ball, heading=math.radians(degrees))
        add("heading", f"{degrees} deg, {NAMES[scene.plant]}", scene, limit=limit, earlier=earlier)
    add("heading", "180 deg, ball wheels", replace(ball, heading=math.pi), earlier="49")
    combined = replace(
        rollers, slope=7.0, friction=0.5, delay=0.004, heading=math.radians(5.0), extra_mass=1.02,
        sensors=replace(NOISY, orientation=Noise(1e-3, (0.0, math.radians(0.25), 0.0))),
        hand=SpringHand(stiffness=300.0),
    )  # fmt: skip
    add("combined", "rollers", combined, limit=14.0, earlier="11.1", seeds=True)
    return found


@dataclass(frozen=True)
class Pair:
    """The projector and the HQP in one scene; text says what the HQP is told."""

    text: str
    projector: Case
    bounded: Case


def pairs(full: bool) -> list[Pair]:
    """Where torque limits and friction bind."""
    ball, rollers = Scene(walk=PULL), Scene(plant="dreamer_rollers", walk=PULL)
    bounded = Compliance(limits=True, com_acceleration=math.inf)
    uncapped = Compliance(com_acceleration=math.inf)
    scenes = [
        ("friction 0.2, rollers", replace(rollers, friction=0.2), Compliance(), replace(bounded, friction=0.18)),
    ]
    if full:
        away = replace(PULL, distance=0.3, back=False)
        scenes += [
            ("friction 0.15, rollers", replace(rollers, friction=0.15), Compliance(), replace(bounded, friction=0.135)),
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
                bounded,
            ),
            ("start out of place, no cap", Scene(out_of_place=1.0, walk=away), uncapped, bounded),
            ("7 deg, rollers", rollers, Compliance(), bounded),
        ]
    return [
        Pair(
            f"{name}",
            Case(name=f"{name}, projector", scene=scene, choice=plain, solver="nullspace"),
            Case(name=f"{name}, HQP", scene=scene, choice=hqp, solver="lexicographic"),
        )
        for name, scene, plain, hqp in scenes
    ]


def experiment(setting: Setting) -> Outcome:
    """The table, and the projector against the HQP with limits."""
    outcome = Outcome("dreamer-robustness")
    outcome.parameters = {"human's way": PULL, "gains": Compliance(), "noise": NOISY, "seeds": setting.seeds}
    listed = cells(setting.full)
    cases = [c for cell in listed for c in (seeded(cell.case, setting.seeds) if cell.seeds else [cell.case])]
    both = pairs(setting.full)
    cases += [case for pair in both for case in (pair.projector, pair.bounded)]
    measures = carry_out(cases, setting.solver, setting.jobs, setting.advance)
    rows = []
    for cell in listed:
        names = [c.name for c in seeded(cell.case, setting.seeds)] if cell.seeds else [cell.case.name]
        runs = [measures[name] for name in names]
        rows.append(_row(cell, runs))
        if cell.limit is not None:
            outcome.figures.append(_figure(cell, runs))
    header = ("cell", "verdict", "asked [mm]", "CoM up / back [mm]", "within 1 cm", "least load [N]", "earlier [mm]")
    outcome.tables.append(table("Robustness", header, rows))
    outcome.tables.append(_pairs(both, measures))
    slippery = both[0]
    outcome.figures += [
        holds(f"{slippery.text}: HQP with friction bounds stands", math.isnan(measures[slippery.bounded.name].fell)),
        Figure(f"{slippery.text}: CoM error, HQP", measures[slippery.bounded.name].com, "mm", high=ONE_CM),
        holds(
            f"{slippery.text}: projector stands",
            math.isnan(measures[slippery.projector.name].fell),
            wanted=False,
        ),
    ]
    return outcome


def _worst(runs: Sequence[Measures]) -> float:
    return max(run.com for run in runs)


def _figure(cell: Cell, runs: Sequence[Measures]) -> Figure:
    if cell.limit == math.inf:
        return holds(f"{cell.case.name}: no fall", math.isfinite(_worst(runs)), before=cell.earlier)
    seeds = f" (worst of {len(runs)})" if len(runs) > 1 else ""
    return Figure(
        f"{cell.case.name}: CoM error{seeds}", _worst(runs), "mm", high=cell.limit or 0.0, before=cell.earlier
    )


def _row(cell: Cell, runs: Sequence[Measures]) -> tuple[str, ...]:
    falls = sum(math.isfinite(run.fell) for run in runs)
    if cell.limit is None:
        verdict, asked = "outside", "nothing"
    else:
        verdict = "pass" if _worst(runs) <= cell.limit and not falls else "FAIL"
        asked = "no fall" if cell.limit == math.inf else f"{cell.limit:g}"
    if falls:
        times = ", ".join(f"{run.fell:.1f} s" for run in runs if math.isfinite(run.fell))
        shown = f"falls at {times}" + (f" ({falls} of {len(runs)})" if len(runs) > 1 else "")
    else:
        shown = f"{_spread([r.com_up for r in runs])} / {_spread([r.com_back for r in runs])}"
    within = "yes" if _worst(runs) <= ONE_CM else "no"
    return cell.case.name, verdict, asked, shown, within, _spread([r.load_least for r in runs]), cell.earlier


def _spread(values: Sequence[float]) -> str:
    low, high = min(values), max(values)
    return number(low) if len(values) == 1 else f"{number(low)} to {number(high)}"


def _pairs(both: Sequence[Pair], measures: Mapping[str, Measures]) -> Table:
    def say(m: Measures) -> str:
        outcome = f"falls at {m.fell:.1f} s" if math.isfinite(m.fell) else f"CoM {number(m.com)} mm"
        return f"{outcome}, unloaded {1e3 * m.unloaded:.0f} ms, slip {number(m.slip)} m/s"

    rows = [(pair.text, say(measures[pair.projector.name]), say(measures[pair.bounded.name])) for pair in both]
    header = ("scene", "projector, CoM task capped at 2.5 m/s^2", "HQP: torque limits, friction cones, no cap")
    return table("What inequalities buy", header, rows)
