"""The report as one page of HTML: verdict, table, plots; nothing is fetched when it is opened."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from hqp.arrays import Vec
from hqp.errors import HqpError

from .result import BEHAVIOUR, MISS

if TYPE_CHECKING:
    from .result import Bench, Change

COLORS = ("#1668c7", "#d97a00", "#1a8f4c", "#cf2a2a", "#7a4fb5", "#8c6239", "#5b6673")
BUDGET = "#cf2a2a"
LEAST = 1e-16  # smallest residual in the figure
_STYLE = """
body{font:16px/1.5 system-ui,-apple-system,'Segoe UI',Roboto,sans-serif;color:#1d2530;max-width:1180px;
margin:32px auto;padding:0 20px} h1{font-size:26px;margin:0 0 4px} h2{font-size:19px;margin:30px 0 6px}
p.sub{color:#66717f;margin:0 0 18px}
table{border-collapse:collapse;font-size:14px;margin:0 0 16px} th,td{padding:5px 10px;text-align:right;
border-bottom:1px solid #e3e7ec} td{white-space:nowrap} th:first-child,td:first-child{text-align:left}
div.wide{overflow-x:auto} table.about td{text-align:left;white-space:normal;vertical-align:top}
th{color:#66717f;font-weight:600} td.missed{color:#cf2a2a;font-weight:600} .note{color:#66717f;font-size:14px}
.faster{color:#1a8f4c}
.slower{color:#cf2a2a} code{background:#f2f4f7;padding:1px 5px;border-radius:4px}
"""


def render(bench: Bench, changes: tuple[Change, ...]) -> str:
    """The page; raises HqpError without plotly."""
    try:
        import plotly.graph_objects as graphs  # pyright: ignore[reportMissingImports]
        import plotly.subplots as subplots  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise HqpError("the page needs plotly: pip install 'hqp[lab]'") from error
    figures = [
        ("Time of a tick", "share of ticks that took at most so long; red: the period", _ecdf(graphs, bench)),
        ("Where the time goes", "medians of the four parts of a tick", _split(graphs, bench)),
        ("Residual of every level", "largest ‖w‖ of each hundredth of the run", _residuals(subplots, bench)),
        (
            "Change of the command in a tick",
            "fastest joint, largest of each hundredth of a run",
            _calm(graphs, bench),
        ),
    ]
    stack, _, rest = bench.title.partition("\n")
    body = [f"<h1>{escape(stack)}</h1>", f'<p class="sub">{escape(rest)}</p>', _verdict(changes)]
    header, cells = bench.header(), bench.cells()
    body += [
        _rows(header[:BEHAVIOUR], [row[:BEHAVIOUR] for row in cells]),
        _rows((header[0], *header[BEHAVIOUR:]), [(row[0], *row[BEHAVIOUR:]) for row in cells]),
        _rows(bench.residual_header(), bench.residual_cells()),
    ]
    body += [f'<p class="note">{escape(text)}</p>' for text in (bench.caption, *bench.notes)]
    for i, (title, note, figure) in enumerate(figures):
        plot = figure.to_html(full_html=False, include_plotlyjs=i == 0, config={"displayModeBar": False})
        body.append(f'<h2>{title}</h2><p class="note">{note}</p>{plot}')
    body.append(f"<h2>Measured on</h2>{_manifest(bench.manifest)}")
    title = escape(f"hqp bench: {bench.manifest['robot']}")
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        f"<style>{_STYLE}</style></head><body>{''.join(body)}</body></html>"
    )


def _rows(header: Sequence[str], body: Sequence[Sequence[str]]) -> str:
    head = "".join(f"<th>{escape(cell)}</th>" for cell in header)
    rows = "".join("<tr>" + "".join(map(_cell, cells)) + "</tr>" for cells in body)
    return f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>'


def _cell(text: str) -> str:
    return f'<td class="missed">{escape(text)}</td>' if text.endswith(MISS) else f"<td>{escape(text)}</td>"


def _verdict(changes: tuple[Change, ...]) -> str:
    if not changes:
        return ""
    items = "".join(
        f'<li>{escape(c.solver)}: <b class="{c.verdict.split()[0]}">{c.verdict}</b>, {c.ratio:.2f} times the older '
        f"run's (noise {100.0 * c.noise:.0f} %)</li>"
        for c in changes
    )
    return f"<h2>Against the older run</h2><ul>{items}</ul>"


def _manifest(manifest: dict[str, Any]) -> str:
    rows = "".join(f"<tr><td>{escape(k)}</td><td>{escape(_plain(v))}</td></tr>" for k, v in manifest.items())
    return f'<table class="about">{rows}</table>'


def _plain(value: Any) -> str:
    """A value of the manifest in words."""
    if isinstance(value, dict):
        return ", ".join(f"{key} {_plain(each)}" for key, each in value.items())
    if isinstance(value, (list, tuple)):
        return " ".join(map(_plain, value))
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _figure(
    graphs: Any, below: str, beside: str, x: dict[str, Any] | None = None, y: dict[str, Any] | None = None
) -> Any:
    figure = graphs.Figure()
    figure.update_layout(
        template="plotly_white", height=380, margin={"l": 60, "r": 20, "t": 10, "b": 50},
        xaxis={"title": below, **(x or {})}, yaxis={"title": beside, **(y or {})},
        legend={"orientation": "h", "y": 1.08}, font={"size": 14},
    )  # fmt: skip
    return figure


def _ecdf(graphs: Any, bench: Bench) -> Any:
    figure = _figure(graphs, "time of a tick [us]", "share of ticks", x={"type": "log"}, y={"range": [0, 1.02]})
    for i, run in enumerate(bench.runs):
        share = np.linspace(0.0, 1.0, 201)
        figure.add_scatter(
            x=np.quantile(run.total, share), y=share, name=run.solver, line={"color": _color(i), "width": 2.5}
        )
    figure.add_vline(x=1e6 * bench.manifest["dt"], line={"color": BUDGET, "width": 2})
    return figure


def _split(graphs: Any, bench: Bench) -> Any:
    figure = _figure(graphs, "median [us]", "", x={"type": "log"}, y={"autorange": "reversed"})
    lines = [line for line in bench.lines if line.ticks]
    for i, part in enumerate(("state", "assemble", "solve", "command")):
        figure.add_bar(
            y=[line.solver for line in lines], x=[line.split_us[part] for line in lines], name=part, orientation="h",
            marker={"color": _color(i)}, text=[_figures(line.split_us[part]) for line in lines], textposition="outside",
            cliponaxis=False,
        )  # fmt: skip
    figure.update_layout(barmode="group", height=140 + 100 * len(lines))
    return figure


def _figures(value: float) -> str:
    """Three figures, or all of a whole number."""
    return f"{value:.0f}" if value >= 100.0 else f"{value:.3g}"


def _residuals(subplots: Any, bench: Bench) -> Any:
    """A plot a level, one above the other."""
    names = bench.levels
    figure = subplots.make_subplots(
        rows=max(1, len(names)),
        cols=1,
        shared_xaxes=True,
        subplot_titles=names,
        vertical_spacing=0.2 / max(2, len(names)),
    )
    for i, run in enumerate(bench.runs):
        for k, name in enumerate(run.levels):
            t, curve = _largest(run.residuals[:, k], run.dt)
            style = {"color": _color(i), "width": 2}
            y, row = np.maximum(curve, LEAST), names.index(name) + 1
            figure.add_scatter(x=t, y=y, name=run.solver, line=style, showlegend=k == 0, row=row, col=1)
    most = max((float(np.nanmax(run.residuals, initial=0.0)) for run in bench.runs), default=0.0)
    span = [np.log10(LEAST) - 0.5, np.log10(max(most, 1.0)) + 0.5]
    figure.update_yaxes(type="log", exponentformat="power", dtick=4, range=span)
    figure.update_xaxes(title="time [s]", row=max(1, len(names)), col=1)
    figure.update_layout(
        template="plotly_white", height=100 + 150 * len(names), margin={"l": 60, "r": 20, "t": 60, "b": 50},
        legend={"orientation": "h", "yref": "container", "y": 1.0, "yanchor": "top"}, font={"size": 14},
    )  # fmt: skip
    return figure


def _calm(graphs: Any, bench: Bench) -> Any:
    figure = _figure(graphs, "time [s]", "largest change", y={"type": "log", "exponentformat": "power"})
    for i, run in enumerate(bench.runs):
        change = np.abs(np.diff(run.commands, axis=0)).max(axis=1, initial=0.0)
        t, curve = _largest(change, run.dt)
        figure.add_scatter(x=t, y=np.maximum(curve, 1e-12), name=run.solver, line={"color": _color(i), "width": 2})
    return figure


def _largest(values: Vec, dt: float) -> tuple[Vec, Vec]:
    parts = np.array_split(np.nan_to_num(values), min(100, max(1, values.size)))
    ends = np.cumsum([part.size for part in parts])
    return dt * ends, np.array([part.max(initial=0.0) for part in parts])


def _color(i: int) -> str:
    return COLORS[i % len(COLORS)]
