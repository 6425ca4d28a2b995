"""Tables of closed loops; missed goals are bold."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from benchmarks.reports import report

Record = dict[str, Any]


def table(records: Iterable[Record], formulation: str) -> str:
    """A row for each robot, scene and variant; missed goals are bold."""
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

        ratio = f" ({r['ratio']:.3f} of exact{', same to the bit' * (r['apart'] == 0.0)})" if "ratio" in r else ""
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
