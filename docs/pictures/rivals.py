"""The README's comparison table from ``hqp bench --rivals ... --json FILE``: python -m docs.pictures.rivals FILE."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from hqp.markdown import table

ROOT = Path(__file__).parents[2]
START, END = "<!-- rivals -->", "<!-- /rivals -->"


def shown(told: dict[str, Any]) -> str:
    """A row per library: time, calm out of reach, outcome of each scene."""
    lines = {(x["library"], x["scene"]): x for x in told["lines"]}
    libraries = list(dict.fromkeys(x["library"] for x in told["lines"]))
    ours = lines["hqp", "nominal"]["p50_us"]
    header = (
        "", "median tick us", "p99", "times hqp", "largest jump out of reach rad/s", "reversals/s out of reach",
        "NaN target", "contradictory constraints", "repeated constraints", "start outside a limit",
    )  # fmt: skip
    body = []
    for library in libraries:
        nominal, far = lines[library, "nominal"], lines[library, "unreachable"]
        body.append((
            library, f"{nominal['p50_us']:.0f}", f"{nominal['p99_us']:.0f}", f"{nominal['p50_us'] / ours:.2f}",
            f"{far['jump']:.2g}", f"{far['reversals']:.0f}",
            *(_answer(lines[library, scene]) for scene in ("nan", "infeasible", "redundant")),
            _back(lines[library, "outside"]),
        ))  # fmt: skip
    m = told["manifest"]
    versions = ", ".join(listed[0] for listed in m["rivals"].values())
    return (
        f"{table(header, body)}\n\n{m['machine']['processor']}, shared, load {m['machine']['load'][0]:.1f}; hqp "
        f"{m['hqp']} {m['commit'][:10]}; {versions}; {m['made'][:10]}; {m['seconds']:g} s a scene. "
        "hqp orders levels strictly, the others weigh "
        "them; *hqp, price 0* is the exact problem without calm; *hqp, torques* and tsid solve for accelerations and "
        "contact forces."
    )


def _answer(line: dict[str, Any]) -> str:
    if line["failed"]:
        return f"no answer in {100 * line['failed'] / line['ticks']:.0f} % of ticks"
    return f"answers, reports {line['said']}" if line["said"] else "answers, no report"


def _back(line: dict[str, Any]) -> str:
    if line["failed"]:
        return f"no answer in {100 * line['failed'] / line['ticks']:.0f} % of ticks"
    return (
        f"comes back, jump {line['jump']:.2g} rad/s"
        if line["over_end"] < 1e-3
        else "stays outside"
    )


def main() -> None:
    """Put the table between its marks in the README."""
    path = ROOT / "README.md"
    text = path.read_text(encoding="utf-8")
    head, _, rest = text.partition(START)
    _, _, tail = rest.partition(END)
    body = shown(json.loads(Path(sys.argv[1]).read_text()))
    path.write_text(f"{head}{START}\n{body}\n{END}{tail}", encoding="utf-8")


if __name__ == "__main__":
    main()
