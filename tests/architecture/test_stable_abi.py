"""The bindings use Python's limited API, so that one wheel serves 3.12 and every later version."""

from __future__ import annotations

import re
from pathlib import Path

SOURCES = Path(__file__).parents[2] / "hqp" / "cpp"
BEYOND = re.compile(
    r"\b(Py[A-Z]\w*_(?:GET|SET|AS|READ|WRITE)_\w+"  # macros that look into objects
    r"|PyObject_Call(?:Method)?(?:NoArgs|OneArg)"
    r"|_Py\w+|Py\w+_Type\.\w+|->(?:tp|ob|nb|sq|mp)_\w+)"
)


def test_nothing_looks_into_pythons_objects() -> None:
    found = [
        f"{path.relative_to(SOURCES)}: {m[1]}"
        for path in sorted([*SOURCES.rglob("*.cpp"), *SOURCES.rglob("*.hpp")])
        for m in BEYOND.finditer(path.read_text(encoding="utf-8"))
    ]
    assert not found, f"outside of the limited API (PyTuple_GetItem in place of PyTuple_GET_ITEM): {found}"


def test_every_module_is_built_for_it() -> None:
    cmake = (SOURCES / "CMakeLists.txt").read_text(encoding="utf-8")
    modules = re.findall(r"nanobind_add_module\(\S+ (\S+)", cmake)
    assert modules
    assert set(modules) == {"STABLE_ABI"}
    assert "${SKBUILD_SABI_COMPONENT}" in cmake
