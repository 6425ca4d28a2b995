"""Definition of a sweep: a function by name, and the cases it is called with, from Python or from TOML."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import itertools
import json
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from hqp.errors import DeclarationError

SOURCES = (".py", ".toml", ".csv", ".cpp", ".hpp")
"""Suffixes of the files that make up a code version: no binaries, which differ from machine to machine."""

MOST_CASES = 10_000_000
"""Limit of one file; they are all held in memory."""


@dataclass(frozen=True)
class Case:
    """One call: function, ``package.module:name``, and its keyword arguments, plain JSON values."""

    function: str
    arguments: Mapping[str, Any]

    @property
    def text(self) -> str:
        """The arguments as canonical JSON."""
        return canonical(self.arguments)

    def key(self, code: str) -> str:
        """Hash of function, arguments and code version: the name under which the result is stored."""
        return hashlib.sha256(f"{self.function}\n{self.text}\n{code}".encode()).hexdigest()[:24]


@dataclass(frozen=True)
class Sweep:
    """Cases of one function.

    function: ``package.module:name``, called as ``f(**arguments)``; it returns a mapping of numbers, text and lists.
    code: version of the code, part of every key; by default a hash of the sources (see ``code_version``).
    Raises DeclarationError for a function that cannot be found or arguments that are not plain JSON.
    """

    function: str
    arguments: Sequence[Mapping[str, Any]]
    code: str = ""
    folder: str = field(default="", compare=False)
    """Put on the path of imports, for a function in a file beside the cases."""

    def __post_init__(self) -> None:
        _look_in(self.folder)
        resolve(self.function)
        for arguments in self.arguments:
            canonical(arguments)
        if not self.code:
            object.__setattr__(self, "code", code_version(self.function))

    def __len__(self) -> int:
        return len(self.arguments)

    def __iter__(self) -> Iterator[Case]:
        return (Case(self.function, arguments) for arguments in self.arguments)


def load(path: str | Path, *, trust: bool = False) -> Sweep:
    """Read a sweep from TOML: ``function``, tables ``[fixed]`` and ``[grid]``, and any number of ``[[case]]``.

    Every value of ``[grid]`` is a list or ``{start, stop, step}``; the cases are the product of the grid with the
    ``[[case]]`` tables, each over ``[fixed]``.  The file is a program: its function is imported here and called by
    ``run``.  trust: any function of any installed package will do, not only those of hqp and of modules in the folder
    of the file.  Raises DeclarationError for an invalid file, before anything is imported.
    """
    path = Path(path)
    if sys.version_info >= (3, 11):
        import tomllib
    else:
        import tomli as tomllib
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise DeclarationError(str(path), f"cannot be read: {error}") from error
    known = {"function", "code", "fixed", "grid", "case"}
    if unknown := set(table) - known:
        raise DeclarationError(str(path), f"unknown {', '.join(sorted(unknown))}", allowed=", ".join(sorted(known)))
    if not isinstance(table.get("function"), str):
        allowed = 'function = "package.module:name"'
        raise DeclarationError(str(path), "does not name a function", value=table.get("function"), allowed=allowed)
    grid, fixed, cases = table.get("grid", {}), table.get("fixed", {}), table.get("case", [{}])
    if not (isinstance(grid, dict) and isinstance(fixed, dict)):
        raise DeclarationError(str(path), "grid and fixed must be tables", allowed="[grid], [fixed]")
    if not (isinstance(cases, list) and all(isinstance(case, dict) for case in cases)):
        raise DeclarationError(str(path), "the cases must be tables", allowed="[[case]]")
    grid = {name: _values(path, name, value) for name, value in grid.items()}
    count = math.prod(map(len, grid.values())) * len(cases)
    if count > MOST_CASES:
        raise DeclarationError(str(path), "too many cases", value=count, allowed=f"at most {MOST_CASES}")
    folder = str(path.resolve().parent)
    if not trust:
        _require_own(table["function"], folder)
    arguments = [
        {**fixed, **case, **dict(zip(grid, values, strict=True))}
        for case in cases
        for values in itertools.product(*grid.values())
    ]
    made = Sweep(table["function"], arguments, str(table.get("code", "")), folder)
    if not trust and table["function"].startswith("hqp."):
        _require_hqp(resolve(table["function"]), table["function"])
    return made


def _require_own(function: str, folder: str) -> None:
    """Raise DeclarationError for a module that is neither of hqp nor in the folder; it is looked for, not imported."""
    top = function.partition(":")[0].partition(".")[0]
    if top == "hqp" or not top:
        return
    _look_in(folder)
    try:
        spec = importlib.util.find_spec(top)
    except ValueError:  # a module without a spec, such as __main__
        raise _not_trusted(function) from None
    if spec is None:  # reported by its import
        return
    places = spec.submodule_search_locations or ([spec.origin] if spec.origin and spec.has_location else [])
    if not places or any(Path(place).parent.resolve() != Path(folder) for place in places):
        raise _not_trusted(function)


def _require_hqp(found: Any, function: str) -> None:
    """Raise DeclarationError for a function that a module of hqp has imported from elsewhere."""
    if not str(getattr(found, "__module__", "")).startswith("hqp."):
        raise _not_trusted(function)


def _not_trusted(function: str) -> DeclarationError:
    message = "a sweep file runs code, and this function is neither in hqp nor in the file's folder"
    return DeclarationError("sweep", message, value=function, allowed="--trust (trust=True) if you trust the file")


def _look_in(folder: str) -> None:
    """Put a folder on the path of imports."""
    if folder and folder not in sys.path:
        sys.path.insert(0, folder)


def _values(path: Path, name: str, value: Any) -> Sequence[Any]:
    if isinstance(value, list) and value:
        return value
    if isinstance(value, dict) and "stop" in value and set(value) <= {"start", "stop", "step"}:
        start, stop, step = value.get("start", 0), value["stop"], value.get("step", 1)
        if all(isinstance(x, int) for x in (start, stop, step)) and step:
            return range(start, stop, step)
        if all(isinstance(x, (int, float)) for x in (start, stop, step)) and step:
            count = (stop - start) / step + 0.5  # half a step of room, so that rounding drops no end
            if count <= MOST_CASES:
                return [start + i * step for i in range(max(0, math.floor(count)))]
    allowed = "a list of values, or {start, stop, step}"
    raise DeclarationError(str(path), f"[grid] {name} is not a range of values", value=value, allowed=allowed)


def canonical(value: Mapping[str, Any]) -> str:
    """JSON with sorted keys; raises DeclarationError for values without JSON form."""
    try:
        return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    except (TypeError, ValueError) as error:
        raise DeclarationError(
            "sweep", f"arguments of a case must be plain JSON values: {error}", value=value
        ) from error


@cache
def resolve(function: str) -> Callable[..., Mapping[str, Any]]:
    """The function of a name ``package.module:name``; raises DeclarationError if there is none."""
    module, colon, name = function.partition(":")
    try:
        found = getattr(importlib.import_module(module), name) if colon else None
    except Exception as error:  # arbitrary errors of the module's import
        raise DeclarationError("sweep", f"no function {function!r}: {error}", allowed="package.module:name") from error
    if not callable(found):
        raise DeclarationError("sweep", "no function", value=function, allowed="package.module:name")
    return found  # type: ignore[no-any-return]


@cache
def code_version(function: str) -> str:
    """Hash of the sources of hqp and of the function's top package: results of other code are other results."""
    packages = ["hqp", "hqp.tasks", "hqp.robots", function.partition(":")[0].partition(".")[0]]
    digest = hashlib.sha256()
    for name in dict.fromkeys(packages):
        for path in _sources(name):
            digest.update(path.name.encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _sources(package: str) -> list[Path]:
    spec = importlib.util.find_spec(package)
    if spec is None:
        return []
    folders = spec.submodule_search_locations
    if folders is None:
        return [Path(spec.origin)] if spec.origin else []
    own = [folder for folder in map(Path, folders) if folder.name == package.rpartition(".")[2]]  # an editable
    # installation adds the checkout itself
    found = (path for folder in own for path in folder.rglob("*") if path.suffix in SOURCES)
    return sorted(path for path in found if "__pycache__" not in path.parts)
