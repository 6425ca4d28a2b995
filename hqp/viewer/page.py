"""The page's text: an overlay on the scene and the side panel, as HTML from an account and curves."""

from __future__ import annotations

from html import escape

import numpy as np

from hqp.arrays import Vec
from hqp.explanation.counters import Counters

from .account import Account, ElementView, LevelView
from .history import SECONDS, Curves

INK, SOFT, LINE = "#1d2530", "#66717f", "#dfe4ea"
COLORS = {"met": "#1a8f4c", "moving": "#1668c7", "short": "#d97a00", "violated": "#cf2a2a"}
TONES = {"good": "#1a8f4c", "warn": "#d97a00", "bad": "#cf2a2a"}
SHOWN = 4
"""Joints that are listed one by one."""

WORDS = {"met": "met", "moving": "on its way", "short": "gives way", "violated": "violated"}
_FONT = "font-family:Inter,system-ui,-apple-system,'Segoe UI',Roboto,sans-serif"


def overlay(account: Account, curves: Curves, subtitle: str, panel: str) -> str:
    """The headline and the stack as the paper writes it, level by level, over the scene.

    panel: width of the side panel, a CSS length that the overlay leaves free.
    """
    tone = TONES[account.tone]
    constraints = [level for level in account.levels if level.title == "subject_to"]
    tasks = [level for level in account.levels if level.title != "subject_to"]
    cards = []
    for i, level in enumerate(tasks):
        if i:
            cards.append(_sign("≻"))
        cards.append(_card(level, curves.norms[level.index] if level.index >= 0 else np.zeros(0), len(tasks)))
    if constraints:
        cards.append(_sign("s.t."))
        cards.append(_constraints(constraints))
    return (
        f'<div style="position:fixed;left:0;top:0;width:calc(100vw - {panel});box-sizing:border-box;'
        f'padding:18px 22px;pointer-events:none;z-index:1000;{_FONT};color:{INK}">'
        f'<div style="background:rgba(255,255,255,.94);border-left:10px solid {tone};border-radius:8px;'
        f'padding:12px 18px;box-shadow:0 2px 10px rgba(20,30,50,.13);display:inline-block;max-width:100%">'
        f'<div style="font-size:30px;font-weight:750;line-height:1.2">{escape(account.headline)}</div>'
        f'<div style="font-size:19px;color:{tone};font-weight:600;margin-top:2px">{escape(account.reason)}</div>'
        f'<div style="font-size:14px;color:{SOFT};margin-top:2px">{escape(subtitle)} · {escape(account.status)}</div>'
        f"</div>"
        f'<div style="display:flex;align-items:stretch;gap:6px;margin-top:12px;flex-wrap:nowrap">{"".join(cards)}</div>'
        f"</div>"
    )


def _sign(text: str) -> str:
    return f'<div style="align-self:center;font-size:24px;font-weight:600;color:{SOFT}">{text}</div>'


def _card(level: LevelView, curve: Vec, count: int) -> str:
    color = COLORS[level.state]
    width = "flex:1 1 0;min-width:0"
    names = [e.name for e in level.elements]
    whole, longest = len(" + ".join(names)), max(len(part) for name in names for part in name.split("_"))
    size = 18 if whole <= 18 and longest * count <= 50 else 15 if whole <= 30 and longest * count <= 64 else 12
    words = " + ".join(_breakable(name) for name in names)
    return (
        f'<div style="{width};background:rgba(255,255,255,.94);border-radius:8px;border-top:6px solid {color};'
        f"padding:8px {'12px' if count < 5 else '9px'};box-shadow:0 2px 8px rgba(20,30,50,.12);overflow:hidden;"
        f'display:flex;flex-direction:column;justify-content:space-between">'
        f'<div style="display:flex;justify-content:space-between;gap:0 8px;align-items:baseline;flex-wrap:wrap">'
        f'<div style="font-size:13px;color:{SOFT};white-space:nowrap;overflow:hidden;text-overflow:ellipsis">'
        f"{escape(level.title)}</div>"
        f'<div style="font-size:14px;font-weight:700;color:{color};white-space:nowrap">{WORDS[level.state]}</div></div>'
        f'<div style="font-size:{size}px;font-weight:650;line-height:1.25;overflow-wrap:anywhere">{words}</div>'
        f"{sparkline(curve, color, log=True)}"
        f'<div style="font-size:14px;color:{SOFT};white-space:nowrap">residual '
        f'<b style="color:{INK}">{number(level.residual)}</b></div></div>'
    )


