"""Hierarchies as Parquet files: a schema, a loader, and their levels as quadratic programmes for qpbenchmark."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hqp.arrays import Vec
from hqp.errors import DeclarationError, HqpError
from hqp.problem import Hierarchy, Rows, Selection
from hqp.solvers import exact as exact_solver
from hqp.solvers import load as load_solver

FORMAT = 1

SCHEMA = """One row a hierarchy.  n: variables.  constraints: leading levels meant to hold exactly.  rows: of each
level.  A: of all levels, row by row, empty where a level only picks variables.  index, scale: of those picks, -1 and 0
elsewhere.  lower, upper: of all rows.  Metadata hqp: JSON with format, name, description and difficulty of the set."""


def write(path: str | Path, problems: Iterable[Hierarchy], *, name: str, description: str, difficulty: str) -> Path:
    """Write hierarchies without metric, origin and prices; raises DeclarationError for others, HqpError for pyarrow."""
    pyarrow, parquet = _pyarrow()
    table: dict[str, list[Any]] = {k: [] for k in ("n", "constraints", "rows", "A", "index", "scale", "lower", "upper")}
    for problem in problems:
        if problem.metric is not None or problem.origin is not None or problem.priced:
            raise DeclarationError("problem set", "takes no metric, origin or price", value=problem)
        table["n"].append(problem.n)
        table["constraints"].append(problem.constraints)
        table["rows"].append([rows.m for rows in problem.levels])
        picks = [isinstance(rows.A, Selection) for rows in problem.levels]
        dense = [rows.dense(problem.n).ravel() for rows, p in zip(problem.levels, picks, strict=True) if not p]
        table["A"].append(np.concatenate([*dense, np.zeros(0)]))
        table["index"].append(_joined(problem, lambda rows: rows.A.index if picked(rows) else np.full(rows.m, -1)))
        table["scale"].append(_joined(problem, lambda rows: rows.A.scale if picked(rows) else np.zeros(rows.m)))
        table["lower"].append(_joined(problem, lambda rows: rows.lower))
        table["upper"].append(_joined(problem, lambda rows: rows.upper))
    about = {"format": FORMAT, "name": name, "description": description, "difficulty": difficulty, "schema": SCHEMA}
    made = pyarrow.table(table).replace_schema_metadata({b"hqp": json.dumps(about).encode()})
    parquet.write_table(made, path, compression="zstd")
    return Path(path)


def read(path: str | Path) -> tuple[Hierarchy, ...]:
    """The hierarchies of a file; raises DeclarationError for a file of another kind or a later format."""
    about(path)
    _, parquet = _pyarrow()
    return tuple(_hierarchy(row) for row in parquet.read_table(path).to_pylist())


def about(path: str | Path) -> dict[str, Any]:
    """Name, description and difficulty of a set; raises DeclarationError for a file of another kind."""
    pyarrow, parquet = _pyarrow()
    try:
        metadata = parquet.read_schema(path).metadata or {}
        found: dict[str, Any] = json.loads(metadata[b"hqp"])
    except (OSError, KeyError, ValueError, pyarrow.ArrowException) as error:
        raise DeclarationError("problem set", f"not a problem set: {error}", value=str(path)) from error
    if found.get("format") != FORMAT:
        raise DeclarationError("problem set", "unknown format", value=found.get("format"), allowed=str(FORMAT))
    return found


def quadratic_programmes(problem: Hierarchy, name: str) -> Iterator[dict[str, Any]]:
    """Each level as min 1/2 ||w||^2 + 1e-9/2 ||x||^2 over (x, w), the levels above held at their optimum.

    Keys are those of qpsolvers: P, q, G, h, A, b, lb, ub, and name.  Optima are those of ``lexicographic``.
    """
    n = problem.n
    solution = load_solver(exact_solver()).workspace(problem.shape).solve(problem)
    for k, level in enumerate(problem.levels):
        m = level.m
        size = n + m
        P = np.diag(np.concatenate((np.full(n, 1e-9), np.ones(m))))
        equal: list[tuple[Any, Vec]] = []
        below: list[tuple[Any, Vec]] = []
        for j, rows in enumerate(problem.levels[: k + 1]):
            A = np.zeros((rows.m, size))
            A[:, :n] = rows.dense(n)
            if j == k:
                A[:, n:] = -np.eye(m)
            shift = np.zeros(rows.m) if j == k else solution.residuals[j]
            same = rows.equality
            equal.append((A[same], (rows.lower + shift)[same]))
            upper, lower = ~same & np.isfinite(rows.upper), ~same & np.isfinite(rows.lower)
            below.append((A[upper], (rows.upper + shift)[upper]))
            below.append((-A[lower], -(rows.lower + shift)[lower]))
        A, b = (np.concatenate(part) for part in zip(*equal, strict=True))
        G, h = (np.concatenate(part) for part in zip(*below, strict=True))
        some = {"G": G if h.size else None, "h": h if h.size else None}
        exact = {"A": A if b.size else None, "b": b if b.size else None}
        yield {"P": P, "q": np.zeros(size), **some, **exact, "lb": None, "ub": None, "name": f"{name}_level_{k}"}


def to_qpbenchmark(source: str | Path, target: str | Path) -> Path:
    """Export every level of a set as a file that ``qpbenchmark.ParquetTestSet`` reads."""
    pyarrow, parquet = _pyarrow()
    columns: dict[str, list[Any]] = {key: [] for key in ("P", "q", "G", "h", "A", "b", "lb", "ub", "name")}
    for i, problem in enumerate(read(source)):
        for programme in quadratic_programmes(problem, f"{Path(source).stem}_{i}"):
            for key, value in programme.items():
                columns[key].append(value.ravel() if isinstance(value, np.ndarray) else value)
    numbers = pyarrow.list_(pyarrow.float64())
    arrays = {key: pyarrow.array(v, None if key == "name" else numbers) for key, v in columns.items()}
    parquet.write_table(pyarrow.table(arrays), target)
    return Path(target)


def picked(rows: Rows) -> bool:
    """Return true if every row picks one variable."""
    return isinstance(rows.A, Selection)


def _joined(problem: Hierarchy, of: Any) -> Vec:
    return np.concatenate([*(of(rows) for rows in problem.levels), np.zeros(0)])


def _hierarchy(row: Mapping[str, Any]) -> Hierarchy:
    n, levels, at, used = row["n"], [], 0, 0
    A, index, scale, lower, upper = (
        np.array(row[k], dtype=np.float64) for k in ("A", "index", "scale", "lower", "upper")
    )
    for m in row["rows"]:
        part = slice(at, at + m)
        if m and index[at] >= 0:
            coefficients: Any = Selection(index[part].astype(np.intp), scale[part])
        else:
            coefficients = A[used : used + m * n].reshape(m, n)
            used += m * n
        levels.append(Rows(coefficients, lower[part], upper[part]))
        at += m
    return Hierarchy(tuple(levels), constraints=row["constraints"], n=n)


def _pyarrow() -> tuple[Any, Any]:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise HqpError("problem sets need pyarrow: pip install 'hqp[lab]'") from error
    return pyarrow, pyarrow.parquet
