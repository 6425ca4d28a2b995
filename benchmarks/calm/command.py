"""Closed loops that try to make a controller restless: targets out of reach, at the edge, blocked, contradictory.

Exact and priced levels side by side on the exact integrator at 500 Hz: changes of command, reversals, accelerations,
errors, times; a walking hand under torque control with friction; CBi under servos in MuJoCo.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.calm import continuity, drawn, goals
from benchmarks.calm.loop import EXACT, PRICED, VARIANTS, Run, Variant, figures
from benchmarks.calm.loop import run as carry_out
from benchmarks.calm.robots import ARMS, HUMANOIDS, ROBOTS
from benchmarks.calm.scenes import FORMULATIONS, Scene, scenes
from benchmarks.calm.walking import SOLES, walking
from benchmarks.reports import report

MAIN = (*HUMANOIDS, *ARMS)
QUICK = ("talos", "ur5")
SAME_LIMITS = VARIANTS["exact, default limits"]
SHOWN = ("beyond",)
"""Scenes whose commands are drawn."""

PAGE = Path(__file__).parents[2] / "docs" / "calm.md"
MARK = "<!-- tables: python -m benchmarks calm --page docs/calm.md -->"
"""Of the page, before what is written by this command."""

NEIGHBOURS = (
    "All data of the priced levels moved by 1e-6: how often the answer changes by more than 0.01. What still jumps\n"
    "hands down an exact row in a direction that is lost but for 1e-6, and turns with the data."
)

DRAWN = (
    "Ten robots, rates of 100 to 1000 Hz, one hand or two, with or without orientation, gains of 0.5 to 10; half of\n"
    "them have a speed limit for hands and CoM, none for base and posture; targets are 0.1 to 1.2 m away in any\n"
    "direction, a quarter of them circles. A median acceleration that the exact answer has itself, within 5 %, is\n"
    "what the path asks for."
)

Record = dict[str, Any]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this part."""
    parser.add_argument("--robots", nargs="+", choices=ROBOTS, metavar="ROBOT", help=f"of {', '.join(ROBOTS)}")
    parser.add_argument("--formulations", nargs="+", choices=tuple(FORMULATIONS), default=list(FORMULATIONS))
    parser.add_argument("--scenes", nargs="+", metavar="SCENE", help="names of scenes, all by default")
    parser.add_argument("--variants", nargs="+", choices=tuple(VARIANTS), default=[EXACT.name, PRICED.name])
    parser.add_argument("--ticks", type=int, default=1500, metavar="N", help="of 2 ms, judged over the second half")
    parser.add_argument("--no-walking", action="store_true", help="leave the walking hand and MuJoCo out")
    parser.add_argument("--drawn", type=int, default=40, metavar="N", help="loops drawn at random of each formulation")
    parser.add_argument("--seed", type=int, default=0, metavar="K", help="of the first of them")
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the tables there as a page of the docs too")


def run(arguments: argparse.Namespace) -> int:
    """Run, show, write; returns 1 if priced levels break a promise; goals of calm that are missed are told."""
    robots = arguments.robots or (QUICK if arguments.quick else MAIN)
    variants = [VARIANTS[name] for name in arguments.variants]
    wanted = set(arguments.scenes or (("within", "beyond") if arguments.quick else ()))
    records = list(_loops(robots, arguments.formulations, variants, wanted, arguments.ticks, arguments.output))
    sections = [f"## {f}\n\n{table(records, f)}" for f in arguments.formulations]
    if not arguments.no_walking and not arguments.quick:
        walked = list(_walks([r for r in robots if r in SOLES], variants, arguments.ticks))
        sections.append(f"## A hand that walks away, torque control with friction\n\n{walking_table(walked)}")
        records += walked
        if "cbi" in robots and importlib.util.find_spec("mujoco") is not None:
            servo = list(_servo(variants))
            sections.append(f"## CBi under position servos in MuJoCo\n\n{servo_table(servo)}")
            records += servo
    if not arguments.quick and arguments.drawn > 0:
        seeds = range(arguments.seed, arguments.seed + arguments.drawn)
        loops = [record for f in arguments.formulations for record in drawn.loops(f, seeds)]
        sections.append(f"## Loops drawn at random\n\n{DRAWN}\n\n{drawn.table(loops)}")
        records += loops
    found = [continuity.measure(family, 100 if arguments.quick else 1000) for family in continuity.FAMILIES]
    sections.append(f"## Neighbouring problems\n\n{NEIGHBOURS}\n\n{continuity.table(found)}")
    missed = [r for r in records if r["variant"] == PRICED.name and r["misses"]]
    told = "\n".join(f"- {r['robot']}, {r['formulation']}, {r['scene']}: {', '.join(r['misses'])}" for r in missed)
    sections.append(f"## Goals missed by priced levels\n\n{told or 'None.'}\n")
    text = "\n".join(sections)
    report.section(arguments.output, "calm", text)
    if arguments.page is not None:
        arguments.page.write_text(_page(text))
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(records, indent=1))
    closed = len({(r["robot"], r["formulation"], r["scene"]) for r in records})
    lines = [f"{closed} closed loops, {len(missed)} with a goal missed by priced levels"]
    failures = [f"{one.family}: {100.0 * one.jumps[1]:.1f} % of neighbours jump" for one in found if not one.kept]
    for r in missed:
        broken = goals.PROMISES & set(r["misses"])
        line = f"{r['robot']}, {r['formulation']}, {r['scene']}: {', '.join(r['misses'])}"
        (failures if broken else lines).append(line if broken else f"missed: {line}")
    return report.conclude(arguments.output, "calm", lines, failures)