def _breakable(name: str) -> str:
    """A name that may break after its underscores only."""
    return "_<wbr>".join(escape(part) for part in name.split("_"))


def _constraints(levels: list[LevelView]) -> str:
    lines = []
    for view in (e for level in levels for e in level.elements):
        color = COLORS[view.state]
        extra = f'<span style="color:{SOFT};font-weight:400"> {escape(view.why)}</span>' if view.why else ""
        lines.append(
            f'<div style="white-space:nowrap"><span style="color:{color}">●</span> {escape(view.name)}{extra}</div>'
        )
    return (
        f'<div style="flex:0 1 auto;background:rgba(255,255,255,.94);border-radius:8px;border-top:6px solid {LINE};'
        f"padding:8px 12px;font-size:14px;line-height:1.45;font-weight:600;"
        f'box-shadow:0 2px 8px rgba(20,30,50,.12)">{"".join(lines)}</div>'
    )


def panel(account: Account, curves: Curves, budget_us: float, unit: str) -> str:
    """The side panel: levels and their losses, joints at limits, changes of the command, times."""
    return (
        f'<div style="{_FONT};color:{INK};font-size:16px;padding:2px 4px">'
        + _section("What gives way", _losses(account))
        + (_section("Kept apart", _apart(account)) if account.apart else "")
        + _section("Joints at a limit", _limits(account))
        + _section("Change of the command in a tick", _change(curves, unit))
        + _section("Time of a tick", _times(curves, budget_us))
        + ("" if account.counters is None else _section("Since the session was made", _counters(account.counters)))
        + "</div>"
    )


def _section(title: str, body: str) -> str:
    return (
        f'<div style="margin:0 0 10px"><div style="font-size:13px;font-weight:700;letter-spacing:.04em;'
        f'text-transform:uppercase;color:{SOFT};margin-bottom:4px">{title}</div>{body}</div>'
    )


def _losses(account: Account) -> str:
    views = [e for level in account.levels for e in level.elements if e.state in ("short", "violated")]
    if not views:
        return f'<div style="color:{COLORS["met"]};font-weight:600">No one: every level is met</div>'
    return "".join(map(_loss, views[:3]))


def _loss(view: ElementView) -> str:
    distance = f'<span style="color:{SOFT}"> · {escape(view.distance)} off</span>' if view.distance else ""
    return (
        f'<div style="margin-bottom:6px;line-height:1.3"><b style="color:{COLORS[view.state]}">{escape(view.name)}</b>'
        f"{distance}<br>{escape(view.why)}</div>"
    )


def _apart(account: Account) -> str:
    """Pairs of links at their clearance."""
    listed = "".join(f"<div>{escape(pair)}</div>" for pair in account.apart[:SHOWN])
    more = len(account.apart) - SHOWN
    return listed + (f'<div style="color:{SOFT}">and {more} more</div>' if more > 0 else "")


def _limits(account: Account) -> str:
    listed = [joint for joint in account.joints if not joint.what.startswith("held")]
    held = len(account.joints) - len(listed)
    lines = []
    for joint in listed[:SHOWN]:
        bar = ""
        if joint.place is not None:
            left = 100.0 * min(max(joint.place, 0.0), 1.0)
            bar = (
                f'<div style="height:5px;background:{LINE};border-radius:3px;position:relative;margin-top:2px">'
                f'<div style="position:absolute;left:calc({left:.1f}% - 4px);top:-2px;width:9px;height:9px;'
                f'border-radius:3px;background:{COLORS["short"]}"></div></div>'
            )
        lines.append(
            f'<div style="margin-bottom:5px;line-height:1.25"><b>{escape(joint.name)}</b> '
            f'<span style="color:{SOFT};font-size:14px">{escape(joint.what)}</span>{bar}</div>'
        )
    if len(listed) > SHOWN:
        lines.append(f'<div style="color:{SOFT}">and {len(listed) - SHOWN} more</div>')
    if not listed:
        lines.append(f'<div style="color:{COLORS["met"]};font-weight:600">None at the end of its range</div>')
    if held:
        lines.append(f'<div style="color:{SOFT}">{held} braking or at the acceleration limit</div>')
    return "".join(lines)


