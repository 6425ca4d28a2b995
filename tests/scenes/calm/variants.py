"""Variants of a scene: solver, prices, limits, and numbers of the law."""

from __future__ import annotations

import ast
import importlib
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import hqp
from hqp.declare.stack import Stack
from hqp.programs.formulation import Formulation
from hqp.solvers.base import Solver


@dataclass(frozen=True)
class Variant:
    """Variant of a scene: solver, default prices or none, and the limits' two numbers."""

    name: str
    solver: str | Solver = "lexicographic"
    priced: bool = True
    window: float | None = None
    braking: float | None = None
    default: bool = True

    @property
    def limits(self) -> dict[str, Any]:
        """Arguments of JointLimits."""
        return {} if self.default else {"acceleration": self.window, "braking": self.braking}

    def of(self, stack: Stack, formulation: Formulation) -> hqp.Controller:
        """Controller of a stack; no deadline, so that figures do not depend on the machine."""
        price = hqp.Price() if self.priced and self.solver != "weighted" else 0
        return hqp.Controller(stack, formulation, solver=self.solver, price=price, deadline=math.inf)


PRICED = Variant("priced")
EXACT = Variant("exact", priced=False, default=False)
EXACT_LIMITED = Variant("exact, default limits", priced=False)
WEIGHTED = Variant("weighted", solver="weighted")
VARIANTS = {
    v.name: v
    for v in (
        PRICED, EXACT, WEIGHTED, EXACT_LIMITED,
        Variant("priced, plain limits", default=False),
        Variant("priced, window", window=50.0, default=False),
        Variant("priced, braking curve", braking=5.0, default=False),
    )
}  # fmt: skip


def solver_of(text: str) -> str | Solver:
    """Solver by its name in hqp, or by ``module:name(option=number, ...)``."""
    module, colon, call = text.partition(":")
    if not colon or "cascade" in module:
        return text
    made = ast.parse(call, mode="eval").body
    options = {}
    if isinstance(made, ast.Call):
        options = {str(k.arg): ast.literal_eval(k.value) for k in made.keywords}
        made = made.func
    solver = getattr(importlib.import_module(module), ast.unparse(made))(**options)
    if not isinstance(solver, Solver):
        raise TypeError(f"{text} is no solver of hqp")
    return solver


@contextmanager
def changed(numbers: Mapping[str, Any]) -> Iterator[None]:
    """Set constants ``module.NAME``, or single entries ``module.NAME[key]`` of a table, for a while."""
    before: list[tuple[Any, str, Any]] = []
    try:
        for path, value in numbers.items():
            path, _, key = path.rstrip("]").partition("[")
            module_name, _, name = path.rpartition(".")
            module = importlib.import_module(module_name)
            old = getattr(module, name)
            before.append((module, name, old))
            setattr(module, name, {**old, ast.literal_eval(key): value} if key else value)
        yield
    finally:
        for module, name, old in reversed(before):
            setattr(module, name, old)
