"""Install hqp with popular packages in temporary environments, and run it there.

python -m tests.environments [NAME ...] [--folder FOLDER] [--heavy] [--resolve]
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[2]
SHOWN = ("numpy", "scipy", "pin", "mujoco", "torch")
WHEELS = ("--quiet", "--only-binary", ":all:")
"""Options of pip: users have no environment that must compile a package."""
ALONE = """
import importlib.metadata, numpy, sys, hqp
session = hqp.load(sys.argv[1])
assert session.step(session.home).status.solved
assert hqp.Batch.load(sys.argv[1], 2).step(numpy.tile(session.home, (2, 1))).solved.all()
print("numpy", importlib.metadata.version("numpy"))
"""
SHIFT = ("0.05", "0", "0.1")
"""Shift of the hand's target, for a C++ program [m]."""


def main() -> int:
    """Print a line for each environment; return 1 if one failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.environments", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="default: all that are not heavy")
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()) / "hqp-environments")
    parser.add_argument("--heavy", action="store_true", help="with those that install gigabytes")
    parser.add_argument("--wheels", type=Path, help="folder of `make wheels`, whose wheels are taken; default: build")
    parser.add_argument("--resolve", action="store_true", help="let pip resolve, install nothing")
    arguments = parser.parse_args()
    known = tomllib.loads((Path(__file__).parent / "environments.toml").read_text())
    chosen = arguments.names or [name for name, about in known.items() if arguments.heavy or not about.get("heavy")]
    arguments.folder = arguments.folder.resolve()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    wheels = {} if arguments.wheels is None else built(arguments.wheels.resolve())
    failed = []
    for name in chosen:
        about, start = known[name], time.perf_counter()
        python = interpreter(about.get("python"))
        if python is None:
            print(f"{name:20} skipped: no Python {about['python']} here")
            continue
        try:
            text = resolved(about, python) if arguments.resolve else ran(name, about, python, arguments.folder, wheels)
        except subprocess.CalledProcessError as error:
            failed.append(name)
            text = f"FAILED: {error.cmd[:6]}\n{(error.stdout or '')[-3000:]}{(error.stderr or '')[-3000:]}"
        print(f"{name:20} {text}, {time.perf_counter() - start:.0f} s", flush=True)
    return int(bool(failed))


def interpreter(version: str | None) -> str | None:
    """The Python of a version, this one for None."""
    if version is None or version == f"{sys.version_info[0]}.{sys.version_info[1]}":
        return sys.executable
    found = shutil.which(f"python{version}")  # it may be a shim of a version manager that lacks this Python
    usable = found and subprocess.run([found, "-c", ""], capture_output=True, check=False).returncode == 0
    return found if usable else None


def built(folder: Path) -> dict[str, Path]:
    """The wheel of a folder for each Python here."""
    found = {}
    for tag in ("cp310", "cp311", "cp312"):
        python = interpreter(f"3.{tag[3:]}")
        if python is not None and (wheels := sorted(folder.glob(f"*-{tag}-*.whl"))):
            found[python] = wheels[-1]
    return found


def run(*command: object, **options: Any) -> str:
    """Standard output of a command; raises CalledProcessError."""
    environment = {**os.environ, "PIP_DISABLE_PIP_VERSION_CHECK": "1", **options.pop("env", {})}
    given = [str(part) for part in command]
    return subprocess.run(given, check=True, capture_output=True, text=True, env=environment, **options).stdout


def resolved(about: dict[str, Any], python: str) -> str:
    """Versions that pip would install with a pure hqp, which needs no compiler."""
    found = run(
        python, "-m", "pip", "install", "--dry-run", "--ignore-installed", "--quiet", "--report", "-", ROOT,
        *about["requires"], env={"HQP_PURE": "1"},
    )  # fmt: skip
    import json

    versions = {each["metadata"]["name"].lower(): each["metadata"]["version"] for each in json.loads(found)["install"]}
    return " ".join(f"{package} {versions[package]}" for package in SHOWN if package in versions)


def ran(name: str, about: dict[str, Any], python: str, folder: Path, wheels: dict[str, Path]) -> str:
    """Install in one call of pip, run the loops and the tests, and remove the environment."""
    if python not in wheels:
        target = folder / f"wheel-{len(wheels)}"
        shutil.rmtree(target, ignore_errors=True)
        native = {"HQP_REQUIRE_NATIVE": "1"}
        run(python, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", target, ROOT, env=native)
        (wheels[python],) = target.glob("*.whl")
    suite, home = folder / "suite", folder / name
    shutil.rmtree(home, ignore_errors=True)
    suite.mkdir(exist_ok=True)
    for part in ("tests", "examples"):
        if not (suite / part).exists():
            (suite / part).symlink_to(ROOT / part)
    run(python, "-m", "venv", home)
    inside = home / "bin" / "python"
    try:
        if about.get("alone"):
            run(inside, "-m", "pip", "install", *WHEELS, *about["requires"])
            run(inside, "-m", "pip", "install", "--quiet", "--no-deps", wheels[python])
            plan = folder / "ur5.hqp"
            run(sys.executable, "-m", "tests.environments.plan", plan, *SHIFT, cwd=ROOT)
            return f"{run(inside, '-c', ALONE, plan, cwd=suite).strip()}, {linked(inside, plan, home / 'linked')}"
        named = (f"hqp[robots] @ file://{wheels[python]}", *about["requires"], "pytest", "pytest-timeout", "hypothesis")
        sources = [option for package in about.get("sources", ()) for option in ("--no-binary", package)]
        run(inside, "-m", "pip", "install", *WHEELS, *sources, *named)
        run(inside, "-m", "pip", "check")
        doctor = subprocess.run([inside, "-m", "hqp", "doctor"], capture_output=True, text=True, check=False, cwd=suite)
        if "Traceback" in doctor.stderr:
            raise subprocess.CalledProcessError(1, ["hqp", "doctor"], doctor.stdout, doctor.stderr)
        run(inside, "-m", "tests.environments.loops", cwd=suite)
        tested = ""
        if about.get("tests"):
            options = ("--import-mode=importlib", "--rootdir", suite, "-q", "-m", "not slow", "-p", "no:cacheprovider")
            closing = run(inside, "-m", "pytest", *options, *about["tests"], cwd=suite).strip().splitlines()[-1]
            tested = f", {closing.strip('= ')}"
        listed = run(inside, "-m", "pip", "freeze").splitlines()
        versions = dict(line.split("==") for line in listed if line.count("==") == 1)
        return (
            " ".join(f"{package} {versions[package]}" for package in SHOWN if package in versions) + ", loops" + tested
        )
    finally:
        shutil.rmtree(home, ignore_errors=True)


def linked(python: Path, plan: Path, built: Path) -> str:
    """Build the example on the installed package's libraries: its joints end where those of Python's loop end."""
    hqp_dir = run(python, "-m", "hqp", "--cmake-dir", cwd=plan.parent).strip()
    run("cmake", "-S", ROOT / "examples" / "cpp", "-B", built, f"-Dhqp_DIR={hqp_dir}")
    run("cmake", "--build", built, "--target", "follow", "follow_shared")
    wanted = [float(angle) for angle in plan.with_suffix(".txt").read_text().split()]
    for program in ("follow", "follow_shared"):
        angles = [float(angle) for angle in run(built / program, plan, "hand", *SHIFT).split()]
        if len(angles) != len(wanted) or max(abs(a - b) for a, b in zip(angles, wanted, strict=True)) > 1e-8:
            raise subprocess.CalledProcessError(1, [program], f"given {angles}, wanted {wanted}")
    return "linked static and shared"


if __name__ == "__main__":
    sys.exit(main())
