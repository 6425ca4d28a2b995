"""Results on disk: Parquet parts, each written whole or not at all, and the finished cases of a sweep."""

from __future__ import annotations

import json
import os
import time
import uuid
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hqp.errors import DeclarationError

Row = Mapping[str, Any]

EVERY_ROWS, EVERY_SECONDS = 1000, 5.0
"""A part is written after so many rows or so long: the loss of a crash."""

MANY_PARTS = 64
"""More parts than this are merged when a run ends."""


def _arrow() -> Any:
    try:
        import pyarrow as arrow
        import pyarrow.parquet
    except ImportError as missing:
        raise DeclarationError("sweep", "needs pyarrow", allowed="pip install 'hqp[sweep]'") from missing
    return arrow


class Store:
    """The parts of one folder; ``add`` keeps rows and writes them now and then, ``close`` writes the rest."""

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        self._waiting: list[Row] = []
        self._written = time.monotonic()
        _arrow()

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def add(self, rows: Sequence[Row]) -> None:
        """Keep rows; write a part if enough has come together."""
        self._waiting += rows
        if len(self._waiting) >= EVERY_ROWS or time.monotonic() - self._written > EVERY_SECONDS:
            self.flush()

    def flush(self) -> None:
        """Write the waiting rows as one part."""
        if self._waiting:
            self._write(_table(self._waiting))
            self._waiting = []
        self._written = time.monotonic()

    def close(self) -> None:
        """Write the rest, and merge the parts where there are many."""
        self.flush()
        parts = _parts(self.folder)
        if len(parts) > MANY_PARTS:
            self._write(read(self.folder))
            for part in parts:  # a crash before this leaves a row twice, which ``read`` sees once
                part.unlink(missing_ok=True)  # another program may have merged as well

    def done(self, failed: bool = True) -> frozenset[str]:
        """Keys of the results that are there; without ``failed``, of those that ended without an exception."""
        found: set[str] = set()
        for table in _tables(self.folder, columns=["key", "ok"]):
            columns = zip(table["key"].to_pylist(), table["ok"].to_pylist(), strict=True)
            found.update(key for key, ok in columns if ok or failed)
        return frozenset(found)

    def manifest(self, content: Mapping[str, Any]) -> None:
        """Add the settings of a run to ``manifest.json``, a list with one entry a run."""
        path = self.folder / "manifest.json"
        runs = json.loads(path.read_text()) if path.exists() else []
        _replace(path, json.dumps([*runs, dict(content)], indent=1).encode())

    def _write(self, table: Any) -> None:
        sink = _arrow().BufferOutputStream()
        _arrow().parquet.write_table(table, sink)
        # uuid: two programs may write into one folder
        _replace(self.folder / f"part-{time.time_ns():020d}-{uuid.uuid4().hex[:8]}.parquet", sink.getvalue())


def read(folder: str | Path) -> Any:
    """All rows as a pyarrow.Table, the latest where a key is there twice; an empty one without parts.

    Columns: key, code, function, case (JSON), ok, error, seconds, host, process, finished [s since 1970]; an argument
    ``x`` as ``case.x``, a result ``y`` as ``result.y``.
    """
    arrow = _arrow()
    tables = _tables(Path(folder))
    if not tables:
        return arrow.table({})
    try:
        whole = arrow.concat_tables(tables, promote_options="permissive")
    except arrow.ArrowTypeError:  # numbers in one part, text in another: anew from their values
        return _table(_latest([row for table in tables for row in table.to_pylist()]))
    latest = {key: i for i, key in enumerate(whole["key"].to_pylist())}
    return whole.take(sorted(latest.values()))


def _latest(rows: Sequence[Row]) -> list[Row]:
    return list({row["key"]: row for row in rows}.values())


def _table(rows: Sequence[Row]) -> Any:
    names = list(dict.fromkeys(name for row in rows for name in row))
    return _arrow().table({name: _column([row.get(name) for row in rows]) for name in names})


def _column(values: Sequence[Any]) -> Any:
    arrow = _arrow()
    try:
        return arrow.array(values)
    except (arrow.ArrowInvalid, arrow.ArrowTypeError):  # 1 beside 1.5, or beside "none"
        numbers = all(x is None or isinstance(x, (int, float)) for x in values)
        if numbers:
            return arrow.array([None if x is None else float(x) for x in values])
        return arrow.array([None if x is None else x if isinstance(x, str) else json.dumps(x) for x in values])


def _tables(folder: Path, columns: Sequence[str] | None = None) -> list[Any]:
    """The parts; all anew where another program merged them in the meantime."""
    arrow = _arrow()
    while True:
        try:
            return [arrow.parquet.read_table(part, columns=columns) for part in _parts(folder)]
        except FileNotFoundError:
            continue


def _parts(folder: Path) -> list[Path]:
    return sorted(folder.glob("part-*.parquet"))


def _replace(path: Path, content: Any) -> None:
    """Write beside it, then rename: a reader sees the old file or the new one, never half of it."""
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    with open(beside, "wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    os.replace(beside, path)
