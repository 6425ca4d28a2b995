"""The report of a retargeted motion as one page: figures, unmet targets, pictures of the worst frames, curves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.errors import HqpError

from .shortfalls import PARTS

if TYPE_CHECKING:
    from .retargeted import Retargeted

_STYLE = """
body{font:16px/1.5 system-ui,sans-serif;color:#1d2530;max-width:1180px;margin:32px auto;padding:0 20px}
h1{font-size:26px;margin:0 0 4px} h2{font-size:19px;margin:30px 0 6px} p{color:#66717f;margin:0 0 10px}
table{border-collapse:collapse;font-size:14px} th,td{padding:5px 10px;text-align:left;border-bottom:1px solid #e3e7ec}
"""
MILLI = 1e3
TURNS = ("torso", "hips", "left_sole", "right_sole")


def render(motion: Retargeted) -> str:
    """The page; nothing is fetched when it is opened.  Raises HqpError without plotly."""
    try:
        import plotly.graph_objects as graphs  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise HqpError("the page needs plotly: pip install 'hqp[motion]'") from error
    m, curves = motion.measures, []
    errors = {name: MILLI * e for name, e in m.errors.items() if name not in TURNS}
    turns = {name: e for name, e in m.errors.items() if name not in errors}
    curves.append(("Distance from the targets", "mm", errors))
    curves.append(("Turn from the targets", "rad", turns))
    curves.append(("Slide of standing feet", "mm/s", {side: MILLI * s for side, s in m.slide.items()}))
    curves.append(("Depth below the floor, distance of the nearest links", "mm", {
        "depth": MILLI * m.penetration,
        "nearest links": MILLI * np.where(np.isfinite(m.clearance), m.clearance, np.nan),
    }))  # fmt: skip
    curves.append(("Acceleration of the fastest joint", "rad/s²", {"joints": m.acceleration}))
    curves.append(("Jerk of the fastest joint", "rad/s³", {"joints": m.jerk}))
    curves.append(("Fastest joint by its speed limit", "", {"joints": m.speed}))
    body = [f"<h1>{escape(motion.robot.name)}</h1>", *(f"<p>{escape(note)}</p>" for note in motion.notes)]
    body += [f"<p>{escape(motion.lines()[0])}</p>", _figures(motion)]
    body += [_shortfalls(motion), _gave_way(motion), *_worst(graphs, motion)]
    for title, unit, lines in curves:
        figure = _figure(graphs, unit, lines, motion.fps)
        plot = figure.to_html(full_html=False, include_plotlyjs=False, config={"displayModeBar": False})
        body.append(f"<h2>{escape(title)}</h2>{plot}")
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>hqp retarget: {escape(motion.robot.name)}'
        f"</title><style>{_STYLE}</style></head><body>{''.join(body)}</body></html>"
    )


def _figures(motion: Retargeted) -> str:
    rows = "".join(f"<tr><td>{escape(line)}</td></tr>" for line in motion.lines()[1:])
    statuses = ", ".join(f"{name} {count}" for name, count in motion.statuses.items())
    return f"<table>{rows}<tr><td>ticks: {escape(statuses)}</td></tr></table>"


def _shortfalls(motion: Retargeted) -> str:
    if not motion.shortfalls:
        met = "No hand and no foot was more than 50 mm off, trunk and soles were within 45 degrees."
        return f"<h2>Unmet targets</h2><p>{met}</p>"
    rows = "".join(
        f"<tr><td>{escape(s.part)}</td><td>{s.first / motion.fps:.2f} to {s.last / motion.fps:.2f} s</td>"
        f"<td>{s.by}</td><td>{escape(s.reason)}</td></tr>"
        for s in motion.shortfalls
    )
    head = "<tr><th>part</th><th>when</th><th>most</th><th>cause</th></tr>"
    return f"<h2>Unmet targets</h2><table>{head}{rows}</table>"


def _gave_way(motion: Retargeted) -> str:
    """Duration and largest error of each cause, for each hand and toe."""
    rows = ""
    for k, part in enumerate(PARTS):
        whom, error = motion.gave_way[:, k], motion.measures.errors[part]
        for name in sorted(set(whom.tolist()) - {""}):
            then = whom == name
            rows += f"<tr><td>{part}</td><td>{escape(name)}</td><td>{then.sum() / motion.fps:.2f} s</td>"
            rows += f"<td>{MILLI * error[then].max():.0f} mm</td></tr>"
    if not rows:
        return "<h2>Causes of deviations</h2><p>No hand and no toe was more than 5 mm off.</p>"
    head = "<tr><th>part</th><th>cause</th><th>for</th><th>most</th></tr>"
    return f"<h2>Causes of deviations</h2><p>Hands and toes that are more than 5 mm off.</p><table>{head}{rows}</table>"


def _worst(graphs: Any, motion: Retargeted) -> Iterator[str]:
    """Pictures of the frames in which a hand and a toe are furthest off: joints of robot and person."""
    for i, limb in enumerate(("hand", "toe")):
        own = {part: motion.measures.errors[part] for part in PARTS if limb in part}
        part = max(own, key=lambda name: float(own[name].max()))
        frame = int(own[part].argmax())
        state = motion.robot.state(motion.q[frame])
        state.kinematics()
        bodies = motion.robot.bodies
        robot = np.array([p for *_, (p, _) in bodies])
        parents = [int(body[0]) if k > 1 else -1 for k, body in enumerate(bodies)]
        figure = graphs.Figure()
        figure.update_layout(template="plotly_white", height=460, margin={"l": 0, "r": 0, "t": 0, "b": 0})
        spans = np.ptp(np.vstack((robot, motion.person[frame])), axis=0)
        away = float(spans.max() / np.prod(spans) ** (1.0 / 3.0))  # plotly's largest axis: all of it is to be seen
        figure.update_scenes(aspectmode="data", camera={"eye": {"x": 1.25 * away, "y": 1.25 * away, "z": 0.4 * away}})
        drawn = (("robot", robot, parents), ("person", motion.person[frame], motion.person_parents))
        for name, joints, above in drawn:
            x, y, z = _lines(joints, above).T
            figure.add_scatter3d(x=x, y=y, z=z, name=name, mode="lines", line={"width": 6})
        plot = figure.to_html(full_html=False, include_plotlyjs=i == 0, config={"displayModeBar": False})
        off, when = MILLI * float(own[part][frame]), frame / motion.fps
        yield f"<h2>Worst {limb}: {part}, {off:.0f} mm off at {when:.2f} s (frame {frame})</h2>{plot}"


def _lines(joints: Mat, parents: Sequence[int]) -> Mat:
    """From each joint to its parent, with gaps ``(n, 3)``; the joints alone where nobody has a parent."""
    pairs = [(child, parent) for child, parent in enumerate(parents) if parent >= 0]
    gap = np.full(3, np.nan)
    return np.array([p for child, parent in pairs for p in (joints[child], joints[parent], gap)] or joints)


def _figure(graphs: Any, unit: str, lines: dict[str, Vec], fps: float) -> Any:
    figure = graphs.Figure()
    figure.update_layout(
        template="plotly_white", height=350, margin={"l": 60, "r": 20, "t": 60, "b": 50}, font={"size": 14},
        xaxis={"title": "time [s]"}, yaxis={"title": unit}, legend={"orientation": "h", "y": 1.0, "yanchor": "bottom"},
    )  # fmt: skip
    for name, values in lines.items():
        figure.add_scatter(x=np.arange(len(values)) / fps, y=np.round(values, 4), name=name, line={"width": 1.5})
    return figure
