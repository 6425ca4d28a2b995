"""Direction of imports in the sources: allowed dependencies between rooms."""

from __future__ import annotations

import ast
import gc
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ABOVE_ROBOTS = ("declare", "problem", "programs", "explanation", "loop")
CORE = [
    *sorted((ROOT / "hqp").glob("*.py")),
    *(p for r in ABOVE_ROBOTS for p in sorted((ROOT / "hqp" / r).rglob("*.py"))),
]
SOLVERS = sorted((ROOT / "hqp" / "solvers").rglob("*.py"))
TASKS = sorted((ROOT / "tasks").rglob("*.py"))
ROBOTS = sorted((ROOT / "robots").rglob("*.py"))
BACKENDS = {"proxsuite", "osqp", "daqp", "qpsolvers", "piqp", "clarabel", "quadprog"}

FLOORS = (
    {"errors", "markdown", "progress", "tolerances", "user_cache"},
    {"kinds", "numbers"},
    {"arrays", "collision_library", "native", "sweep", "web"},
    {"angles", "dlpack", "floating_base", "problem", "shapes"},
    {"solvers", "state_map"},
    {"declare"},
    {"estimation", "programs", "sequence", "tasks"},
    {"explanation", "robots", "search", "serial", "teleoperation", "torque"},
    {"commands"},
    {"recorder"},
    {"loop"},
    {"comparison", "export", "goals", "lab", "viewer"},
    {"motion", "policies", "walking"},
    {"adapters", "__main__"},
)
"""Rooms from the ground up: folders of hqp, and files beside them.  A room imports only from lower floors."""


@cache
def tree(path: Path) -> ast.Module:
    """Syntax tree of a file, parsed once for all tests."""
    return ast.parse(path.read_text())


@cache
def nodes(path: Path) -> tuple[ast.AST, ...]:
    """All nodes of the tree, flat."""
    return tuple(ast.walk(tree(path)))


@pytest.fixture(scope="module", autouse=True)
def _trees() -> Iterator[None]:
    """Free the trees after these tests, and search for no garbage among their millions of nodes."""
    gc.disable()
    yield
    tree.cache_clear()
    nodes.cache_clear()
    gc.enable()


def imported(path: Path, everywhere: bool = True) -> set[str]:
    """Absolute names a file imports: at any depth, or at load time only (no functions, no TYPE_CHECKING)."""
    found: set[str] = set()

    def visit(node: ast.AST) -> None:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.Import):
                found.update(alias.name for alias in child.names)
            elif isinstance(child, ast.ImportFrom) and child.level == 0 and child.module:
                found.update({child.module} | {f"{child.module}.{alias.name}" for alias in child.names})
            lazy = isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef)) or (
                isinstance(child, ast.If) and "TYPE_CHECKING" in ast.dump(child.test)
            )
            if everywhere or not lazy:
                visit(child)

    visit(tree(path))
    return found


def roots(path: Path) -> set[str]:
    return {name.split(".")[0] for name in imported(path)}


def modules() -> dict[str, Path]:
    """Every module of hqp, tasks, robots, tests/scenes and benchmarks by its dotted name."""
    found = {}
    for prefix, folder in (
        ("hqp", "hqp"),
        ("hqp.tasks", "tasks"),
        ("hqp.robots", "robots"),
        ("tests.scenes", "tests/scenes"),
        ("benchmarks", "benchmarks"),
    ):
        for path in (ROOT / folder).rglob("*.py"):
            parts = path.relative_to(ROOT / folder).with_suffix("").parts
            if prefix == "hqp" and parts[0] in ("tasks", "robots"):
                continue  # links to neighbouring folders
            found[".".join((prefix, *parts)).removesuffix(".__init__")] = path
    return found


def loads(name: str, path: Path, known: dict[str, Path]) -> set[str]:
    """The modules that a module imports at load time, relative ones resolved."""
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    found = {part for part in imported(path, everywhere=False) if part in known}
    for node in tree(path).body:
        if isinstance(node, ast.ImportFrom) and node.level:
            base = package.split(".")[: len(package.split(".")) - node.level + 1] + (
                [node.module] if node.module else []
            )
            found.update({".".join(base)} | {".".join((*base, alias.name)) for alias in node.names})
    named = {part.rpartition(".")[0] for part in found if part in known}  # `from package import module`
    return {part for part in found if part in known and part not in named} - {name}


def test_no_circles() -> None:
    known = modules()
    graph = {name: loads(name, path, known) for name, path in known.items()}
    while graph:  # remove modules without remaining imports
        free = {name for name, needs in graph.items() if not needs & graph.keys()}
        assert free, f"these import each other: {sorted(graph)}"
        graph = {name: needs for name, needs in graph.items() if name not in free}


