"""Faults lie in code, one place each, and every operator makes some."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import pytest

from .__main__ import files_of_tests, nearest, sources
from .operators import OPERATORS, Fault, changes, faults
from .tree import ROOT, Tree

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


@pytest.mark.parametrize(
    ("path", "test"),
    [
        ("hqp/web/doors.py", "tests/viewer/test_doors.py"),
        ("hqp/cpp/session/late.hpp", "tests/unit/test_late.py"),
        ("tasks/within.py", "tests/tasks/test_within.py"),
    ],
)
def test_tests_about_a_place_come_first_and_all_others_after(path: str, test: str) -> None:
    every = sources()
    assert {Path(each).suffix for each in every} == {".py", ".hpp", ".cpp"}
    assert path in every
    order = nearest(path, (ROOT / path).read_text(), 50)
    assert test in order[:3]
    assert sorted(order) == sorted(files_of_tests())
    assert len(order) > 100


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "how"),
    [
        ("assert [] == [1]", "fails"),
        ("os.abort()", "exit code -6"),
        ("all(n == 0 for n in iter(int, 1))", "out of time"),
        ("1 / 1", ""),
    ],
)
def test_how_a_run_ends(line: str, how: str, tmp_path: Path) -> None:
    (tmp_path / "tests").mkdir()
    text = (
        f"import os, pytest\ndef test_good(): pass\n@pytest.mark.parametrize('x', ['a - b'])\ndef test_it(x): {line}\n"
    )
    (tmp_path / "tests" / "test_one.py").write_text(text)
    copy = Tree.__new__(Tree)
    copy.folder, copy.python = tmp_path, Path(sys.executable)
    test = "tests/test_one.py::test_it[a - b]"
    assert copy.failed(["tests/test_one.py"], 2.0, "not slow") == (test if how else "", how)
    assert how != "fails" or copy.failed(["tests/test_one.py"], 2.0, "not slow", but=[test]) == ("", "")
