"""Faults are where code is, one place each, and every operator makes some."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from .__main__ import files_of_tests, fitting, sources
from .operators import OPERATORS, Fault, changes, faults
from .tree import ROOT

PYTHON = '''
"""A text: 3 < 4 and 5."""

LIMIT = 2.5  # 1 + 1


def held(x, low=0):
    """Not 7 - 8."""
    x = min(x, -LIMIT) if not low < 3 and x[0] else x[-1]
    print("1 + 2")
    return -x * 2
'''
CPP = """// 3 < 4
#include <vector>
template <int n = 3> struct S {};
double run(const std::vector<double>& x) {
  double sum = 0.0;
  for (int i = 0; i < 3 && !x.empty(); ++i) sum += x[0] * std::max(x[i + 1], -1.0);
  store_.x[2] = "a + b"[0];
  clear(sum);
  return sum;
}
"""


def real(path: str, text: str) -> list[Fault]:
    return [fault for fault in faults(path, text) if changes(fault, text)]


@pytest.mark.parametrize(("path", "text"), [("a.py", PYTHON), ("a.hpp", CPP)], ids=["python", "cpp"])
def test_faults_are_made_of_code_alone(path: str, text: str) -> None:
    found = real(path, text)
    assert {fault.operator for fault in found} == {*OPERATORS, "statement"}
    assert len({fault.put_into(text) for fault in found}) == len(found)
    for fault in found:
        changed, lines = fault.put_into(text).splitlines(), text.splitlines()
        (line,) = [i for i, (old, new) in enumerate(zip(lines, changed, strict=True)) if old != new]
        assert not any(hidden in lines[line] for hidden in ('"""', "// 3", "#include", "template"))
        assert lines[line] not in fault.described(text).partition(" -> ")[2]
        kept = ("# 1 + 1", '"1 + 2"', '"a + b"')
        assert all(
            hidden in changed[line] for hidden in kept if hidden in lines[line] and fault.new not in ("", "pass")
        )


def test_what_is_dropped_leaves_a_function_that_parses() -> None:
    dropped = [fault for fault in real("a.py", PYTHON) if fault.operator == "statement"]
    assert [PYTHON[fault.start : fault.stop][:5] for fault in dropped] == ["x = m", "print"]
    for fault in dropped:
        ast.parse(fault.put_into(PYTHON))
    gone = [CPP[fault.start : fault.stop].strip() for fault in faults("a.hpp", CPP) if fault.operator == "statement"]
    assert gone == ['store_.x[2] = "a + b"[0];', "clear(sum);"]


def test_every_source_has_fitting_tests() -> None:
    every, known = sources(), files_of_tests()
    assert {Path(path).suffix for path in every} == {".py", ".hpp", ".cpp"}
    for path in every:
        assert all((ROOT / test).exists() for stage in fitting(path, known) for test in stage), path
    assert fitting("hqp/loop/presence.py", known) == [
        ["tests/export/test_presence.py", "tests/unit/test_presence.py"],
        ["tests/unit"],
    ]
    assert fitting("hqp/cpp/rows/laws.hpp", known)[-1] == ["tests/tasks"]
    assert fitting("tasks/wheel.py", known)[-1] == ["tests/tasks"]
