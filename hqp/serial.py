"""Stacks as plain dictionaries and TOML: a tree equal to that of the constructors, classes found by their names."""

from __future__ import annotations

import dataclasses
import json
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from hqp.declare.element import REGISTRY, Element
from hqp.declare.law import LAWS, Law
from hqp.declare.price import Price
from hqp.declare.stack import Level, Stack
from hqp.errors import DeclarationError, closest
from hqp.sequence import EVENTS, Event, Phase
from hqp.sequence import Sequence as Phases

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

T = TypeVar("T")


def to_dict(stack: Stack) -> dict[str, Any]:
    """The stack as nested dictionaries, fields at their defaults left out."""
    tree: dict[str, Any] = {"level": []}
    for level in stack.levels:
        entry: dict[str, Any] = {"name": level.name} if level.name else {}
        if level.price is not None:
            entry["price"] = _price(level.price)
        if level.when:
            entry["when"] = _lists(level.when)
        tree["level"].append({**entry, "element": [_element(e) for e in level]})
    if stack.subject_to:
        tree["subject_to"] = [_element(e) for e in stack.subject_to]
    return tree


def from_dict(tree: Mapping[str, Any]) -> Stack:
    """The stack of such dictionaries; raises DeclarationError for unknown keys, classes or fields (closest named)."""
    if not isinstance(tree, Mapping):
        raise DeclarationError("stack", "not a table", value=tree)
    _known(tree, ("level", "subject_to", "phase"), "stack")
    levels = []
    for entry in _tables(tree, "level", "stack"):
        _known(entry, ("name", "price", "when", "element"), "level")
        name = entry.get("name", "")
        if not isinstance(name, str):
            raise DeclarationError("level", "name must be a string", value=name)
        price = entry.get("price")
        if isinstance(price, Mapping):
            price = _construct(Price, price)
        members = [_build(e) for e in _tables(entry, "element", "level")]
        levels.append(Level(*members, name=name, price=price, when=entry.get("when", ())))
    return Stack(*levels, subject_to=[_build(e) for e in _tables(tree, "subject_to", "stack")])


def loads(text: str) -> Stack:
    """The stack of a TOML text; raises DeclarationError where it is no TOML or no stack."""
    return from_dict(_tree(text))


def loads_phases(text: str) -> Phases:
    """The Sequence of a TOML text, its tables ``[[phase]]``, beside a stack or alone.

    Raises DeclarationError where it is no TOML, or has no phases.
    """
    return Phases(*map(_build_phase, _tables(_tree(text), "phase", "sequence")))


def dumps_phases(sequence: Phases) -> str:
    """A Sequence as TOML, read back by ``loads_phases`` to an equal one."""
    return "\n".join(line for phase in sequence.phases for line in ("[[phase]]", *_pairs(_phase(phase)), ""))