def _loops(
    robots: Sequence[str], formulations: Sequence[str], variants: Sequence[Variant], wanted: set[str], ticks: int,
    output: Path,
) -> Iterable[Record]:  # fmt: skip
    for robot in robots:
        for formulation in formulations:
            names = [n for n in scenes(robot, formulation, {}) if not wanted or n in wanted]
            for name in names:

                def scene_of(
                    variant: Variant, robot: str = robot, formulation: str = formulation, name: str = name
                ) -> Scene:
                    return scenes(robot, formulation, variant.limits)[name]()

                runs: dict[str, Run] = {}
                found: dict[str, Record] = {}
                for variant in variants:
                    scene = scene_of(variant)
                    runs[variant.name] = data = carry_out(scene, variant, ticks)
                    record: Record = {
                        "robot": robot, "formulation": formulation, "scene": name, "variant": variant.name,
                        **figures(data),
                    }  # fmt: skip
                    record["misses"] = list(goals.misses(formulation, record))
                    found[variant.name] = record
                if scene.within and PRICED.name in found:
                    record = found[PRICED.name]
                    same = figures(carry_out(scene_of(PRICED), SAME_LIMITS, ticks))  # what the price alone costs
                    record["ratio"] = record["error"] / max(float(same["error"]), 1e-12)
                    if goals.loses(record, same):
                        record["misses"].append("error")
                if name in SHOWN and importlib.util.find_spec("matplotlib") is not None:
                    from benchmarks.calm import plots

                    plots.commands(runs, output / f"calm_{robot}_{formulation}_{name.replace(' ', '_')}.png")
                report.console.print(f"{robot}, {formulation}: {name}")
                yield from found.values()


def _walks(robots: Sequence[str], variants: Sequence[Variant], ticks: int) -> Iterable[Record]:
    for robot in robots:
        for variant in variants:
            record: Record = {
                "robot": robot, "formulation": "torque", "scene": "walking hand", "variant": variant.name,
                **figures(carry_out(walking(robot, variant.limits), variant, ticks)),
            }  # fmt: skip
            record["misses"] = list(goals.walking_misses(record))
            report.console.print(f"{robot}: walking hand, {variant.name}")
            yield record


def _servo(variants: Sequence[Variant]) -> Iterable[Record]:
    from benchmarks.calm import servo

    for variant in variants:
        record: Record = {
            "robot": "cbi", "formulation": "velocity", "scene": "servos", "variant": variant.name,
            **servo.reaching(variant),
        }  # fmt: skip
        record["misses"] = ["com"] if record["com"] > servo.COM else []
        yield record


def table(records: Iterable[Record], formulation: str) -> str:
    """A row for each robot, scene and variant; what misses its goal is bold."""
    header = (
        "robot", "scene", "variant", "largest change a tick", "reversals/s", "acceleration p50 / p99", "error [mm]",
        "levels above", "feet, CoM [mm]", "tick p50 / p99 [us]", "not OPTIMAL",
    )  # fmt: skip
    rows = []
    for r in records:
        if r["formulation"] != formulation:
            continue

        def cell(name: str, text: str, r: Record = r) -> str:
            return f"**{text}**" if name in r["misses"] else text

        ratio = f" ({r['ratio']:.3f} of exact)" if "ratio" in r else ""
        acceleration = " / ".join(cell(f"acceleration_{p}", f"{r[f'acceleration_{p}']:.3g}") for p in ("p50", "p99"))
        rows.append((
            r["robot"], r["scene"], r["variant"], cell("jump", f"{r['jump']:.3g}"),
            cell("reversals", f"{r['reversals']:.0f}"), acceleration, cell("error", f"{1e3 * r['error']:.3g}{ratio}"),
            cell("above", f"{r['above']:.1e}"), f"{1e3 * r['contact']:.2g}, {1e3 * r['com']:.2g}",
            f"{r['tick_p50']:.0f} / {r['tick_p99']:.0f}", _others(r["statuses"]),
        ))  # fmt: skip
    return report.table(header, rows)


def walking_table(records: Iterable[Record]) -> str:
    """A row for each robot and variant."""
    header = (
        "robot", "variant", "CoM [mm]", "over a limit [mrad]", "least f_z [N]", "change a tick p50 / p99 / max [N m]",
        "reversals/s", "tick p50 / p99 / max [us]", "not OPTIMAL",
    )  # fmt: skip
    return report.table(header, [(
        r["robot"], r["variant"], f"{1e3 * r['com']:.3g}", f"{1e3 * r['over']:.3g}", f"{r['load']:.1f}",
        f"{r['jump_p50']:.2g} / {r['jump_p99']:.3g} / {r['jump']:.3g}", f"{r['reversals']:.0f}",
        f"{r['tick_p50']:.0f} / {r['tick_p99']:.0f} / {r['tick_max']:.0f}", _others(r["statuses"]),
    ) for r in records])  # fmt: skip


def servo_table(records: Iterable[Record]) -> str:
    """A row for each variant."""
    header = ("variant", "CoM [mm]", "torque [N m]", "change a tick p50 / max [rad/s]", "height of the pelvis")
    return report.table(header, [(
        r["variant"], f"{1e3 * r['com']:.3g}", f"{r['torque']:.3g}", f"{r['jump_p50']:.2g} / {r['jump']:.2g}",
        f"{100 * r['upright']:.0f} %",
    ) for r in records])  # fmt: skip


def _others(statuses: str) -> str:
    return ", ".join(part for part in statuses.split(", ") if not part.startswith("OPTIMAL"))


def _page(text: str) -> str:
    head, mark, _ = PAGE.read_text().partition(MARK)
    return head + mark + "\n\n" + text if mark else text