def _change(curves: Curves, unit: str) -> str:
    if not np.isfinite(curves.change).any():
        return ""
    largest = float(np.nanmax(curves.change))
    now = float(curves.change[np.isfinite(curves.change)][-1])
    return (
        f'<div><b style="font-size:22px">{number(now)}</b> <span style="color:{SOFT}">{unit} now, '
        f"{number(largest)} at most in {SECONDS:.0f} s</span></div>"
        + sparkline(curves.change, COLORS["moving"], log=True, floor=1e-4, height=44)
    )


def _times(curves: Curves, budget_us: float) -> str:
    times = curves.all_times[-4000:]
    if not times.size:
        return ""
    p50, p99, worst = np.percentile(times, 50), np.percentile(times, 99), times.max()
    misses = int((times > budget_us).sum())
    color = COLORS["met"] if not misses else COLORS["violated"]
    said = "none over budget" if not misses else f"{misses} of {times.size} over budget"
    return (
        f'<div><b style="font-size:22px">{p50:.0f} us</b> <span style="color:{SOFT}">median, p99 {p99:.0f}, '
        f'worst {worst:.0f}; </span><b style="color:{color}">{said}</b></div>'
        + sparkline(curves.times, COLORS["met"], log=True, floor=10.0, height=56, line=budget_us)
        + f'<div style="font-size:13px;color:{SOFT}">red line: the budget, {budget_us:.0f} us</div>'
    )


def _counters(counters: Counters) -> str:
    """Ticks, and how many of them were out of the ordinary."""
    bad = ("late", "cut", "held", "rejected_states", "rejected_references")
    counted = {name.replace("_", " "): getattr(counters, name) for name in bad}
    listed = ", ".join(f"{count} {name}" for name, count in counted.items() if count) or "all in time, none held"
    color = COLORS["short"] if any(counted.values()) else COLORS["met"]
    return (
        f'<div><b style="font-size:22px">{counters.ticks}</b> <span style="color:{SOFT}">ticks; </span>'
        f'<b style="color:{color}">{listed}</b></div><div style="font-size:13px;color:{SOFT}">longest gap '
        f"{1e3 * counters.longest_gap:.3g} ms, longest tick {1e3 * counters.worst_time:.3g} ms</div>"
    )


def sparkline(
    curve: Vec, color: str, *, log: bool = False, floor: float = 1e-6, height: int = 34, line: float | None = None
) -> str:
    """A curve over the last seconds as inline SVG; ``log``: a logarithmic axis from ``floor`` up; line: a limit."""
    width = 300.0
    values = np.where(np.isfinite(curve), curve, np.nan)
    if not np.isfinite(values).any():
        return f'<svg width="100%" height="{height}"></svg>'
    top = max(float(np.nanmax(values)), 10.0 * floor, 0.0 if line is None else 1.6 * line)

    def level(value: Vec) -> Vec:
        if log:
            return np.asarray(np.log10(np.maximum(value, floor) / floor) / np.log10(top / floor))
        return np.asarray(value / top)

    y = height - 3.0 - (height - 6.0) * level(values)
    x = np.linspace(0.0, width, values.size)
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True) if np.isfinite(b))
    first = float(x[np.isfinite(y)][0])
    area = f"{first:.1f},{height} {points} {width:.1f},{height}"
    limit = ""
    if line is not None:
        at = height - 3.0 - (height - 6.0) * float(level(np.array(line)))
        limit = (
            f'<line x1="0" x2="{width}" y1="{at:.1f}" y2="{at:.1f}" stroke="{COLORS["violated"]}" '
            'stroke-width="2" vector-effect="non-scaling-stroke"/>'
        )
    return (
        f'<svg viewBox="0 0 {width:.0f} {height}" width="100%" height="{height}" preserveAspectRatio="none" '
        f'style="display:block;margin:3px 0"><polygon points="{area}" fill="{color}" opacity=".13"/>'
        f'<polyline points="{points}" fill="none" stroke="{color}" stroke-width="2" '
        f'vector-effect="non-scaling-stroke"/>{limit}</svg>'
    )


def number(value: float) -> str:
    """A number as a person reads it: three digits, small ones as zero or a power of ten."""
    if not np.isfinite(value):
        return "–"
    if abs(value) < 1e-9:
        return "0"
    if abs(value) < 1e-3:
        return f"{value:.0e}".replace("e-0", "e-")
    return f"{value:.3g}"
