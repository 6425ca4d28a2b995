"""The direction of imports, walked over the sources: who may know whom."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROOMS = ("explanation", "loop", "transition")
CORE = sorted((ROOT / "hqp").glob("*.py"))
CORE_AND_ROOMS = [*CORE, *(path for room in ROOMS for path in sorted((ROOT / "hqp" / room).glob("*.py")))]
SOLVERS = sorted((ROOT / "hqp" / "solvers").rglob("*.py"))
TASKS = sorted((ROOT / "tasks").rglob("*.py"))
ROBOTS = sorted((ROOT / "robots").rglob("*.py"))
BACKENDS = {"proxsuite", "osqp", "daqp", "qpsolvers", "piqp", "clarabel", "quadprog"}

BASE = {"arrays", "errors", "tolerances"}
"""What everybody may import."""

# module of hqp: the modules of hqp that it may import at load time, beside BASE
MAY: dict[str, set[str]] = {
    "arrays": {"errors"},
    "errors": set(),
    "floating_base": set(),
    "law": set(),
    "native": set(),
    "nnls": set(),
    "problem": set(),
    "reference": set(),
    "robot": set(),
    "robots": {"_assembly"},
    "tolerances": set(),
    "plans": {"robot"},
    "pricing": {"problem"},
    "null_directions": {"problem"},
    "graded": set(),
    "judge": {"graded", "nnls", "problem"},
    "stage_conditions": {"judge", "nnls", "pricing", "problem"},
    "certify": {"graded", "judge", "null_directions", "problem", "stage_conditions"},
    "element": {"law", "plans", "reference", "robot"},
    "checking": {"element", "robot"},
    "price": {"element", "law", "problem", "robot"},
    "readable": {"element", "reference", "robot"},
    "solvers": {"_priced", "certify", "native", "nnls", "null_directions", "pricing", "problem"},
    "tasks": {"_assembly", "element", "law", "plans", "reference", "robot"},
    "assembly": {"_assembly", "element", "law", "plans", "readable", "reference", "robot"},
    "stack": {"element", "law", "price", "robot"},
    "layout": {"element", "price", "robot", "stack"},
}
MAY["shapes"] = set()
for _part in ("robot", "robots", "tasks"):
    MAY[_part] |= {"shapes"}

ABOVE = {
    "adapters", "arguments", "batch", "comparison", "controller", "doctor", "estimation", "explanation", "export",
    "formulation", "goals", "lab", "loaded", "loads", "loop", "markdown", "motion", "recorder", "sequence", "serial",
    "session", "sweep", "teleoperation", "tick", "torque", "transition", "viewer", "walking",
}  # fmt: skip
"""Formulations, sessions and what stands on them: they may import what they need, but in no circle."""


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

    visit(ast.parse(path.read_text()))
    return found


def roots(path: Path) -> set[str]:
    return {name.split(".")[0] for name in imported(path)}


def siblings(path: Path) -> set[str]:
    """First-level modules of hqp that a file imports at load time."""
    return {name.split(".")[1] for name in imported(path, everywhere=False) if name.startswith("hqp.")}


def modules() -> dict[str, Path]:
    """Every module of hqp, tasks, robots and benchmarks by its dotted name."""
    found = {}
    for prefix, folder in (
        ("hqp", "hqp"),
        ("hqp.tasks", "tasks"),
        ("hqp.robots", "robots"),
        ("benchmarks", "benchmarks"),
    ):
        for path in (ROOT / folder).rglob("*.py"):
            parts = path.relative_to(ROOT / folder).with_suffix("").parts
            if prefix == "hqp" and parts[0] in ("tasks", "robots"):
                continue  # links to the folders beside
            found[".".join((prefix, *parts)).removesuffix(".__init__")] = path
    return found


def loads(name: str, path: Path, known: dict[str, Path]) -> set[str]:
    """The modules that a module imports at load time, relative ones resolved."""
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    found = {part for part in imported(path, everywhere=False) if part in known}
    for node in ast.parse(path.read_text()).body:
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
    while graph:  # take away what imports nothing that is left
        free = {name for name, needs in graph.items() if not needs & graph.keys()}
        assert free, f"these import each other: {sorted(graph)}"
        graph = {name: needs for name, needs in graph.items() if name not in free}


def test_every_module_of_the_core_has_its_line() -> None:
    top = {path.stem for path in CORE} | {path.parent.name for path in (ROOT / "hqp").glob("*/__init__.py")}
    missing = top - {"__init__", "__main__"} - set(MAY) - ABOVE
    assert not missing, f"say in MAY what these may import, or put them into ABOVE: {missing}"


@pytest.mark.parametrize("module", [m for m in MAY if m not in ("solvers", "tasks", "robots")])
def test_core_modules_know_only_what_is_below_them(module: str) -> None:
    file = ROOT / "hqp" / f"{module}.py"
    for path in [file] if file.exists() else sorted((ROOT / "hqp" / module).rglob("*.py")):
        strangers = siblings(path) - MAY[module] - BASE - {module}
        assert not strangers, f"{path.relative_to(ROOT)} imports {strangers}"


@pytest.mark.parametrize(
    ("part", "files"), [("solvers", SOLVERS), ("tasks", TASKS), ("robots", ROBOTS)], ids=["solvers", "tasks", "robots"]
)
def test_parts_know_only_what_is_below_them(part: str, files: list[Path]) -> None:
    assert files
    for path in files:
        strangers = siblings(path) - MAY[part] - BASE - {part}
        assert not strangers, f"{path.relative_to(ROOT)} imports {strangers}"


def test_only_robots_import_pinocchio_or_mujoco() -> None:
    for path in [*CORE_AND_ROOMS, *SOLVERS, *TASKS]:
        assert not roots(path) & {"pinocchio", "mujoco"}, path.name


def test_only_adapters_import_back_ends() -> None:
    for path in [*CORE_AND_ROOMS, *TASKS, *ROBOTS]:
        assert not roots(path) & BACKENDS, path.name


def test_nothing_imports_benchmarks_or_tests() -> None:
    for path in [*CORE_AND_ROOMS, *SOLVERS, *TASKS, *ROBOTS]:
        assert not roots(path) & {"benchmarks", "tests", "conftest"}, path.name


def test_inside_tasks_and_robots_no_parent_imports() -> None:
    for path in [*TASKS, *ROBOTS]:
        levels = [n.level for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.ImportFrom)]
        assert max(levels, default=0) <= 1, path.name


def run(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=False)


HEAVY = BACKENDS | {"pinocchio", "mujoco", "matplotlib", "rich", "scipy", "importlib.metadata", "numpy.random"}
"""What takes tens of milliseconds to import."""


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
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "self":
            found.add(node.attr)
        elif isinstance(node, ast.FunctionDef):
            found.add(node.name)
    return {name for name in found if name.startswith("_") and not name.startswith("__")}


@pytest.mark.parametrize("owner", ["session.py", "loop/line.py", "tick.py"])
def test_the_private_fields_of_a_session_are_its_own(owner: str) -> None:
    """Nor does anybody look into the lines that it runs, or into a tick."""
    own = ROOT / "hqp" / owner
    names, found = private_names(own), []
    assert names
    for folder in ("hqp/*.py", "hqp/*/**/*.py", "benchmarks/**/*.py"):
        for path in sorted(ROOT.glob(folder)):
            if path == own:
                continue
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.Attribute) and node.attr in names and session_like(node.value):
                    found.append(f"{path.relative_to(ROOT)}:{node.lineno}: {ast.unparse(node)}")
    assert not found


def session_like(node: ast.AST) -> bool:
    """Whether an expression is one that may be a session, a line or a tick: another name or field than self."""
    return not (isinstance(node, ast.Name) and node.id in ("self", "cls", "clone", "found", "other"))
