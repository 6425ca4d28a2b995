"""Numbers of declarations: any real scalar is taken, a plain one is stored."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable
from numbers import Integral, Real
from typing import Any

from hqp.errors import DeclarationError


def plain(value: Any) -> float | None:
    """Return a real scalar as a plain int or float, None for anything else.

    A scalar of NumPy or an array library without dimensions counts, too; a truth value or a complex one does not.
    """
    scalar = isinstance(value, Real) or getattr(value, "shape", None) == ()
    kind = str(getattr(value, "dtype", ""))
    if not scalar or isinstance(value, bool) or "bool" in kind or "complex" in kind:
        return None
    try:
        return int(value) if isinstance(value, Integral) else float(value)
    except (TypeError, ValueError, OverflowError):
        return None


def number(
    owner: str,
    field: str,
    value: Any,
    low: float = -math.inf,
    *,
    strict: bool = False,
    most: float = math.inf,
    below: float = math.inf,
    infinite: bool = False,
    unit: str = "",
) -> float:
    """Return a declared number as a plain one.

    Raises DeclarationError unless it is finite, from ``low`` up (above it if strict), at most ``most``, less than
    ``below``; ``infinite`` allows infinity, too.
    """
    found = plain(value)
    if found is not None:
        within = low <= found <= most and found < below and abs(found) <= sys.float_info.max
        if (within and not (strict and found == low)) or (infinite and found == math.inf):
            return found
    bounds = [] if low == -math.inf else [f"above {low:g}" if strict else f"from {low:g} up"]
    bounds += [f"{word} {bound:g}" for word, bound in (("at most", most), ("below", below)) if bound < math.inf]
    allowed = f"{'a' if infinite else 'a finite'} number {', '.join(bounds)}".strip()
    raise DeclarationError(owner, f"bad {field}", value=value, unit=unit, allowed=allowed)


def whole(owner: str, field: str, value: Any, low: int, most: float = math.inf) -> int:
    """Return a declared whole number, of any storage, as an int; raises DeclarationError unless low <= it <= most."""
    found = plain(value)
    if found is not None and low <= found <= most and found == math.floor(min(found, sys.float_info.max)):
        return int(found)
    bounds = f"from {low} up" if most == math.inf else f"from {low} to {most:g}"
    raise DeclarationError(owner, f"bad {field}", value=value, allowed=f"a whole number {bounds}")


def set_numbers(declared: object, owner: str, fields: Iterable[str], low: float = -math.inf, **bounds: Any) -> None:
    """Check fields of a declaration with ``number`` and store them as plain numbers."""
    for field in fields:
        object.__setattr__(declared, field, number(owner, field, getattr(declared, field), low, **bounds))