def _tree(text: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise DeclarationError("stack", "not TOML: nested too deeply") from error
    except (TypeError, ValueError) as error:  # TOMLDecodeError, a number of thousands of digits, no text
        raise DeclarationError("stack", f"not TOML: {error}") from error


def load(path: str | Path) -> Stack:
    """The stack of a TOML file; raises DeclarationError where the file is missing or no stack."""
    return loads(_text(path))


def load_phases(path: str | Path) -> Phases | None:
    """The Sequence of a TOML file, None where it has no ``[[phase]]``; raises DeclarationError as ``loads_phases``."""
    text = _text(path)
    return loads_phases(text) if "phase" in _tree(text) else None


def _text(path: str | Path) -> str:
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise DeclarationError("stack", f"{path} is not UTF-8: {error}") from error
    except (OSError, TypeError, ValueError) as error:
        raise DeclarationError("stack", f"cannot be read: {error}") from error


def dumps(stack: Stack) -> str:
    """The stack as TOML, read back by ``loads`` to an equal stack."""
    tree = to_dict(stack)
    lines: list[str] = []
    for level in tree["level"]:
        lines += ["[[level]]", *_pairs(level, skip="element"), ""]
        for element in level["element"]:
            lines += ["[[level.element]]", *_pairs(element), ""]
    for element in tree.get("subject_to", ()):
        lines += ["[[subject_to]]", *_pairs(element), ""]
    return "\n".join(lines)


def _element(element: Element) -> dict[str, Any]:
    return _typed(element, element.default_name())


def _phase(phase: Phase) -> dict[str, Any]:
    entry = _fields(phase)
    return {**entry, "laws": {name: _typed(law) for name, law in dict(phase.laws).items()}} if phase.laws else entry


def _typed(value: Any, default_name: str = "") -> dict[str, Any]:
    return {"type": type(value).__name__, **_fields(value, default_name)}


def _price(price: Price) -> Any:
    return 0 if price.tau == 0.0 else _fields(price)


def _fields(value: Any, default_name: str = "") -> dict[str, Any]:
    out: dict[str, Any] = {}
    for item in dataclasses.fields(value):
        given = getattr(value, item.name)
        default = default_name if item.name == "name" else item.default
        if given == default:
            continue
        if isinstance(given, Element):
            given = _element(given)
        elif isinstance(given, (Law, Event)):
            given = _typed(given)
        out[item.name] = _lists(given)
    return out


def _lists(value: Any) -> Any:
    return [_lists(v) for v in value] if isinstance(value, tuple) else value


def _tuples(value: Any) -> Any:
    if isinstance(value, int) and value.bit_length() > 63:
        raise DeclarationError("stack", f"an integer of {value.bit_length()} bits", allowed="64 bits, as TOML says")
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value


def _tables(entry: Mapping[str, Any], key: str, where: str) -> Sequence[Mapping[str, Any]]:
    """The list of tables under a key, empty without it."""
    found = entry.get(key, ())
    if not isinstance(found, (list, tuple)) or not all(isinstance(item, Mapping) for item in found):
        raise DeclarationError(where, f"{key} must be a list of tables", value=found, allowed=f"[[{key}]]")
    return found


def _build(entry: Mapping[str, Any]) -> Element:
    fields = dict(entry)
    name = fields.pop("type", None)
    import hqp.tasks  # noqa: F401  (its classes register themselves)

    if not isinstance(name, str) or name not in REGISTRY:
        near = ", ".join(closest(str(name), REGISTRY))
        raise DeclarationError("stack", f"unknown type of element; closest: {near}", value=name)
    if isinstance(fields.get("law"), Mapping):
        fields["law"] = _named(fields["law"], LAWS, "law")
    if isinstance(fields.get("task"), Mapping):  # task of a Within
        fields["task"] = _build(fields["task"])
    return _construct(REGISTRY[name], fields)


def _build_phase(entry: Mapping[str, Any]) -> Phase:
    fields = dict(entry)
    if isinstance(fields.get("until"), Mapping):
        fields["until"] = _named(fields["until"], EVENTS, "until")
    if isinstance(laws := fields.get("laws"), Mapping):
        fields["laws"] = {
            name: _named(law, LAWS, "law") if isinstance(law, Mapping) else law for name, law in laws.items()
        }
    return _construct(Phase, fields)


def _named(entry: Mapping[str, Any], kinds: Mapping[str, type[T]], where: str) -> T:
    """A law or an event, by the name of its class."""
    fields = dict(entry)
    kind = kinds.get(str(fields.pop("type", "")))
    if kind is None:
        raise DeclarationError(where, "unknown type", value=entry.get("type"), allowed=", ".join(kinds))
    return _construct(kind, fields)


def _construct(kind: type[T], fields: Mapping[str, Any]) -> T:
    allowed = [item.name for item in dataclasses.fields(kind) if item.init]  # type: ignore[arg-type]
    _known(fields, allowed, kind.__name__)
    try:
        return kind(**{key: _tuples(value) for key, value in fields.items()})
    except DeclarationError:
        raise
    except (TypeError, ValueError, OverflowError) as error:
        raise DeclarationError(kind.__name__, str(error)) from error


def _known(entry: Mapping[str, Any], allowed: Any, where: str) -> None:
    for key in entry:
        if key not in allowed:
            raise DeclarationError(where, "unknown key", value=key, allowed=", ".join(allowed))


def _pairs(entry: Mapping[str, Any], skip: str = "") -> Iterator[str]:
    for key, value in entry.items():
        if key != skip:
            bare = re.fullmatch(r"[A-Za-z0-9_-]+", key)
            yield f"{key if bare else json.dumps(key)} = {_toml(value)}"


def _toml(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(_pairs(value)) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(_toml(v) for v in value) + "]"
    if isinstance(value, (bool, str)):
        return json.dumps(value)
    return repr(value)
