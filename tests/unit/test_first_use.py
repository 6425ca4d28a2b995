"""First contact: a machine without a compiler, a typing error, a broken file."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import PD, Level, P, Stack, native, serial
from hqp.__main__ import main
from hqp.commands import doctor
from hqp.errors import DeclarationError, ModelError
from hqp.tasks import Com, JointLimits, Position, Posture

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[2]
PURE = f"import sys\nfor name in {tuple(native.PARTS)}: sys.modules['hqp.' + name] = None\n"


def run(code: str, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env={**os.environ, "HQP_REQUIRE_NATIVE": "", **environment},
        check=False,
    )


@pytest.mark.long
def test_without_compiled_parts_the_first_import_says_so_once() -> None:
    result = run(PURE + "import hqp\nimport hqp.tasks\nimport hqp", HQP_PURE="")
    assert result.stderr.count("PurePythonWarning") == 1
    assert "compiler" in result.stderr
    assert "hqp doctor" in result.stderr


@pytest.mark.long
def test_the_warning_is_silenced_by_hqp_pure_and_absent_where_all_is_compiled() -> None:
    assert run(PURE + "import hqp", HQP_PURE="1").stderr == ""
    assert run("import hqp", HQP_PURE="").stderr == ""


@pytest.mark.long
def test_a_checkout_without_compiled_parts_says_how_to_get_them(tmp_path: Path) -> None:
    """As after a plain `pip install .`: Python in the checkout finds ./hqp without its compiled parts."""
    checkout = tmp_path / "checkout"
    checkout.mkdir()
    (checkout / "hqp").symlink_to(ROOT / "hqp")
    shutil.copy(ROOT / "pyproject.toml", checkout)
    code = f"import sys\nsys.meta_path[:] = sys.meta_path[-3:]\nsys.path.insert(0, {str(checkout)!r})\n{PURE}"
    refused = run(code + "import hqp", HQP_PURE="")
    assert refused.returncode == 1
    assert f"ImportError: this is the source folder {checkout}, which has no compiled parts" in refused.stderr
    assert f"pip install --editable {checkout}" in refused.stderr
    assert run(code + "import hqp\nprint(hqp.__file__)", HQP_PURE="1").stdout.strip() == f"{checkout}/hqp/__init__.py"
    (checkout / "pyproject.toml").unlink()  # an installed copy: allowed, with the warning
    assert "PurePythonWarning" in run(code + "import hqp", HQP_PURE="", HQP_REQUIRE_NATIVE="").stderr
    required = run(code + "import hqp", HQP_PURE="", HQP_REQUIRE_NATIVE="1")
    assert required.returncode == 1
    assert "ImportError: hqp runs in pure Python: its C++ build failed" in required.stderr


@pytest.mark.long
def test_a_command_imports_no_other_commands_package() -> None:
    others = run("import sys\nfrom hqp.__main__ import main\nmain(['solvers'])\nprint(*sys.modules, sep='\\n')").stdout
    assert "hqp.commands.arguments" in others
    assert not {"hqp.viewer", "hqp.walking", "hqp.lab", "scipy", "pinocchio"} & set(others.split())


@pytest.mark.long
def test_a_reader_that_ends_is_no_traceback() -> None:
    """As in `hqp robots | head -1`."""
    code = "import os, sys\nfrom hqp.__main__ import main\nread, write = os.pipe()\nos.close(read)\n"
    code += "os.dup2(write, 1)\nsys.exit(main(['robots']))"
    result = run(code)
    assert (result.returncode, result.stderr) == (0, "")


@pytest.mark.long
@pytest.mark.parametrize(
    ("output", "status", "told"), [("full", 2, "hqp: No space left on device\n"), ("closed", 0, "")]
)
def test_an_output_that_takes_nothing_is_no_traceback(output: str, status: int, told: str) -> None:
    """Run `hqp robots > /dev/full` and `hqp robots >&-`."""
    begin = "import os, sys\n" + ("sys.stdout = None\n" if output == "closed" else "")
    begin += "from hqp.__main__ import main\n"
    full = "os.dup2(os.open('/dev/full', os.O_WRONLY), 1)\n" if output == "full" else ""
    result = run(begin + full + "sys.exit(main(['robots']))")
    assert (result.returncode, result.stderr) == (status, told)


@pytest.mark.long
def test_without_compiled_parts_a_session_is_refused_with_what_to_do() -> None:
    result = run(
        PURE + "import hqp\nfrom hqp.tasks import Posture\nrobot = hqp.robots.load('cbi')\n"
        "controller = hqp.Controller(hqp.Stack(hqp.Level(Posture())))\nprint(controller.solver.name)\n"
        "try:\n    controller.session(robot, 0.002)\nexcept hqp.errors.HqpError as error:\n    print(error)",
        HQP_PURE="1",
    )
    solver, told = result.stdout.splitlines()
    assert solver == "cascade"
    assert told == (
        f"a session needs the compiled parts of hqp; missing: solver, rows, torque, sessions. {native.ADVICE}"
    )
    assert hqp.Controller(Stack(Level(Posture()))).solver.name == "lexicographic"  # type: ignore[union-attr]


@pytest.mark.long
def test_without_compiled_parts_a_command_says_so(tmp_path: Path) -> None:
    stack = tmp_path / "stack.toml"
    stack.write_text(serial.dumps(Stack(Level(Position(frame="r_palm", law=P(5.0)), name="hand"), Level(Posture()))))
    code = "import sys\nfrom hqp.__main__ import main\nsys.exit(main(['bench', sys.argv[1], '--robot', 'cbi']))"
    result = run(PURE + code, str(stack), HQP_PURE="1")
    assert result.returncode == 2
    assert "a session needs the compiled parts" in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.long
def test_without_compiled_parts_adapters_take_cascade() -> None:
    code = (
        "from hqp.solvers.cascade import Cascade\nworkspace = Cascade.workspace\n"
        "Cascade.workspace = lambda self, shape: print('taken') or workspace(self, shape)\n"
        "import numpy as np\nfrom types import SimpleNamespace as Space\nfrom hqp.adapters import mink, pink\n"
        "task = Space(gain=1.0, compute_jacobian=lambda c: np.eye(2), compute_error=lambda c: np.array([-1.0, 0.5]))\n"
        "at = Space(check_limits=lambda safety_break: None, model=Space(nv=2))\n"
        "for own in pink, mink: assert np.allclose(own.solve_ik(at, [task], 0.1, limits=[]), [10.0, -5.0])\n"
    )
    result = run(PURE + code, HQP_PURE="1")
    assert result.returncode == 0, result.stderr
    assert "taken" in result.stdout


@pytest.mark.long
def test_without_compiled_parts_conflicts_are_still_found() -> None:
    code = (
        "import numpy as np\nfrom hqp.explanation.conflict import conflict\nfrom hqp.problem import Hierarchy, Rows\n"
        "A, lower, upper = np.eye(2)[[0, 0, 1]], np.array([2.0, -np.inf, 0.0]), np.array([np.inf, 1.0, 3.0])\n"
        "rows = Rows(np.diag([1.0, 2.0, 1.0]) @ A, lower, upper)\n"
        "print(conflict(Hierarchy((rows,), constraints=1)))"
    )
    pure = run(PURE + code, HQP_PURE="1")
    assert "exclude each other" in pure.stdout, pure.stderr
    assert pure.stdout == run(code).stdout


@pytest.mark.long
def test_the_command_tells_pure_from_native(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["solvers"]) == 0
    assert f"native ({native.instruction_set()})" in capsys.readouterr().out
    result = run(PURE + "from hqp.__main__ import main\nmain(['solvers'])", HQP_PURE="1")
    assert [line.split(None, 1)[1] for line in result.stdout.splitlines() if line.startswith("lexicographic")] == [
        native.ADVICE
    ]


@pytest.mark.long
def test_the_environment_chooses_the_kernels() -> None:
    code = "from hqp.__main__ import main\nmain(['solvers'])"
    assert "native (generic)" in run(code, HQP_ISA="generic").stdout
    wrong = run(code, HQP_ISA="avx9")
    assert "HQP_ISA='avx9'" in wrong.stderr
    assert "generic, avx2" in wrong.stderr


@pytest.mark.long
def test_doctor_counts_blas_threads_and_says_how_to_mend() -> None:
    code = "import sys\nfrom hqp.__main__ import main\nsys.exit(main(['doctor']))"
    one = dict.fromkeys(doctor.THREADS, "1")
    quiet, slow = run(code, **one), run(code, **dict.fromkeys(doctor.THREADS, "2"))
    assert quiet.returncode == 0, quiet.stdout + quiet.stderr
    assert "OMP_NUM_THREADS" not in quiet.stdout
    assert f"native ({native.instruction_set()})" in quiet.stdout
    pure = run(PURE + code, HQP_PURE="1", **one)
    assert pure.returncode == 1
    assert "pure Python" in pure.stdout
    assert "C++ compiler" in pure.stdout
    if (os.cpu_count() or 1) > 1:
        assert slow.returncode == 1
        assert "OMP_NUM_THREADS=1" in slow.stdout


def test_doctor_names_a_source_that_is_newer_than_the_compiled_parts(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    source, built = tmp_path / "checkout" / "hqp" / "cpp" / "rows" / "laws.hpp", tmp_path / "site" / "_session.so"
    for path in (source, built):
        path.parent.mkdir(parents=True)
        path.touch()
    monkeypatch.setattr(native, "__file__", str(tmp_path / "checkout" / "hqp" / "native.py"))
    spec = importlib.util.spec_from_file_location("hqp._session", built)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: spec if name == "hqp._session" else None)
    os.utime(built, (1000.0, 1000.0))
    os.utime(source, (2000.0, 2000.0))
    assert native.outdated() == "hqp/cpp/rows/laws.hpp"
    os.utime(built, (3000.0, 3000.0))
    assert not native.outdated()


def test_doctor_names_a_missing_package_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "version_of", lambda package: "")
    text = doctor.table(doctor.findings())
    assert "pip install 'hqp[solvers]'" in text
    assert "pip install scipy" in text


@pytest.mark.long
def test_doctor_knows_what_pyproject_asks_for() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]

    def packages(lines: list[str]) -> set[str]:
        found: set[str] = set()
        for line in lines:
            name, _, own = line.partition("[")
            if name == "hqp":
                found |= packages([x for extra in own.rstrip("]").split(",") for x in extras[extra]])
            elif "python_version <" not in line:
                found.add(re.split(r"[\[<>=;]", line)[0])
        return found

    known = doctor.EXTRAS | doctor.CONTRIBUTORS
    assert {extra: set(names) for extra, names in known.items()} == {k: packages(v) for k, v in extras.items()}
    assert set(doctor.REQUIRED) == packages(project["dependencies"])
    shown = doctor.table(doctor.findings())
    assert {extra for extra in extras if f"hqp[{extra}]" in shown} == set(doctor.EXTRAS)
    assert all(f"hqp[{extra}]" in doctor.table(doctor.findings(contributor=True)) for extra in extras)
    assert "capsules" in shown


@pytest.mark.parametrize("name", ["cascade:proxpq", "weighted:proxpq"])
def test_a_mistyped_back_end_is_named_with_the_closest_and_no_pip_line(name: str) -> None:
    with pytest.raises(DeclarationError, match=r"unknown back end.*closest: proxqp") as caught:
        hqp.solvers.load(name)
    assert "pip" not in str(caught.value)


def test_what_is_no_state_and_no_robot_is_told_with_what_makes_one() -> None:
    robot = hqp.robots.load("ur5")
    controller = hqp.Controller(Stack(Level(Posture())))
    with pytest.raises(DeclarationError, match=r"session: not a robot .*hqp\.robots\.load"):
        controller.session("ur5", 0.002)  # type: ignore[arg-type]
    with pytest.raises(DeclarationError, match=r"step: not a State .*robot\.state\(q, v\)"):
        controller.session(robot, 0.002).step(robot.home)  # type: ignore[arg-type]


def test_a_robot_that_is_not_there_is_told_with_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"xacro .*arm\.urdf\.xacro > arm\.urdf"):
        hqp.robots.load(tmp_path / "arm.urdf.xacro")
    with pytest.raises(ModelError, match=r"closest: none; `hqp robots` lists them"):
        hqp.robots.load("&&&")
    robot = hqp.robots.load("solo12")
    with pytest.raises(ModelError, match=r"given \(18,\) and \(18,\); robot\.configuration\(angles\)"):
        robot.state(np.zeros(robot.nv))


def test_a_single_constraint_in_subject_to_is_refused_with_the_form() -> None:
    with pytest.raises(DeclarationError, match=r"subject_to: not a list .*allowed: \[JointLimits\(\)"):
        Stack(Level(Posture()), subject_to=JointLimits())  # type: ignore[arg-type]


@pytest.mark.parametrize("law", [P((1.0, 2.0)), PD((1.0, 2.0)), PD(1.0, (1.0, 2.0))])
def test_gains_must_fit_the_rows(law: P | PD) -> None:
    stack = Stack(Level(Position(frame="r_palm", law=law)))
    formulation = hqp.Velocity() if law.order == 1 else hqp.Acceleration()
    controller = hqp.Controller(stack, formulation, solver="nullspace")
    with pytest.raises(DeclarationError, match=r"r_palm: .* has 2 numbers .*one number, or 3"):
        controller.session(hqp.robots.load("cbi"), 0.002)


def test_numbers_of_numpy_are_numbers() -> None:
    assert P(np.float32(2.0)) == P(2.0)
    assert PD(np.array((1.0, 4.0))) == PD((1.0, 4.0))  # type: ignore[arg-type]
    element = Com(weight=np.float64(2.0), law=P(np.int64(3)))
    assert element == Com(weight=2.0, law=P(3))
    stack = Stack(Level(element))
    assert serial.loads(serial.dumps(stack)) == stack


ELEMENT = '[[level]]\n[[level.element]]\ntype = "Posture"\n'


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("level = 3", "list of tables"),
        ('level = ["a"]', "list of tables"),
        ('[[level]]\nelement = "x"', "list of tables"),
        ("[[level]]\nelement = [1]", "list of tables"),
        ('subject_to = "x"', "list of tables"),
        ('[[level]]\nname = 3\n[[level.element]]\ntype = "Posture"', "name must be a string"),
        (ELEMENT + "weight = " + "9" * 400, "bits"),
        (ELEMENT + "weight = 0x" + "f" * 5000, "bits"),
        (ELEMENT + "weight = " + "9" * 5000, "not TOML"),
        (ELEMENT + 'law = { type = "P", gain = 1' + "0" * 400 + " }", "bits"),
        ("a = " + "[" * 5000, "nested too deeply"),
        (ELEMENT + 'law = { type = ["P"] }', "unknown type"),
        ('[[level]]\n[[level.element]]\ntype = ["P"]', "unknown type"),
        (ELEMENT + "weight = 1979-05-27", "weight"),
    ],
)
def test_broken_toml_is_an_error_of_ours(text: str, word: str) -> None:
    with pytest.raises(DeclarationError, match=word) as caught:
        serial.loads(text)
    assert len(str(caught.value)) < 600


def test_a_file_in_another_encoding_is_an_error_of_ours(tmp_path: Path) -> None:
    path = tmp_path / "stack.toml"
    path.write_bytes(('name = "é"\n' + ELEMENT).encode("latin-1"))
    with pytest.raises(DeclarationError, match="not UTF-8"):
        serial.load(path)
    path.write_bytes(b"\xef\xbb\xbf" + ELEMENT.encode())  # an editor's byte order mark
    assert str(serial.load(path)) == "posture"


@pytest.mark.parametrize("given", [3, None, "/tmp/\0"])
def test_what_is_no_file_is_an_error_of_ours(given: Any) -> None:
    with pytest.raises(DeclarationError, match="cannot be read"):
        serial.load(given)


ENDS = {
    "last line": "",
    "exception": "raise RuntimeError('over')",
    "exit": "sys.exit(3)",
    "interrupt": "import os, signal; os.kill(os.getpid(), signal.SIGINT)",
    "never released": "import ctypes; ctypes.pythonapi.Py_IncRef(ctypes.py_object(session))",
}


@pytest.mark.long
@pytest.mark.parametrize("end", ENDS.values(), ids=ENDS)
def test_no_report_of_leaks_whatever_ends_the_script(end: str) -> None:
    code = (
        "import sys, hqp, numpy as np\nfrom hqp.tasks import Posture\n"
        "class Mine(hqp.Task):\n"
        "    def rows(self, robot): return 1\n"
        "    def value(self, state): return state.com()[:1]\n"
        "    def jacobian(self, state): return state.com_jacobian()[:1]\n"
        "robot = hqp.robots.load('cbi')\n"
        "session = hqp.Controller(hqp.Stack(hqp.Level(Mine()), hqp.Level(Posture()))).session(robot, 0.002)\n"
        "tick = session.step(robot.state())\nprint(tick.status.name)\n"
    )
    result = run(code + end)
    assert "OPTIMAL" in result.stdout, result.stderr
    assert "nanobind" not in result.stderr


def test_capsules_are_fitted_and_written(tmp_path: Path) -> None:
    arm, fitted = tmp_path / "arm.xml", tmp_path / "arm.toml"
    geom = "<geom type='capsule' fromto='0 0 0 0 0 .4' size='.05'/>"
    arm.write_text(f"<mujoco><worldbody><body><joint name='j'/>{geom}</body></worldbody></mujoco>")
    assert main(["capsules", str(arm), "--output", str(fitted)]) == 0
    robot = hqp.robots.load(arm).with_capsules(fitted)
    assert robot.capsules[0].radius == pytest.approx(0.05, rel=0.05)


@pytest.mark.parametrize("dt", [0.1001, 0.5, 1.0, 4, 20, 250, 1000.0, np.float64(500.0)])
def test_a_rate_or_milliseconds_given_as_a_period_are_refused(dt: float) -> None:
    controller, robot = hqp.Controller(Stack(Level(Posture()))), hqp.robots.load("cbi", floating=False)
    with pytest.raises(DeclarationError, match=re.escape("allowed: 0 < dt <= 0.1")) as refused:
        controller.session(robot, dt)
    assert (f"a rate of {dt:g} Hz is dt={1.0 / dt:g}" in str(refused.value)) == (dt >= 10)
    assert (f"{dt:g} ms are dt={1e-3 * dt:g}" in str(refused.value)) == (dt <= 100)
    for meant in (1.0 / 250.0, 0.1):
        controller.session(robot, meant)


@pytest.mark.long
def test_a_missing_extra_is_named_with_its_install(tmp_path: Path) -> None:
    for module in ("gym", "vector_env"):
        result = run(f"import sys\nsys.modules['gymnasium'] = None\nimport hqp.adapters.{module}")
        assert "pip install 'hqp[gym]'" in result.stderr.splitlines()[-1]
    stack = tmp_path / "stack.toml"
    stack.write_text(serial.dumps(Stack(Level(Posture()))))
    for package in ("threadpoolctl", "rich"):
        code = f"import sys\nsys.modules[{package!r}] = None\nfrom hqp.__main__ import main\n"
        result = run(code + "sys.exit(main(['compare', sys.argv[1], '--robot', 'cbi']))", str(stack))
        assert result.returncode == 2
        assert f"{package}: pip install 'hqp[lab]'" in result.stderr


@pytest.mark.parametrize("name", ["qpoasis", "x", "Lexicographic"])
def test_an_unknown_solver_is_answered_with_the_known_ones(name: str) -> None:
    with pytest.raises(DeclarationError) as raised:
        hqp.solvers.load(name)
    for known in hqp.solvers.known():
        assert known in str(raised.value)