def room(module: str) -> str:
    """Room of a module, "" for a module outside the rooms of hqp."""
    parts = module.split(".")
    return parts[1] if parts[0] == "hqp" and len(parts) > 1 else ""


def everything(name: str, path: Path, known: dict[str, Path]) -> set[str]:
    """Modules that a module imports anywhere, also in functions and for types."""
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    found = set()
    for node in nodes(path):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            parts = package.split(".")
            base = ".".join([*parts[: len(parts) - node.level + 1], node.module or ""]).strip(".")
            base = base if node.level else node.module or ""
            found |= {f"{base}.{alias.name}" if f"{base}.{alias.name}" in known else base for alias in node.names}
    return found & known.keys()


def cycles(graph: dict[str, set[str]]) -> list[set[str]]:
    """Sets of nodes that reach each other, of two and more."""
    reached: dict[str, set[str]] = {}
    for start in graph:
        found, ahead = set[str](), [start]
        while ahead:
            for name in graph[ahead.pop()] - found:
                found.add(name)
                ahead.append(name)
        reached[start] = found
    sets = {frozenset(other for other in reached[name] if name in reached[other]) for name in graph}
    return [set(one) for one in sets if len(one) > 1]


def test_no_more_than_three_files_import_each_other() -> None:
    """Typed and late imports count, inside rooms, too; packages give the names of their files and do not count."""
    known = {n: path for n, path in modules().items() if n.startswith("hqp.") and path.name != "__init__.py"}
    graph = {name: everything(name, path, known) - {name} for name, path in known.items()}
    assert cycles({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": {"a"}}) == [{"b", "c"}]
    assert [sorted(one) for one in cycles(graph) if len(one) > 3] == []


def test_rooms_know_only_what_stands_on_lower_floors() -> None:
    known = modules()
    floor = {name: k for k, names in enumerate(FLOORS) for name in names}
    missing = {room(name) for name in known} - {""} - floor.keys()
    assert not missing, f"say in FLOORS where these stand: {missing}"
    up = [
        f"{name} imports {other}"
        for name, path in known.items()
        for other in sorted(everything(name, path, known))
        if room(name) and room(other) and room(name) != room(other) and floor[room(other)] >= floor[room(name)]
    ]
    assert not up, "\n".join(up)


def test_only_robots_import_pinocchio_or_mujoco() -> None:
    for path in [*CORE, *SOLVERS, *TASKS]:
        assert not roots(path) & {"pinocchio", "mujoco"}, path.name


def test_only_adapters_import_back_ends() -> None:
    for path in [*CORE, *TASKS, *ROBOTS]:
        assert not roots(path) & BACKENDS, path.name


@pytest.mark.parametrize(
    ("folder", "unknown"),
    [
        ("hqp", {"benchmarks", "tests", "conftest"}),
        ("tasks", {"benchmarks", "tests", "conftest"}),
        ("robots", {"benchmarks", "tests", "conftest"}),
        ("tests/scenes", {"benchmarks", "tests", "conftest"}),
        ("benchmarks", {"tests", "conftest"}),
        ("tests", {"benchmarks"}),
        ("examples", {"benchmarks", "tests"}),
    ],
)
def test_what_stands_outside_the_library(folder: str, unknown: set[str]) -> None:
    """tests and benchmarks share tests/scenes; only tests/benchmarks imports the benchmarks."""
    own = ROOT / "tests" / "benchmarks"
    found = [p for p in (ROOT / folder).rglob("*.py") if own not in p.parents]
    assert found
    wrong = []
    for path in found:
        names = {name for name in imported(path) if not f"{name}.".startswith("tests.scenes.")}
        if strange := {name.split(".")[0] for name in names - {"tests"}} & unknown:
            wrong.append(f"{path.relative_to(ROOT)}: {strange}")
    assert not wrong, "\n".join(wrong)


def test_inside_tasks_and_robots_no_parent_imports() -> None:
    for path in [*TASKS, *ROBOTS]:
        levels = [n.level for n in nodes(path) if isinstance(n, ast.ImportFrom)]
        assert max(levels, default=0) <= 1, path.name


def run(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=False)


HEAVY = BACKENDS | {"pinocchio", "mujoco", "matplotlib", "rich", "scipy", "importlib.metadata", "numpy.random"}
"""Packages that take tens of milliseconds to import."""


def test_import_hqp_is_light() -> None:
    result = run(f"import sys, hqp; print(sorted(set({sorted(HEAVY)!r}) & set(sys.modules)))")
    assert result.stdout.strip() == "[]", result.stdout + result.stderr


def test_a_robot_by_name_and_its_session_import_pinocchio_alone() -> None:
    result = run(
        "import sys, hqp\nfrom hqp.tasks import Com, FixedContact, JointLimits, Posture\n"
        "robot = hqp.robots.load('g1')\n"
        "feet = [FixedContact(frame=f) for f in robot.landmarks['soles']]\n"
        "stack = hqp.Stack(hqp.Level(Com()), hqp.Level(Posture()), subject_to=[*feet, JointLimits()])\n"
        "hqp.Controller(stack, hqp.Velocity()).session(robot, 0.002).step(robot.state())\n"
        f"print(sorted(set({sorted(HEAVY)!r}) & set(sys.modules)))"
    )
    assert result.stdout.strip() == "['pinocchio']", result.stdout + result.stderr


@pytest.mark.parametrize("part", ["tasks", "robots"])
def test_a_second_copy_is_refused(part: str) -> None:
    result = run(f"import {part}")
    assert result.returncode != 0
    assert f"import hqp.{part}" in result.stderr


def test_public_names_exist() -> None:
    result = run(
        "import hqp\nfor name in hqp.__all__: getattr(hqp, name)\nimport hqp.tasks as t\n"
        "for name in t.__all__: getattr(t, name)"
    )
    assert result.returncode == 0, result.stderr


def test_libraries_are_attributes_after_import() -> None:
    result = run("import hqp\nhqp.serial.to_dict\nhqp.solvers.lexicographic.Lexicographic\nhqp.solvers.cascade.Cascade")
    assert result.returncode == 0, result.stderr


def test_dir_shows_the_public_names_and_nothing_private() -> None:
    result = run("import hqp\nprint(*dir(hqp))\nprint(*hqp.__all__)")
    shown, public = (set(line.split()) for line in result.stdout.splitlines())
    assert {name for name in shown if not name.startswith("__")} == public
    assert {"Torque", "compare", "robots", "serial", "tasks"} <= shown


def private_names(path: Path) -> set[str]:
    """Fields and methods with one leading underscore of the classes in a file."""
    found = set()
    for node in nodes(path):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "self":
            found.add(node.attr)
        elif isinstance(node, ast.FunctionDef):
            found.add(node.name)
    return {name for name in found if name.startswith("_") and not name.startswith("__")}


@pytest.mark.parametrize("owner", ["loop/session.py", "loop/line.py", "loop/tick.py"])
def test_the_private_fields_of_a_session_are_its_own(owner: str) -> None:
    """The lines of a session and a tick are private as well."""
    own = ROOT / "hqp" / owner
    names, found = private_names(own), []
    assert names
    for folder in ("hqp/*.py", "hqp/*/**/*.py", "tests/scenes/**/*.py", "benchmarks/**/*.py"):
        for path in sorted(ROOT.glob(folder)):
            if path == own:
                continue
            for node in nodes(path):
                if isinstance(node, ast.Attribute) and node.attr in names and session_like(node.value):
                    found.append(f"{path.relative_to(ROOT)}:{node.lineno}: {ast.unparse(node)}")
    assert not found


def through_a_line(node: ast.AST) -> bool:
    """Whether an expression is a name of a session's line or of its native session: session.line.x, line.native.x."""
    if not isinstance(node, ast.Attribute) or not isinstance(node.value, ast.Attribute):
        return False
    owner, name = node.value.value, node.value.attr
    named = owner.attr if isinstance(owner, ast.Attribute) else owner.id if isinstance(owner, ast.Name) else ""
    return (name == "line" and named != "self") or (name == "native" and named in ("line", "session", "run", "tick"))


def test_no_module_reaches_into_the_native_session() -> None:
    found = [node for node in ast.walk(ast.parse("session.line.presence, line.native.holds()")) if through_a_line(node)]
    assert len(found) == 2
    wrong = [
        f"{path.relative_to(ROOT)}:{node.lineno}: {ast.unparse(node)}"
        for folder in ("hqp/**/*.py", "tests/scenes/**/*.py", "benchmarks/**/*.py")
        for path in sorted(ROOT.glob(folder))
        if ROOT / "hqp" / "loop" not in path.parents
        for node in nodes(path)
        if through_a_line(node) and isinstance(node, ast.Attribute)
    ]
    assert not wrong, "\n".join(wrong)


def session_like(node: ast.AST) -> bool:
    """Return true if an expression may be a session, a line or a tick: another name or field than self."""
    return not (isinstance(node, ast.Name) and node.id in ("self", "cls", "clone", "found", "other"))
